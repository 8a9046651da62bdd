# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run, one after the other: moving, or side by side."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from neugrasp_ros.errors import ShapeError

Frame = NDArray[np.uint8]

COLORS = 64
FRAME_MS = 220
LAST_FRAME_MS = 2000
MOST_FRAMES = 90


def write_film(frames: Sequence[Frame], path: Path, width: int = 480) -> None:
    """Write frames (H, W, 3) as a GIF that repeats; of many frames only some.

    Raises:
        ShapeError: If there are no frames.
    """
    if not frames:
        raise ShapeError("frames", "at least one", (0,))
    images = [_resized(frames[k], width) for k in _spread(len(frames), MOST_FRAMES)]
    images = [image.quantize(COLORS) for image in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    images[0].save(
        path,
        save_all=True,
        append_images=images[1:],
        duration=[FRAME_MS] * (len(images) - 1) + [LAST_FRAME_MS],
        loop=0,
        optimize=True,
    )


def write_strip(
    frames: Sequence[Frame], path: Path, *, columns: int = 4, rows: int = 2
) -> None:
    """Write frames spread over the run as one picture, row by row.

    Raises:
        ShapeError: If there are no frames.
    """
    if not frames:
        raise ShapeError("frames", "at least one", (0,))
    chosen = [frames[k] for k in _spread(len(frames), columns * rows)]
    height, width, _ = chosen[0].shape
    sheet = np.full((rows * height, columns * width, 3), 255, dtype=np.uint8)
    for k, frame in enumerate(chosen):
        y, x = k // columns * height, k % columns * width
        sheet[y : y + height, x : x + width] = frame
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(sheet).save(path)


def _spread(count: int, most: int) -> list[int]:
    """Return at most ``most`` indices, evenly from the first to the last."""
    if count <= most:
        return list(range(count))
    return [round(k) for k in np.linspace(0, count - 1, most)]


def _resized(frame: Frame, width: int) -> Image.Image:
    image = Image.fromarray(np.ascontiguousarray(frame))
    if image.width == width:
        return image
    return image.resize((width, round(image.height * width / image.width)))
