# SPDX-License-Identifier: Apache-2.0
"""One detection from request to report, the same for service and action."""

import time
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from neugrasp_msgs.msg import DetectionReport
from neugrasp_msgs.msg import Grasp as GraspMessage
from numpy.typing import NDArray

from neugrasp_ros.errors import NeuGraspError
from neugrasp_ros.grasp.queries import parse_query
from neugrasp_ros.nodes.conversions import to_pose, to_stamp
from neugrasp_ros.nodes.grasp_list import GraspList, Reach, joined
from neugrasp_ros.nodes.outcomes import Code, DetectionError, as_detection_error
from neugrasp_ros.nodes.pace import Pace
from neugrasp_ros.nodes.planner_stages import Box, Staged, in_box
from neugrasp_ros.nodes.requests import REACH_FIRST, REACH_LAST, Wanted
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.selection import ranked, with_query
from neugrasp_ros.nodes.settings import ServerConfig
from neugrasp_ros.nodes.waiting import Stop

FloatArray = NDArray[np.float64]

NEWEST = 0  # a stamp that means the newest transforms
AHEAD = 2  # batches on their way: messages travel while another one is scored
HINT_TIME = 3.0  # [s] that must be left to look for a place for the base
PROGRESS = {
    "fusion": 0.05,
    "rendering": 0.15,
    "sampling": 0.35,
    "quality": 0.45,
    "affordance": 0.85,
    "reachability": 0.9,
}


class Stages(Protocol):
    """The stages of the pipeline, in this process or behind services.

    Grasps are in the scene's frame. ``deadline`` is one of ``time.monotonic()``; a
    stage that needs longer raises ``DetectionError`` TIMEOUT.
    """

    def missing(self) -> list[str]:
        """Return what is not ready yet, in words."""

    def request(self) -> AbstractContextManager[None]:
        """Return what is held while a request runs."""

    def labels(self, deadline: float) -> tuple[str, ...]:
        """Return the affordance classes."""

    def require_arms(self, arms: tuple[str, ...], deadline: float) -> None:
        """Refuse planning groups that the robot does not have, naming those it has."""

    def frames(self) -> tuple[str, ...]:
        """Return the names of all known frames."""

    def scene(
        self,
        wanted: Wanted,
        newer_than: int,
        deadline: float,
        stop: Stop,
    ) -> SceneView:
        """Return a scene as fresh as wanted, newer than a time in [ns] (0 = any).

        ``stop`` ends the wait for images with ``DetectionError`` CANCELED.
        """

    def sample(
        self, view: SceneView, roi: Box | None, wanted: Wanted, deadline: float
    ) -> Staged:
        """Propose candidates."""

    def begin_scores(
        self, grasps: GraspList, view: SceneView, deadline: float
    ) -> Callable[[], Staged]:
        """Ask for candidates' scores; what is returned waits for them."""

    def check(
        self, grasps: GraspList, arms: tuple[str, ...], deadline: float
    ) -> GraspList:
        """Check grasps against the robot; none ask for the hand of the one arm."""

    def suggest_base(
        self, grasps: GraspList, arms: tuple[str, ...], deadline: float
    ) -> tuple[str, FloatArray] | None:
        """Return where the base would have to stand (4, 4) and in which frame."""

    def transform(self, target: str, source: str, stamp: int) -> FloatArray:
        """Return ``T_target_source``; raises ``DetectionError`` TF_ERROR."""


@dataclass(slots=True)
class Progress:
    """How a running detection talks to whoever asked for it.

    Attributes:
        canceled: Asked between two steps and while it waits for an image or its turn;
            True ends the detection.
        report: Told the stage, the share done and the grasps so far.
    """

    canceled: Callable[[], bool] = lambda: False
    report: Callable[[str, float, GraspList | None], None] = lambda *_: None


@dataclass(slots=True)
class Outcome:
    """A report and, perhaps, grasps."""

    report: DetectionReport = field(default_factory=DetectionReport)
    grasps: GraspList | None = None


class Detection:
    """Runs one request; use it once.

    Args:
        stages: The pipeline.
        config: The server's parameters.
        wanted: The request.
        progress: Cancel and feedback.
        newer_than: Time in [ns] that the newest depth image must be newer than.
    """

    def __init__(
        self,
        stages: Stages,
        config: ServerConfig,
        wanted: Wanted,
        progress: Progress,
        newer_than: int = 0,
    ) -> None:
        self._stages = stages
        self._config = config
        self._wanted = wanted
        self._progress = progress
        self._newer_than = newer_than
        self._start = time.monotonic()
        self._deadline = self._start + wanted.timeout
        self._outcome = Outcome()

    def run(self) -> Outcome:
        """Return what came of it; never raises an error of ours."""
        report = self._outcome.report
        try:
            self._require_ready()
            with self._stages.request():
                self._detect()
        except NeuGraspError as error:
            reason = as_detection_error(error)
            report.code, report.message = int(reason.code), reason.sentence
        report.seconds_total = float(time.monotonic() - self._start)
        return self._outcome

    def _require_ready(self) -> None:
        missing = self._stages.missing()
        if missing:
            raise DetectionError(Code.NOT_ACTIVE, "not ready: " + "; ".join(missing))

    def _detect(self) -> None:
        stages, wanted, report = self._stages, self._wanted, self._outcome.report
        query = parse_query(wanted.affordance, stages.labels(self._deadline))
        self._require_names()
        self._step("fusion")
        view = stages.scene(
            wanted, self._newer_than, self._deadline, self._progress.canceled
        )
        report.views = view.volume.view_count
        report.seconds_fusion = view.seconds
        stages.transform(wanted.frame_id, view.frame_id, NEWEST)  # or why not
        self._step("rendering")
        grasps = self._candidates(view)
        if wanted.reachability == REACH_FIRST:
            grasps = self._reachable(grasps)
        scored = with_query(self._score(grasps, view), query)
        scored = self._above(scored)
        best = ranked(scored, self._config)
        if wanted.reachability == REACH_FIRST:
            best = self._checked(best)
        self._outcome.grasps = self._answer(best)
        if wanted.reachability == REACH_LAST:
            best = self._reachable(best)
        self._outcome.grasps = self._answer(best)
        report.message = f"{len(self._outcome.grasps)} grasps"

    def _require_names(self) -> None:
        """Refuse unknown arms and frames before anything takes time.

        Raises:
            ConfigError: Naming the arms there are.
            DetectionError: TF_ERROR, naming the frames there are.
        """
        wanted, usual = self._wanted, self._config.target_frame
        if wanted.arms:
            self._stages.require_arms(wanted.arms, self._deadline)
        asked = {"frame_id": wanted.frame_id}
        if wanted.roi is not None:
            asked["roi_pose"] = wanted.roi_frame
        for name, frame in asked.items():
            if frame == usual:
                continue  # a start without it is told by the link that lacks
            known = self._stages.frames()
            if frame.removeprefix("/") not in known:
                raise DetectionError(
                    Code.TF_ERROR,
                    f"unknown frame {frame!r} in {name}; known: "
                    f"{', '.join(known) or 'none'}",
                )

    def _step(self, stage: str, best: GraspList | None = None) -> None:
        """Tell where we are; stop where that is wanted.

        Raises:
            DetectionError: CANCELED or TIMEOUT.
        """
        if self._progress.canceled():
            raise DetectionError(Code.CANCELED, f"canceled before {stage}")
        if time.monotonic() > self._deadline:
            raise DetectionError(
                Code.TIMEOUT, f"{self._wanted.timeout} s are over before {stage}"
            )
        self._progress.report(stage, PROGRESS[stage], best)

    def _note(self, seconds: dict[str, float]) -> None:
        """Add the times of a stage's parts to the report."""
        report: Any = self._outcome.report
        for name, value in seconds.items():
            key = f"seconds_{name}"
            if hasattr(report, key):
                setattr(report, key, getattr(report, key) + float(value))

    def _roi(self, view: SceneView) -> Box | None:
        roi, frame = self._wanted.roi, self._wanted.roi_frame
        if roi is None:
            return None
        T = self._stages.transform(view.frame_id, frame, view.stamp)
        return Box(T @ roi.T_frame_box, roi.size)

    def _candidates(self, view: SceneView) -> GraspList:
        """Sample where the request says; keep what holds the target of its mask."""
        wanted, report = self._wanted, self._outcome.report
        region = roi = self._roi(view)
        T_frame_camera = np.eye(4)
        if (target := wanted.target) is not None:
            T_frame_camera = self._stages.transform(
                view.frame_id, target.camera.frame_id, target.stamp or view.stamp
            )
            region = target.region(view, T_frame_camera, roi)
        staged = self._stages.sample(view, region, wanted, self._deadline)
        self._note(staged.seconds)
        grasps = staged.grasps
        report.sampled, why = staged.sampled, "on the surface seen"
        if target is not None:
            within = in_box(grasps.grasps.poses[:, :3, 3], roi)
            grasps = grasps.take(within & target.held_by(grasps, T_frame_camera))
            why = f"that holds what the mask covers, of {report.sampled} near it"
        report.after_filters = len(grasps)
        if not len(grasps):
            raise DetectionError(
                Code.NO_CANDIDATES,
                f"the sampler found no collision-free hand pose {why}",
            )
        return grasps

    def _score(self, grasps: GraspList, view: SceneView) -> GraspList:
        """Score batch by batch, so that cancel and budget are seen in time."""
        budget = self._wanted.budget
        pace = Pace(self._start + budget if budget else None)
        ahead = 1 if budget else AHEAD
        begun: deque[Callable[[], Staged]] = deque()
        done: list[GraspList] = []
        start = 0
        while True:
            while len(begun) < ahead and start < len(grasps):
                count = pace.next(len(grasps) - start)
                if not count:
                    break
                some = grasps.take(np.arange(start, start + count))
                begun.append(self._stages.begin_scores(some, view, self._deadline))
                start += count
            if not begun:
                break
            self._step("quality")
            staged = begun.popleft()()
            self._note(staged.seconds)
            done.append(staged.grasps)
        self._outcome.report.budget_spent = start < len(grasps)
        return joined(done)

    def _above(self, scored: GraspList) -> GraspList:
        """Keep what is good enough; say which threshold left nothing."""
        wanted, report = self._wanted, self._outcome.report
        quality = np.nan_to_num(scored.grasps.quality, nan=-1.0)
        good = scored.take(quality >= wanted.min_quality)
        report.after_quality = len(good)
        if not len(good):
            raise DetectionError(
                Code.NONE_ABOVE_QUALITY,
                f"the best of {len(scored)} candidates has quality "
                f"{quality.max():.2f}, asked for {wanted.min_quality:.2f}",
            )
        self._step("affordance")
        if scored.info.query:
            best = float(good.affordance.max())
            good = good.take(good.affordance >= wanted.min_affordance)
            if not len(good):
                raise DetectionError(
                    Code.NONE_WITH_AFFORDANCE,
                    f"the best of {report.after_quality} good grasps (of "
                    f"{len(scored)} candidates) affords {scored.info.query!r} with "
                    f"{best:.2f}, asked for {wanted.min_affordance:.2f}",
                )
        report.after_affordance = len(good)
        return good

    def _reachable(self, grasps: GraspList) -> GraspList:
        """Keep what the robot reaches; say why where nothing is left."""
        self._step("reachability", grasps)
        start = time.perf_counter()
        checked = self._stages.check(grasps, self._wanted.arms, self._deadline)
        self._note({"reachability": time.perf_counter() - start})
        codes = (checked.reach or Reach.unknown(len(checked))).codes
        kept = checked.take(codes == GraspMessage.REACH_OK)
        self._outcome.report.after_reachability = len(kept)
        if not len(kept):
            self._outcome.grasps = None
            self._hint(grasps)
            raise DetectionError(
                Code.NONE_REACHABLE,
                f"none of {len(grasps)} grasps can be reached: {reasons(codes)}",
            )
        return kept

    def _checked(self, best: GraspList) -> GraspList:
        """Say that grasps were checked before they were scored, and whose is the first.

        The check named the hand of what came first then.
        """
        arms = best.reach.arms[:1] if best.reach else ()
        nothing = best.take(np.arange(0))
        info = self._stages.check(nothing, arms, self._deadline).info
        named = replace(best.info, stage=info.stage, tcp_frame=info.tcp_frame)
        return replace(best, info=named)

    def _hint(self, grasps: GraspList) -> None:
        """Say where the base would have to stand, if there is time to find out."""
        if time.monotonic() > self._deadline - HINT_TIME:
            return
        wanted = self._wanted
        found = self._stages.suggest_base(grasps, wanted.arms, self._deadline)
        if found is not None:
            place = self._outcome.report.suggested_base
            place.header.frame_id, T = found
            place.header.stamp = to_stamp(grasps.info.stamp)
            place.pose = to_pose(T)

    def _answer(self, grasps: GraspList) -> GraspList:
        grasps = grasps.take(np.arange(min(self._wanted.max_grasps, len(grasps))))
        target, info = self._wanted.frame_id, grasps.info
        if target == info.frame_id:
            return grasps
        T = self._stages.transform(target, info.frame_id, info.stamp)
        return grasps.moved(T, target)


def reasons(codes: NDArray[np.uint8]) -> str:
    """Return how often each reachability code came, in words."""
    names = {
        getattr(GraspMessage, name): name.removeprefix("REACH_").lower()
        for name in dir(GraspMessage)
        if name.startswith("REACH_")
    }
    values, counts = np.unique(codes, return_counts=True)
    return ", ".join(
        f"{count} {names.get(int(value), value)}"
        for value, count in zip(values, counts, strict=True)
    )
