# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
from PIL import Image

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.pictures.answers import ClassAnswer, class_colors, draw_answers

DEPTH = np.full((48, 64), 0.6, dtype=np.float32)
SURFACE = np.random.default_rng(0).uniform(0.05, 0.25, (200, 3))
NOTHING = np.zeros((0, 4, 4)), np.zeros(0), 0.0


def answer_of(name: str, count: int) -> ClassAnswer:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = np.linspace(0.1, 0.2, count)[:, None]
    return ClassAnswer(name, poses, np.full(count, 0.08), 0.9)


def pixels_near(image: np.ndarray, color: tuple[float, ...]) -> int:
    difference = np.abs(image.astype(float) / 255 - np.array(color[:3]))
    return int((difference.max(axis=-1) < 0.05).sum())


def test_classes_have_colours_of_their_own():
    colors = class_colors(["a", "b", "c", "d", "e", "f", "g"])
    assert len(set(colors.values())) == 7


def test_grasps_are_drawn_in_the_colour_of_their_class(tmp_path: Path):
    names = ["cut", "pour", "wear"]
    path = tmp_path / "deep" / "answers.png"
    answers = [
        answer_of("cut", 4),
        answer_of("pour", 1),
        ClassAnswer("wear", *NOTHING, "none_with_affordance"),
    ]
    draw_answers(DEPTH, SURFACE, answers, load_gripper("panda"), path, "a title")
    image = np.asarray(Image.open(path).convert("RGB"))
    count = {n: pixels_near(image, c) for n, c in class_colors(names).items()}
    assert count["cut"] > count["pour"] > count["wear"] > 0  # its caption alone


def test_nothing_seen_can_be_drawn_too(tmp_path: Path):
    path = tmp_path / "none.png"
    answers = [ClassAnswer(str(i), *NOTHING, "timeout") for i in range(7)]
    empty = np.zeros((0, 3))
    draw_answers(DEPTH, empty, answers, load_gripper("panda"), path, "nothing")
    assert path.stat().st_size > 1000
