# SPDX-License-Identifier: Apache-2.0
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor, nn

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.training import device
from neugrasp_ros.training.device import (
    device_of,
    mixed_precision,
    moved,
    training_device,
)

META = torch.device("meta")


@dataclass(frozen=True)
class Pair:
    points: Tensor
    labels: Tensor


def test_without_a_gpu_everything_is_on_the_cpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert training_device(TrainConfig()).type == "cpu"
    with pytest.raises(ConfigError, match="no GPU"):
        training_device(TrainConfig(device="cuda"))


def test_each_process_takes_its_own_gpu_unless_told_otherwise(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setenv("LOCAL_RANK", "1")
    assert training_device(TrainConfig()) == torch.device("cuda", 1)
    assert training_device(TrainConfig(device="cpu")).type == "cpu"


def test_a_batch_follows_its_model():
    model = nn.Linear(2, 1).to(META)
    batch = moved(Pair(torch.zeros(3, 2), torch.ones(3)), device_of(model))
    assert batch.points.device == batch.labels.device == META
    assert batch.points.shape == (3, 2)


@pytest.mark.parametrize(
    ("flags", "dtype"),
    [("fma avx2 avx512f", torch.float32), ("avx512f avx512_bf16", torch.bfloat16)],
)
def test_a_cpu_computes_in_bfloat16_where_it_has_instructions_for_it(
    tmp_path, monkeypatch, flags, dtype
):
    info = tmp_path / "cpuinfo"
    info.write_text(f"flags\t\t: fpu {flags}\n")
    quick = device.multiplies_bfloat16(info)
    monkeypatch.setattr(device, "multiplies_bfloat16", lambda *_: quick)
    with mixed_precision(TrainConfig(), torch.device("cpu")):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == dtype
    with mixed_precision(TrainConfig(bfloat16=False), torch.device("cpu")):
        assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == torch.float32
    monkeypatch.undo()
    assert not device.multiplies_bfloat16(tmp_path / "missing")
