# SPDX-License-Identifier: Apache-2.0
"""Where a stage is trained, and in which precision."""

import os
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import nn

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import ConfigError

Batch = TypeVar("Batch", bound=Any)
CPU_INFO = Path("/proc/cpuinfo")
BFLOAT16_FLAGS = frozenset({"avx512_bf16", "amx_bf16", "bf16"})  # the last one is ARM's


def training_device(config: TrainConfig) -> torch.device:
    """Return the device of a stage; with several processes each takes its own GPU.

    Raises:
        ConfigError: If a GPU is asked for and there is none.
    """
    available = torch.cuda.is_available()
    if config.device == "cuda" and not available:
        raise ConfigError("device is 'cuda', but torch finds no GPU; use 'auto'")
    if config.device == "cpu" or not available:
        return torch.device("cpu")
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))


def device_of(model: nn.Module) -> torch.device:
    """Return where a model's parameters are."""
    return next(model.parameters()).device


def moved(batch: Batch, device: torch.device) -> Batch:
    """Return a dataclass of tensors on a device."""
    return replace(
        batch, **{f.name: getattr(batch, f.name).to(device) for f in fields(batch)}
    )


def mixed_precision(config: TrainConfig, device: torch.device) -> torch.autocast:
    """Return the context in which losses are computed: bfloat16 where it is quick."""
    quick = device.type == "cuda" or multiplies_bfloat16()
    return torch.autocast(
        device.type, dtype=torch.bfloat16, enabled=config.bfloat16 and quick
    )


@lru_cache(maxsize=1)
def multiplies_bfloat16(cpuinfo: Path = CPU_INFO) -> bool:
    """Tell whether this CPU has instructions for bfloat16; others emulate it slowly."""
    try:
        flags = cpuinfo.read_text().split()
    except OSError:
        return False
    return not BFLOAT16_FLAGS.isdisjoint(flags)
