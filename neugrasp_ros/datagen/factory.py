# SPDX-License-Identifier: Apache-2.0
"""The label factory: run a plan, write shards, go on where it was left.

In: a ``RunPlan``. Out: a folder of shards, a line per lost scene in ``skipped.log``.
What a scene becomes depends on the plan's seed and the scene's number alone, whatever
the number of workers or interruptions.
"""

import errno
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import MISSING, asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from neugrasp_ros.datagen.jobs import RunPlan
from neugrasp_ros.datagen.labels import (
    REASONS,
    SceneJob,
    SceneLabels,
    label_scene,
)
from neugrasp_ros.datagen.pool import Outcome, run_dask, run_local
from neugrasp_ros.datagen.shards import done_indices, next_shard_path, write_shard
from neugrasp_ros.errors import ConfigError, ShardError
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.model import file_sha256
from sim_bridge.trial import trial_config

SHARD_SCENES = 100  # about 200 kB, rewritten whenever a scene is added
PLAN_FILE = "plan.json"
SKIPPED_FILE = "skipped.log"


@dataclass
class Progress:
    """Counts of a run since it was started or resumed.

    Attributes:
        n_scenes: Scenes of the plan.
        n_done: Scenes labelled, those of earlier runs included.
        n_labels: Grasps labelled since the start.
        n_trials: Of these, how many went through physics.
        n_positive: Successes among them.
        n_side: Side grasps among the labels.
        reasons: How often each reason was given.
        skipped: What was lost and why, since the start.
        seconds: Since the start.
    """

    n_scenes: int
    n_done: int = 0
    n_labels: int = 0
    n_trials: int = 0
    n_positive: int = 0
    n_side: int = 0
    reasons: dict[str, int] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    seconds: float = 0.0
    _n_before: int = 0

    def add(self, labels: SceneLabels) -> None:
        """Count a labelled scene."""
        grasps = labels.grasps
        self.n_done += 1
        self.n_labels += len(grasps)
        self.n_trials += int(grasps.tried.sum())
        self.n_positive += int(grasps.labels.sum())
        self.n_side += int(grasps.side().sum())
        for code in grasps.reasons:
            reason = REASONS[code]
            self.reasons[reason] = self.reasons.get(reason, 0) + 1

    def figures(self) -> dict[str, float]:
        """Return counts and rates since the start, of a run that may still go on."""
        hours = max(self.seconds, 1e-6) / 3600
        return {
            "scenes_of_plan": self.n_scenes,
            "scenes_before": self._n_before,
            "scenes": self.n_done - self._n_before,
            "labels": self.n_labels,
            "trials": self.n_trials,
            "positive": self.n_positive,
            "side": self.n_side,
            "skipped": len(self.skipped),
            "seconds": round(self.seconds, 1),
            "trials_per_hour": round(self.n_trials / hours),
            "labels_per_hour": round(self.n_labels / hours),
        }

    def line(self) -> str:
        """Return rate, shares and the time that is left, in one line."""
        rates = self.figures()
        new = self.n_done - self._n_before
        left = self.n_scenes - self.n_done - len(self.skipped)
        eta = left * self.seconds / 60 / max(new, 1)
        labels = max(self.n_labels, 1)
        trials = (
            f"{self.n_trials} trials ({rates['trials_per_hour']}/h), "
            f"{100 * self.n_positive / max(self.n_trials, 1):.1f} % of trials and "
            f"{100 * self.n_positive / labels:.1f} % of labels positive, "
        )
        return (
            f"{self.n_done}/{self.n_scenes} scenes, {self.n_labels} labels "
            f"({rates['labels_per_hour']}/h), {trials if self.n_trials else ''}"
            f"{100 * self.n_side / labels:.1f} % side, "
            f"{len(self.skipped)} skipped, ETA {eta:.0f} min"
        )


def run_factory(
    plan: RunPlan,
    folder: str | Path,
    *,
    n_workers: int = 1,
    dask_address: str | None = None,
    report: Callable[[Progress], None] | None = None,
    work: Callable[[SceneJob], SceneLabels] = label_scene,
) -> Progress:
    """Label the scenes of a plan that a folder does not hold yet.

    Args:
        plan: What to make.
        folder: Where to; made if it is missing.
        n_workers: Processes on this machine.
        dask_address: Scheduler of a Dask cluster to use instead.
        report: Called after every scene.
        work: What labels a scene; a function that processes can import by its name.

    Returns:
        The counts at the end.

    Raises:
        ConfigError: If the folder was begun with another plan.
        ShardError: If a shard in the folder is damaged, or the disk is full; what was
            written before stays valid, and the same command goes on.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    _check_plan(plan, folder)
    done = done_indices(folder)
    jobs = plan.jobs(done)
    progress = Progress(plan.n_scenes, n_done=len(done), _n_before=len(done))
    if dask_address is None:
        outcomes = run_local(work, jobs, n_workers)
    else:
        outcomes = run_dask(work, jobs, dask_address)
    _store(outcomes, folder, progress, report)
    return progress


def _store(
    outcomes: Iterator[Outcome],
    folder: Path,
    progress: Progress,
    report: Callable[[Progress], None] | None,
) -> None:
    """Write every scene as it comes: the last shard grows until it is full."""
    start = time.monotonic()
    path = next_shard_path(folder)
    held: list[SceneLabels] = []
    for outcome in outcomes:
        progress.seconds = time.monotonic() - start
        if outcome.error:
            _skip(outcome, folder, progress)
        else:
            held.append(outcome.result)
            _write(path, held)
            progress.add(outcome.result)
        if len(held) >= SHARD_SCENES:
            path, held = next_shard_path(folder), []
        if report is not None:
            report(progress)


def _write(path: Path, scenes: list[SceneLabels]) -> None:
    try:
        write_shard(path, scenes)
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        raise ShardError(
            f"{path}: {'the disk is full' if full else error}; scene "
            f"{scenes[-1].index} was not written, all before it are: make room and "
            "start again"
        ) from error


def _skip(outcome: Outcome, folder: Path, progress: Progress) -> None:
    line = f"{outcome.job.describe()}: {outcome.error}"
    progress.skipped.append(line)
    with (folder / SKIPPED_FILE).open("a") as file:
        file.write(line + "\n")


def _check_plan(plan: RunPlan, folder: Path) -> None:
    """Keep the plan, and how grasps are tried, beside the shards: one for all."""
    path = folder / PLAN_FILE
    trials = {name: asdict(trial_config(name)) for name in plan.presets()}
    record = json.loads(json.dumps({**asdict(plan), "trials": trials}))
    if plan.weights:  # what is in the file, wherever it lies
        record["weights"] = file_sha256(Path(plan.weights))
    if Path(plan.gripper).suffix:  # a file, which may change
        record["gripper"] = repr(load_gripper(plan.gripper))
    if path.is_file():
        before = json.loads(path.read_text())
        if "trials" not in before and plan.physics:
            raise ConfigError(
                f"{path} does not say how its grasps were tried: take a new folder"
            )
        missing = {
            item.name: item.default
            for item in fields(RunPlan)
            if item.default is not MISSING
        }
        before = _flat({"trials": {}, **missing, **before})
        changed = {
            key: (before.get(key), value)
            for key, value in _flat(record).items()
            if key != "n_scenes" and before.get(key) != value
        }
        if changed:
            raise ConfigError(f"{folder} was begun with another plan: {changed}")
    path.write_text(json.dumps(record, indent=2) + "\n")


def _flat(record: dict[str, Any], under: str = "") -> dict[str, Any]:
    """Return a nested record by dotted names."""
    flat: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, dict) and value:
            flat |= _flat(value, f"{under}{key}.")
        else:
            flat[under + key] = value
    return flat
