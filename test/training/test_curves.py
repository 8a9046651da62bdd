# SPDX-License-Identifier: Apache-2.0
from matplotlib.image import imread
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from neugrasp_ros.training.curves import Curves, draw_curves

HISTORY = [
    {"step": 10.0, "quality": 0.7},
    {"step": 20.0, "quality": 0.5, "local": 0.2},
]


def test_scalars_and_a_picture_are_written(tmp_path):
    curves = Curves(tmp_path, 0)
    for means in HISTORY:
        curves.add(means, 1e-3)
    curves.close(HISTORY)
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert set(events.Tags()["scalars"]) == {
        "loss/quality", "loss/local", "learning_rate",
    }  # fmt: skip
    points = [(e.step, round(e.value, 6)) for e in events.Scalars("loss/quality")]
    assert points == [(10, 0.7), (20, 0.5)]
    assert imread(tmp_path / "curves.png").shape[:2] == (480, 840)


def test_no_history_gives_an_empty_picture(tmp_path):
    draw_curves([], tmp_path / "curves.png")
    assert (tmp_path / "curves.png").is_file()
