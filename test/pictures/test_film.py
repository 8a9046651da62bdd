# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from PIL import Image

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.pictures.film import MOST_FRAMES, write_film, write_strip


def frames(count):
    return [np.full((30, 40, 3), 2 * k, dtype=np.uint8) for k in range(count)]


def test_a_film_has_the_first_and_the_last_frame_and_not_too_many(tmp_path):
    write_film(frames(120), tmp_path / "a" / "film.gif", width=40)
    with Image.open(tmp_path / "a" / "film.gif") as film:
        assert film.n_frames == MOST_FRAMES
        assert film.size == (40, 30)
        assert np.asarray(film.convert("RGB")).max() < 4
        film.seek(MOST_FRAMES - 1)
        assert np.asarray(film.convert("RGB")).min() > 230


def test_a_strip_runs_row_by_row(tmp_path):
    write_strip(frames(100), tmp_path / "strip.png", columns=3, rows=2)
    sheet = np.asarray(Image.open(tmp_path / "strip.png"))
    assert sheet.shape == (60, 120, 3)
    order = sheet[[15, 45]][:, [20, 60, 100], 0].ravel().tolist()
    assert order == sorted(order)
    assert order[0] == 0
    assert order[-1] == 198


def test_a_film_of_nothing_is_refused(tmp_path):
    for write in (write_film, write_strip):
        with pytest.raises(ShapeError, match="at least one"):
            write([], tmp_path / "x.gif")
