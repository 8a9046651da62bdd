# SPDX-License-Identifier: Apache-2.0
"""The surface as the two fingers and the palm of a grasp would see it.

In: an occupancy field and grasps. Out: a fixed number of surface points per grasp, in
the gripper's own frame.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.grid import (
    ScalarGrid,
    clip_to_box,
    march_one,
    normal_one,
    run_in_parts,
)
from neugrasp_ros.geometry.gripper import Gripper

FloatArray = NDArray[np.float64]

PALM_MARGIN = 0.015  # [m], seen beyond the open pads by the palm camera
FINGER_MARGIN = 0.005  # [m], seen beyond the finger's ends by a finger camera
CROP_AHEAD = 0.005  # [m], kept beyond the pad tips
CROP_THICKNESS = 0.032  # [m], kept to either side along x
FULL_SIZE = 64  # [pixel], rows and columns of the paper's cameras


class LocalViews(NamedTuple):
    """Local surfaces of G grasps.

    Attributes:
        points: In the gripper frame in [m], shape (G, P, 3); where fewer than P rays
            met a surface their points repeat; zero where none did.
        normals: Outward unit normals in the gripper frame, shape (G, P, 3).
        hits: How many distinct points there are, shape (G,).
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    hits: NDArray[np.int32]


def local_rays(
    gripper: Gripper, image_size: int, fov: float
) -> tuple[FloatArray, FloatArray]:
    """Return the rays of the three cameras in the gripper frame.

    The palm camera stands behind the palm plane and sees the open jaws and 1.5 cm to
    either side; the finger cameras stand outside the pads and see their full length
    (method sheet, b9), with true fields of view.

    Args:
        gripper: The gripper.
        image_size: Rows and columns of each camera [pixel].
        fov: Field of view in [rad].

    Returns:
        Origins and unit directions, shapes (R, 3), R = 3 * image_size^2.
    """
    depth, half_opening = gripper.finger_depth, gripper.max_opening / 2
    slope = np.tan(fov / 2)
    palm_eye = [0.0, 0.0, -depth - (half_opening + PALM_MARGIN) / slope]
    aside = half_opening + (depth / 2 + FINGER_MARGIN) / slope
    eyes = [palm_eye, [0.0, aside, -depth / 2], [0.0, -aside, -depth / 2]]
    forwards = np.array([[0.0, 0, 1], [0, -1, 0], [0, 1, 0]])
    rights = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 1]])
    ticks = (np.arange(image_size) + 0.5) / image_size * 2 - 1
    u, v = (t.ravel()[:, None] * slope for t in np.meshgrid(ticks, ticks))
    up = np.array([1.0, 0, 0])
    directions = np.concatenate(
        [f + u * r + v * up for f, r in zip(forwards, rights, strict=True)]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.repeat(np.array(eyes), image_size**2, axis=0), directions


def crop_box(gripper: Gripper, fov: float) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of the kept region in the gripper frame."""
    half = gripper.max_opening / 2
    behind = gripper.finger_depth + (half + PALM_MARGIN) / np.tan(fov / 2)
    lateral = half + gripper.finger_width + PALM_MARGIN
    upper = np.array([CROP_THICKNESS, lateral, CROP_AHEAD])
    return np.array([-CROP_THICKNESS, -lateral, -behind]), upper


@lru_cache(maxsize=16)
def _sampled_rays(
    gripper: Gripper, image_size: int, fov: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an even sample of the paper's rays in one fixed random order.

    Returns:
        Origins and directions of those that enter the kept region, shapes (R, 3), and
        where along them it begins and ends, in [m], shape (R, 2).
    """
    full_size = max(FULL_SIZE, image_size)
    origins, directions = local_rays(gripper, full_size, fov)
    pixels = sampled_pixels(full_size, image_size)
    origins, directions = origins[pixels], directions[pixels]
    low, high = crop_box(gripper, fov)
    spans = np.array(
        [
            clip_to_box(ox, oy, oz, dx, dy, dz, low, high)
            for (ox, oy, oz), (dx, dy, dz) in zip(origins, directions, strict=True)
        ]
    )
    enter = spans[:, 0] < spans[:, 1]
    return origins[enter], directions[enter], spans[enter]


def sampled_pixels(full_size: int, kept_size: int) -> NDArray[np.int64]:
    """Return the pixels of large images nearest to those of small ones.

    Args:
        full_size: Rows and columns of the large images [pixel].
        kept_size: The same of the small ones.

    Returns:
        Indices into the rays of three images, shape (3 * kept_size^2,), in one fixed
        random order: the first ones are a sample. They mirror into each other where
        both sizes are even.
    """
    ticks = ((np.arange(kept_size) + 0.5) / kept_size * full_size).astype(np.int64)
    second = np.arange(kept_size) >= kept_size / 2
    ticks[second] = full_size - 1 - ticks[::-1][second]
    image = (ticks[:, None] * full_size + ticks).ravel()
    pixels = np.concatenate([image + camera * full_size**2 for camera in range(3)])
    return np.asarray(np.random.default_rng(0).permutation(pixels))


def render_local_views(
    field: ScalarGrid,
    T_task_grippers: FloatArray,
    gripper: Gripper,
    *,
    n_points: int,
    image_size: int,
    fov: float,
    threads: int = 1,
) -> LocalViews:
    """Render the local surface of every grasp.

    Rays are cast in a fixed random order until ``n_points`` have met a surface inside
    the crop region; rays that never enter it cost nothing.

    Args:
        field: Occupancy logits, positive inside, in the task frame.
        T_task_grippers: Grasp poses, shape (G, 4, 4).
        gripper: The gripper.
        n_points: Points per grasp, P.
        image_size: Each camera casts this many rows and columns of rays, taken evenly
            from the paper's 64.
        fov: Field of view of the cameras in [rad].
        threads: Worker threads.

    Raises:
        ShapeError: If the poses are not (G, 4, 4).
    """
    poses = np.ascontiguousarray(T_task_grippers, dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ShapeError("T_task_grippers", "(G, 4, 4)", poses.shape)
    origins, directions, spans = _sampled_rays(gripper, image_size, fov)
    gaps = field.gaps
    points = np.zeros((len(poses), n_points, 3), dtype=np.float32)
    normals = np.zeros_like(points)
    hits = np.zeros(len(poses), dtype=np.int32)

    def run(part: slice) -> None:
        _render(
            field.values,
            gaps,
            1.0 / field.spacing,
            field.reach,
            poses[part],
            origins,
            directions,
            spans,
            points[part],
            normals[part],
            hits[part],
        )

    run_in_parts(run, len(poses), threads)
    return LocalViews(points, normals, hits)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _render(  # type: ignore[no-untyped-def]  # noqa: PLR0913 (a numba kernel)
    values, gaps, inverse, reach, poses, origins, directions, spans, points, normals,
    hits,
):  # fmt: skip  # pragma: no cover - compiled
    n_points = points.shape[1]
    step = 0.5 / inverse
    cube_low = np.zeros(3)
    cube_high = np.array(values.shape) / inverse
    normal = np.zeros(3)
    for g in range(len(poses)):
        xx, xy, xz, x0 = poses[g, 0, 0], poses[g, 0, 1], poses[g, 0, 2], poses[g, 0, 3]
        yx, yy, yz, y0 = poses[g, 1, 0], poses[g, 1, 1], poses[g, 1, 2], poses[g, 1, 3]
        zx, zy, zz, z0 = poses[g, 2, 0], poses[g, 2, 1], poses[g, 2, 2], poses[g, 2, 3]
        count = 0
        for r in range(len(origins)):  # no slices here: each would count a reference
            a, b, c = origins[r, 0], origins[r, 1], origins[r, 2]
            p, q, s = directions[r, 0], directions[r, 1], directions[r, 2]
            ox = xx * a + xy * b + xz * c + x0
            oy = yx * a + yy * b + yz * c + y0
            oz = zx * a + zy * b + zz * c + z0
            dx = xx * p + xy * q + xz * s
            dy = yx * p + yy * q + yz * s
            dz = zx * p + zy * q + zz * s
            first, last = clip_to_box(ox, oy, oz, dx, dy, dz, cube_low, cube_high)
            start, end = max(spans[r, 0], first), min(spans[r, 1], last)
            if start >= end:
                continue
            t = march_one(
                values, gaps, inverse, ox, oy, oz, dx, dy, dz, start, end, step
            )
            if t < 0:
                continue
            points[g, count, 0] = a + t * p
            points[g, count, 1] = b + t * q
            points[g, count, 2] = c + t * s
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            normal_one(values, inverse, reach, x, y, z, normal)
            u, v, w = normal
            normals[g, count, 0] = xx * u + yx * v + zx * w
            normals[g, count, 1] = xy * u + yy * v + zy * w
            normals[g, count, 2] = xz * u + yz * v + zz * w
            count += 1
            if count == n_points:
                break
        hits[g] = count
        for i in range(count, n_points):
            if count > 0:
                points[g, i] = points[g, i % count]
                normals[g, i] = normals[g, i % count]
