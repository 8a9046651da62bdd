# SPDX-License-Identifier: Apache-2.0
import shutil
from dataclasses import replace

import pytest
import torch
from line_fit import CONFIG, Killed, LineFit, small_model

from neugrasp_ros.errors import CheckpointError
from neugrasp_ros.training import portable
from neugrasp_ros.training.loop import optimise
from neugrasp_ros.training.portable import drop_stage, pack_stage, unpack_stage

STAGE = "occupancy"


@pytest.fixture
def killed(tmp_path, eager_checkpoints):
    """A run that was killed at step 25; its small files are all that is left."""
    model = small_model()
    with pytest.raises(Killed):
        optimise(
            model, LineFit(model, killed_at=25), CONFIG,
            tmp_path / "lost" / STAGE, tmp_path / "lost" / "kept",
        )  # fmt: skip
    kept = tmp_path / "elsewhere" / "kept"
    shutil.copytree(tmp_path / "lost" / "kept", kept)
    shutil.rmtree(tmp_path / "lost")
    return kept


@pytest.mark.slow
def test_a_run_goes_on_from_the_small_files_alone(killed, tmp_path):
    whole, resumed = small_model(), small_model()
    optimise(whole, LineFit(whole), CONFIG, tmp_path / "whole" / STAGE)
    rest = LineFit(resumed)
    out = tmp_path / "elsewhere" / STAGE
    history = optimise(resumed, rest, CONFIG, out, killed)
    assert rest.steps == list(range(25, CONFIG.steps))
    assert history[0]["step"] < 25
    for one, other in zip(resumed.parameters(), whole.parameters(), strict=True):
        torch.testing.assert_close(one, other, atol=0.02, rtol=0.02)


def test_moments_are_kept_in_half_precision_until_the_stage_has_ended(killed, tmp_path):
    def bytes_of(folder):
        return sum(path.stat().st_size for path in folder.glob("*.safetensors"))

    assert unpack_stage(killed, tmp_path / STAGE)
    state = torch.load(tmp_path / STAGE / "state.pt", weights_only=True)
    moment = state["optimiser"]["state"][0]["exp_avg"]
    assert torch.equal(moment, moment.to(torch.bfloat16).float())
    assert moment.any()
    pack_stage(tmp_path / STAGE, tmp_path / "done", steps=25)
    assert bytes_of(tmp_path / "done") < bytes_of(killed)


def test_files_are_split_and_found_again(killed, tmp_path, monkeypatch):
    assert unpack_stage(killed, tmp_path / STAGE)
    before = torch.load(tmp_path / STAGE / "state.pt", weights_only=True)
    monkeypatch.setattr(portable, "MAX_BYTES", 200)
    files = pack_stage(tmp_path / STAGE, tmp_path / "small", CONFIG.steps)
    assert len(files) >= 4
    assert unpack_stage(tmp_path / "small", tmp_path / "again" / STAGE)
    after = torch.load(tmp_path / "again" / STAGE / "state.pt", weights_only=True)
    assert after["step"] == before["step"] == 25
    for name, tensor in before["model"].items():
        assert torch.equal(after["model"][name], tensor)
    monkeypatch.undo()
    assert len(pack_stage(tmp_path / STAGE, tmp_path / "small", CONFIG.steps)) == 2
    assert len(list((tmp_path / "small").iterdir())) == 2
    drop_stage(tmp_path / "small", STAGE)
    assert not list((tmp_path / "small").iterdir())


def test_what_the_folder_holds_already_is_newer(killed, tmp_path):
    assert unpack_stage(killed, tmp_path / STAGE)
    assert not unpack_stage(killed, tmp_path / STAGE)
    assert not unpack_stage(tmp_path / "nothing", tmp_path / "other" / STAGE)


def test_tensors_without_their_record_are_told(killed, tmp_path):
    (killed / f"{STAGE}.json").unlink()
    with pytest.raises(CheckpointError, match="is missing, but the stage's tensors"):
        unpack_stage(killed, tmp_path / STAGE)


def test_a_damaged_file_is_told(killed, tmp_path):
    path = next(killed.glob("*.safetensors"))
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(CheckpointError, match="cannot be resumed from"):
        unpack_stage(killed, tmp_path / STAGE)
    path.unlink()
    model = small_model()
    with pytest.raises(CheckpointError, match="cannot be resumed from"):
        optimise(
            model, LineFit(model), replace(CONFIG, steps=30), tmp_path / STAGE, killed
        )
