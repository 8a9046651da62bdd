# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run, one after the other: moving, or side by side."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from neugrasp_ros.errors import ShapeError

Frame = NDArray[np.uint8]

STAGES = ("look", "reach", "grasp", "lift", "drop")
COLORS = 256
FRAME_MS = 220
LAST_FRAME_MS = 2000
MOST_FRAMES = 90
BAND = 0.085  # of a frame's height, added below it for the caption
PAPER, QUIET, LOUD = (255, 255, 255), (178, 182, 188), (22, 60, 110)


class Shot(NamedTuple):
    """One picture of a run.

    Attributes:
        frame: The picture, shape (H, W, 3).
        stage: Of ``STAGES``, what the robot does; another word where it is none.
        tally: What was done by then, in some words.
    """

    frame: Frame
    stage: str = ""
    tally: str = ""


def write_film(shots: Sequence[Shot], path: Path, width: int = 480) -> None:
    """Write shots as a GIF that repeats; of many only some.

    Raises:
        ShapeError: If there are none.
    """
    _require_some(shots)
    chosen = [shots[k] for k in _spread(len(shots), MOST_FRAMES)]
    images = [_captioned(shot, width) for shot in chosen]
    # one palette and no dither: what stands still costs nothing
    palette = _palette(images)
    flat = [i.quantize(palette=palette, dither=Image.Dither.NONE) for i in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    flat[0].save(
        path,
        save_all=True,
        append_images=flat[1:],
        duration=[FRAME_MS] * (len(flat) - 1) + [LAST_FRAME_MS],
        loop=0,
        optimize=True,
    )


def write_strip(
    shots: Sequence[Shot], path: Path, *, columns: int = 3, rows: int = 2
) -> None:
    """Write shots as one picture, row by row: a whole attempt, and how the run ends.

    Where no attempt went through all stages, the shots are spread over the run.

    Raises:
        ShapeError: If there are none.
    """
    _require_some(shots)
    chosen = _one_attempt(shots)
    if len(chosen) + 1 == columns * rows:
        chosen.append(len(shots) - 1)
    else:
        chosen = _spread(len(shots), columns * rows)
    images = [np.asarray(_captioned(shots[k])) for k in chosen]
    height, width, _ = images[0].shape
    sheet = np.full((rows * height, columns * width, 3), 255, dtype=np.uint8)
    for k, image in enumerate(images):
        y, x = k // columns * height, k % columns * width
        sheet[y : y + height, x : x + width] = image
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(sheet).save(path, optimize=True)


def _require_some(shots: Sequence[Shot]) -> None:
    if not shots:
        raise ShapeError("shots", "at least one", (0,))


def _one_attempt(shots: Sequence[Shot]) -> list[int]:
    """Return the last shot of each stage of the first attempt that had them all.

    Returns:
        Indices, none where there is no such attempt.
    """
    found: dict[str, int] = {}
    for k, shot in enumerate(shots):
        if shot.stage == STAGES[0] and len(found) > 1:
            found = {}  # the attempt before broke off
        elif shot.stage not in STAGES and len(found) == len(STAGES):
            break
        if shot.stage in STAGES:
            found[shot.stage] = k
    return list(found.values()) if len(found) == len(STAGES) else []


def _spread(count: int, most: int) -> list[int]:
    """Return at most ``most`` indices, evenly from the first to the last."""
    if count <= most:
        return list(range(count))
    return [round(k) for k in np.linspace(0, count - 1, most)]


def _palette(images: Sequence[Image.Image]) -> Image.Image:
    """Return an image whose palette suits some images of the run."""
    some = [np.asarray(images[k]) for k in _spread(len(images), 5)]
    every = Image.fromarray(np.concatenate(some))
    # this method leaves no small bright thing without its colour
    return every.quantize(COLORS, method=Image.Quantize.FASTOCTREE)


def _captioned(shot: Shot, width: int | None = None) -> Image.Image:
    """Return a picture of a width with the stages below it, the present one dark."""
    image = Image.fromarray(np.ascontiguousarray(shot.frame))
    if width is not None and image.width != width:
        image = image.resize((width, round(image.height * width / image.width)))
    if not shot.stage and not shot.tally:
        return image
    band = round(BAND * image.height)
    sheet = Image.new("RGB", (image.width, image.height + band), PAPER)
    sheet.paste(image)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(round(0.6 * band))
    x, y = 0.02 * image.width, image.height + band // 2
    for stage in STAGES:
        color = LOUD if stage == shot.stage else QUIET
        draw.text((x, y), stage, fill=color, font=font, anchor="lm")
        x += draw.textlength(stage, font) + 0.03 * image.width
    right = 0.98 * image.width
    draw.text((right, y), shot.tally, fill=LOUD, font=font, anchor="rm")
    return sheet
