# SPDX-License-Identifier: Apache-2.0
import json

import pytest
import torch
from line_fit import CONFIG, Killed, LineFit, small_model
from torch import nn

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import CheckpointError
from neugrasp_ros.training.loop import learning_rate_at, optimise


def test_the_loss_falls_and_its_history_is_kept(tmp_path, eager_checkpoints):
    model = small_model()
    history = optimise(model, LineFit(model), CONFIG, tmp_path)
    assert history[-1]["step"] == CONFIG.steps
    assert history[-1]["fit"] < 0.5 * history[0]["fit"]
    assert json.loads((tmp_path / "history.json").read_text()) == history
    assert not list(tmp_path.glob("*.part"))


def test_a_killed_run_ends_with_the_weights_of_an_uninterrupted_one(
    tmp_path, eager_checkpoints
):
    whole = small_model()
    optimise(whole, LineFit(whole), CONFIG, tmp_path / "whole")
    half = small_model()
    with pytest.raises(Killed):
        optimise(half, LineFit(half, killed_at=25), CONFIG, tmp_path / "killed")
    torch.manual_seed(99)
    resumed = nn.Sequential(
        nn.Linear(3, 8), nn.ReLU(), nn.Dropout(0.3), nn.Linear(8, 1)
    )
    rest = LineFit(resumed)
    history = optimise(resumed, rest, CONFIG, tmp_path / "killed")
    assert rest.steps == list(range(25, CONFIG.steps))
    for one, other in zip(resumed.parameters(), whole.parameters(), strict=True):
        assert torch.equal(one, other)
    assert history[-1]["step"] == CONFIG.steps
    assert history[0]["step"] < 25


def test_a_finished_stage_is_not_repeated(tmp_path):
    model = small_model()
    optimise(model, LineFit(model), CONFIG, tmp_path)
    again = small_model()
    fit = LineFit(again)
    optimise(again, fit, CONFIG, tmp_path)
    assert fit.steps == []
    assert torch.equal(again[0].weight, model[0].weight)


def test_what_needs_no_gradient_is_not_trained(tmp_path):
    model = small_model()
    model[0].requires_grad_(False)
    before = model[0].weight.clone()
    optimise(model, LineFit(model), CONFIG, tmp_path)
    assert torch.equal(model[0].weight, before)


def test_the_step_size_warms_up_stays_and_falls_to_a_hundredth():
    config = TrainConfig(steps=1000, learning_rate=1.0, constant_share=0.6)
    rates = [learning_rate_at(step, config) for step in range(1001)]
    assert rates[0] == pytest.approx(0.02)
    assert rates[49:601] == [1.0] * 552
    assert rates[800] == pytest.approx(1 - 0.99 / 2)
    assert rates[1000] == pytest.approx(0.01)
    assert all(a >= b for a, b in zip(rates[50:], rates[51:], strict=False))


def finished(folder) -> None:
    model = small_model()
    config = TrainConfig(steps=2)
    optimise(model, LineFit(model), config, folder)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.9])
def test_a_truncated_state_is_told(tmp_path, share):
    finished(tmp_path)
    path = tmp_path / "state.pt"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CheckpointError, match="state.pt: cannot be resumed from"):
        finished(tmp_path)


@pytest.mark.parametrize("content", [b"not a state at all", b"{}"])
def test_a_file_of_something_else_is_told(tmp_path, content):
    (tmp_path / "state.pt").write_bytes(content)
    with pytest.raises(CheckpointError, match="cannot be resumed from"):
        finished(tmp_path)


def test_a_state_of_another_stage_is_told(tmp_path):
    finished(tmp_path)
    model = small_model()
    with pytest.raises(CheckpointError, match="stage 'occupancy', expected 'joint'"):
        optimise(model, LineFit(model), TrainConfig(stage="joint"), tmp_path)


def test_a_state_of_another_model_is_told(tmp_path):
    finished(tmp_path)
    model = nn.Linear(3, 1)
    with pytest.raises(CheckpointError, match="cannot be resumed from"):
        optimise(model, LineFit(model), CONFIG, tmp_path)
