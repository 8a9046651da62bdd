# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from PIL import Image

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.pictures.film import (
    BAND,
    MOST_FRAMES,
    STAGES,
    Shot,
    write_film,
    write_strip,
)

HEIGHT, WIDTH = 300, 400


def gray(value):
    return np.full((HEIGHT, WIDTH, 3), value, dtype=np.uint8)


def plain(count):
    return [Shot(gray(2 * k)) for k in range(count)]


def read(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def test_a_film_has_the_first_and_the_last_frame_and_not_too_many(tmp_path):
    def darkest(film):
        return np.asarray(film.convert("L"))[5].argmin()

    bar = gray(240)
    bar[:, :20] = 10
    shots = [Shot(np.roll(bar, 3 * k, axis=1)) for k in range(120)]
    write_film(shots, tmp_path / "a" / "film.gif", width=WIDTH // 2)
    with Image.open(tmp_path / "a" / "film.gif") as film:
        assert film.n_frames == MOST_FRAMES
        assert film.size == (WIDTH // 2, HEIGHT // 2)
        assert darkest(film) < 3
        film.seek(MOST_FRAMES - 1)
        assert darkest(film) == pytest.approx(3 * 119 / 2, abs=3)


def test_what_stands_still_costs_next_to_nothing(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (90, 120, 3), dtype=np.uint8)
    one, still = Shot(noise), [Shot(noise), Shot(noise)]
    moved = noise.copy()
    moved[:8, :8] = 0
    write_film([one], tmp_path / "one.gif", width=120)
    write_film([*still, Shot(moved)], tmp_path / "three.gif", width=120)
    sizes = [(tmp_path / f"{n}.gif").stat().st_size for n in ("one", "three")]
    assert sizes[1] < 1.3 * sizes[0]


def test_a_strip_runs_row_by_row(tmp_path):
    write_strip(plain(100), tmp_path / "strip.png", columns=3, rows=2)
    sheet = read(tmp_path / "strip.png")
    assert sheet.shape == (2 * HEIGHT, 3 * WIDTH, 3)
    order = sheet[HEIGHT // 2 :: HEIGHT, WIDTH // 2 :: WIDTH, 0].ravel().tolist()
    assert order == sorted(order)
    assert order[0] == 0
    assert order[-1] == 198


def test_a_strip_shows_one_whole_attempt_and_the_end(tmp_path):
    stages = ["look", "reach", "look", "reach", "reach", "grasp", "lift", "drop",
              "drop", "home", "look", "reach"]  # fmt: skip
    shots = [Shot(gray(10 * k), s, "1 of 2") for k, s in enumerate(stages)]
    write_strip(shots, tmp_path / "strip.png")
    sheet = read(tmp_path / "strip.png")
    high = HEIGHT + round(BAND * HEIGHT)
    assert sheet.shape == (2 * high, 3 * WIDTH, 3)
    shown = sheet[HEIGHT // 2 :: high, WIDTH // 2 :: WIDTH, 0].ravel()
    assert shown.tolist() == [20, 40, 50, 60, 80, 110]


def test_the_present_stage_is_dark_below_the_picture(tmp_path):
    marked = []
    for k, stage in enumerate((*STAGES, "home")):
        write_film([Shot(gray(90), stage, "")], tmp_path / f"{k}.gif", width=WIDTH)
        picture = read(tmp_path / f"{k}.gif")
        assert (abs(picture[:HEIGHT] - 90.0) < 9).all(), "nothing is drawn over it"
        columns = np.flatnonzero((picture[HEIGHT:].sum(axis=2) < 300).any(axis=0))
        marked.append(columns.mean() if len(columns) else None)
    assert marked[-1] is None
    assert marked[:-1] == sorted(marked[:-1])


def test_a_film_of_nothing_is_refused(tmp_path):
    for write in (write_film, write_strip):
        with pytest.raises(ShapeError, match="at least one"):
            write([], tmp_path / "x.gif")
