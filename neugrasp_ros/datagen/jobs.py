# SPDX-License-Identifier: Apache-2.0
"""What a run consists of: which scene gets which kind, object set and gripper."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from neugrasp_ros.datagen.candidates import CandidateConfig
from neugrasp_ros.datagen.labels import VARIED, WITHOUT_PHYSICS, SceneJob
from neugrasp_ros.errors import ConfigError

GRIPPER_SHARES = {"panda": 0.45, "robotiq_2f85": 0.3, VARIED: 0.25}
SHAKEN, STILL = "fast_shake", "fast"  # trial presets
KIND_SHARES = {"pile": 0.6, "packed": 0.4}
STEPS = (
    0.7548776662466927,
    0.5698402909980532,
    0.41421356237309515,
    0.6180339887498949,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPlan:
    """A run of the label factory.

    Attributes:
        objects: Object sets, by name or folder. ``pile:NAME`` or ``packed:NAME`` uses
            a set in scenes of that kind only.
        kind: ``pile``, ``packed``, ``egad``, or ``mixed`` (``KIND_SHARES``).
        gripper: A name, a YAML file, ``varied`` (drawn anew for every scene), or
            ``mixed`` (``GRIPPER_SHARES``).
        n_scenes: How many scenes.
        seed: Seed of the run.
        split: Part of the object sets: ``train``, ``tune`` or ``val``.
        shake_share: Share of scenes whose lifted objects are also shaken.
        physics: Try the grasps. Without it only geometry is labelled: which grasps
            collide at once, and which parts lie between the jaws.
        candidates: Numbers and kinds of grasps a scene.
        weights: Weights file of the network that chooses the grasps; empty draws them
            on the true surface.
        count: Objects to put on the table; 0 draws their number for every scene.
    """

    objects: tuple[str, ...]
    kind: str
    gripper: str
    n_scenes: int
    seed: int
    split: str = "train"
    shake_share: float = 0.125
    physics: bool = True
    candidates: CandidateConfig = field(default_factory=CandidateConfig)
    weights: str = ""
    count: int = 0

    def __post_init__(self) -> None:
        """Check that every kind of scene has objects.

        Raises:
            ConfigError: If one has none, there is no scene to make, or the seed or
                the count is negative.
        """
        if self.n_scenes < 1:
            raise ConfigError(f"n_scenes must be positive, got {self.n_scenes}")
        if self.seed < 0:
            raise ConfigError(f"seed must be 0 or more, got {self.seed}")
        if self.count < 0:
            raise ConfigError(f"count must be 0 or more, got {self.count}")
        for kind in self.kinds():
            if not self.sets_for(kind):
                raise ConfigError(f"no object set for {kind} scenes in {self.objects}")

    def kinds(self) -> dict[str, float]:
        """Return the scene kinds of the run with their shares."""
        return KIND_SHARES if self.kind == "mixed" else {self.kind: 1.0}

    def grippers(self) -> dict[str, float]:
        """Return the grippers of the run with their shares."""
        return GRIPPER_SHARES if self.gripper == "mixed" else {self.gripper: 1.0}

    def sets_for(self, kind: str) -> tuple[str, ...]:
        """Return the object sets that scenes of a kind draw from."""
        sets = []
        for entry in self.objects:
            prefix, _, name = entry.partition(":")
            if name and prefix in ("pile", "packed", "egad"):
                sets += [name] if prefix == kind else []
            else:
                sets.append(entry)
        return tuple(sets)

    def job(self, index: int) -> SceneJob:
        """Return what scene ``index`` is; each start of a run is a balanced mix.

        Kind, set and gripper step through their shares by an additive recurrence, so
        that any stretch of scenes has nearly the shares of the whole.
        """
        u = [(step * (index + 1)) % 1.0 for step in STEPS]
        kind = _by_share(self.kinds(), u[0])
        sets = self.sets_for(kind)
        return SceneJob(
            index=index,
            seed=self.seed,
            kind=kind,
            objects=sets[int(u[1] * len(sets))],
            split=self.split,
            gripper=_by_share(self.grippers(), u[2]),
            preset=self._preset(u[3]),
            candidates=self.candidates,
            weights=self.weights,
            count=self.count,
        )

    def _preset(self, u: float) -> str:
        if not self.physics:
            return WITHOUT_PHYSICS
        return SHAKEN if u < self.shake_share else STILL

    def presets(self) -> tuple[str, ...]:
        """Return the trial presets that scenes get."""
        return (SHAKEN, STILL) if self.physics else ()

    def jobs(self, done: Sequence[int] | set[int] = ()) -> list[SceneJob]:
        """Return the jobs of all scenes but those that are done."""
        skipped = set(done)
        return [self.job(i) for i in range(self.n_scenes) if i not in skipped]


def _by_share(shares: dict[str, float], u: float) -> str:
    """Return the key whose stretch of [0, 1) holds ``u``."""
    ends = np.cumsum(list(shares.values()))
    return list(shares)[min(int((u >= ends).sum()), len(shares) - 1)]
