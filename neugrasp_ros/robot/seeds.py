# SPDX-License-Identifier: Apache-2.0
"""What is known of an arm before any question: stored postures and a reach map.

Both are found by sampling, in some seconds, and kept in the user's cache under a name
that changes with the arm and with this module's version.
"""

import hashlib
import logging
import os
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from neugrasp_ros.robot.chain import SerialChain, chain_jacobians, chain_poses
from neugrasp_ros.robot.ik import IkProblem
from neugrasp_ros.robot.postures import CELL as POSTURE_CELL
from neugrasp_ros.robot.postures import PER_CELL, PostureTable, make_table

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

VERSION = 2  # of what is stored; part of the file's name
CELL = 0.04  # [m]; wrist-centre map
SAMPLES = 1_000_000  # configurations behind the map and the stored postures
UPWARD = 0.3  # largest z of an approach that is worth a stored posture

logger = logging.getLogger(__name__)


class ArmKnowledge(NamedTuple):
    """Precomputed facts of one arm.

    Attributes:
        table: Postures to start from.
        wrist: A point fixed to the tip, in the tip frame in [m], shape (3,). With a
            spherical wrist it is the wrist centre, which orientation does not move.
        origin: Lower corner of the map in the base frame in [m], shape (3,).
        cells: Where that point can be, shape (X, Y, Z), ``CELL`` wide.
        best_manipulability: Of the samples, the 99th percentile of sqrt(det(J J^T)).
    """

    table: PostureTable
    wrist: FloatArray
    origin: FloatArray
    cells: BoolArray
    best_manipulability: FloatArray


def load_knowledge(problem: IkProblem, cache: Path | None = None) -> ArmKnowledge:
    """Return what is known of an arm, from the cache or by working it out.

    Args:
        problem: Arm, bounds and tolerances.
        cache: Folder of stored answers; default the user's cache.
    """
    folder = _cache_dir() if cache is None else cache
    path = folder / f"arm-{_fingerprint(problem)}.npz"
    if path.is_file():
        try:
            return _load(path)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            logger.warning("%s is damaged (%s); working it out again", path, error)
    knowledge = learn_arm(problem, np.random.default_rng(0))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(f".{os.getpid()}.npz")
        rest = {k: v for k, v in knowledge._asdict().items() if k != "table"}
        np.savez(partial, **knowledge.table._asdict(), **rest)
        partial.replace(path)
    except OSError as error:
        logger.warning("cannot store %s: %s", path, error)
    return knowledge


def _load(path: Path) -> ArmKnowledge:
    with np.load(path) as stored:
        table = PostureTable(**{n: stored[n] for n in PostureTable._fields})
        rest = {n: stored[n] for n in ArmKnowledge._fields if n != "table"}
    return ArmKnowledge(table=table, **rest)


def learn_arm(problem: IkProblem, rng: np.random.Generator) -> ArmKnowledge:
    """Sample an arm's reach, and keep postures from all over it.

    Args:
        problem: Arm, bounds and tolerances.
        rng: Source of the samples.
    """
    wrist = wrist_centre(problem.chain)
    samples = _draw(problem, SAMPLES, rng)
    poses = chain_poses(problem.chain, samples)
    points = poses[:, :3, :3] @ wrist + poses[:, :3, 3]
    origin = points.min(axis=0) - 2 * CELL
    shape = np.ceil((points.max(axis=0) + 2 * CELL - origin) / CELL).astype(int)
    cells = np.zeros(shape, dtype=bool)
    cells[tuple(((points - origin) / CELL).astype(int).T)] = True
    jacobians = chain_jacobians(problem.chain, samples[:5000])
    gram = jacobians @ np.swapaxes(jacobians, -1, -2)
    volume = np.sqrt(np.clip(np.linalg.det(gram), 0.0, None))
    # grasps come from above or from the side: postures need not serve the others
    useful = poses[:, 2, 0] < UPWARD
    return ArmKnowledge(
        table=make_table(samples[useful], poses[useful], wrist),
        wrist=wrist,
        origin=origin,
        cells=binary_dilation(cells),  # samples leave holes at the border
        best_manipulability=np.asarray(np.quantile(volume, 0.99)),
    )


@njit(cache=True, error_model="numpy")
def may_reach(target, wrist, origin, cells):  # type: ignore[no-untyped-def]
    """Return whether the wrist of a target lies in a cell of the reach map.

    Args:
        target: Pose ``T_base_tip``, shape (4, 4).
        wrist: The wrist in the tip frame in [m], shape (3,).
        origin: Lower corner of the map in the base frame in [m], shape (3,).
        cells: The map, shape (X, Y, Z).
    """
    first = second = third = 0
    for k in range(3):
        value = target[k, 3] - origin[k]
        for j in range(3):
            value += target[k, j] * wrist[j]
        number = int(np.floor(value / CELL))
        if number < 0 or number >= cells.shape[k]:
            return False
        first, second, third = second, third, number
    return cells[first, second, third]


def wrist_centre(chain: SerialChain) -> FloatArray:
    """Return, in the tip frame, the point where the last three axes come closest.

    Any point of the tip would do for the reach map; this one sees most.

    Returns:
        Point in [m], shape (3,).
    """
    joints = len(chain.prismatic)
    middle = (chain.lower + chain.upper) / 2
    system, right = np.zeros((3, 3)), np.zeros(3)
    for last in range(max(0, joints - 3), joints):
        # axis `last`, seen from the tip: the chain behind it, inverted
        T = np.eye(4)
        for k in range(last, joints):
            T = T @ _motion(chain, k, 0.0 if k == last else middle[k])
            T = T @ _pose(chain.rotations[k + 1], chain.offsets[k + 1])
        axis = T[2, :3]  # z of joint `last` in the tip frame
        point = -T[:3, :3].T @ T[:3, 3]
        projector = np.eye(3) - np.outer(axis, axis)
        system += projector
        right += projector @ point
    return np.asarray(np.linalg.lstsq(system, right, rcond=1e-6)[0])


def _pose(rotation: FloatArray, offset: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, offset
    return T


def _motion(chain: SerialChain, joint: int, value: float) -> FloatArray:
    T = np.eye(4)
    if chain.prismatic[joint]:
        T[2, 3] = value
    else:
        c, s = np.cos(value), np.sin(value)
        T[:2, :2] = [[c, -s], [s, c]]
    return T


def _draw(problem: IkProblem, count: int, rng: np.random.Generator) -> FloatArray:
    return rng.uniform(problem.lower, problem.upper, (count, len(problem.lower)))


def _fingerprint(problem: IkProblem) -> str:
    numbers = (VERSION, CELL, SAMPLES, POSTURE_CELL, PER_CELL, UPWARD, np.__version__)
    digest = hashlib.sha256(repr(numbers).encode())
    for array in (*problem.chain, problem.lower, problem.upper):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _cache_dir() -> Path:
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "neugrasp" / "robot"
