# SPDX-License-Identifier: Apache-2.0
"""Depth messages in, scenes out: what ``tsdf_fusion`` knows, without its topics."""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image

from neugrasp_ros.errors import ConfigError, DepthImageError, EmptySceneError
from neugrasp_ros.fusion.tsdf import TsdfVolume, empty_volume, integrate
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.transform import invert, make_transform
from neugrasp_ros.nodes.compat.images import read_depth, read_intrinsics
from neugrasp_ros.nodes.compat.tf import TransformException
from neugrasp_ros.nodes.conversions import from_stamp
from neugrasp_ros.nodes.depth_views import clean, has_moved, workspace_around
from neugrasp_ros.nodes.outcomes import Code, DetectionError
from neugrasp_ros.nodes.params import LiveConfig
from neugrasp_ros.nodes.scene_file import SavedScene
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.settings import FusionConfig, WorkspaceConfig
from neugrasp_ros.nodes.waiting import WAKE_PERIOD, Stop, never

FloatArray = NDArray[np.float64]
Lookup = Callable[[str, str, int], FloatArray]

RATE_SLACK = 0.7  # an image this share of a period after the last is not too early
JUMP_BACK = 10**9  # [ns]; stamps that fall by more belong to a new run
COUNTS = ("received", "fused", "skipped", "no_tf", "refused")


def workspace_pose(workspace: WorkspaceConfig) -> FloatArray:
    """Return the pose of the task frame in the workspace's frame, shape (4, 4)."""
    rotation = Rotation.from_euler("xyz", workspace.rpy).as_matrix()
    return make_transform(rotation, np.array(workspace.origin))


class DepthView(NamedTuple):
    """A cleaned image in [m] (H, W), its camera, and ``T_task_camera`` (4, 4)."""

    depth: NDArray[np.float32]
    intrinsics: Intrinsics
    T_task_camera: FloatArray


class DepthFusion:
    """Fuses depth images and says why it cannot.

    Callbacks may come from any thread.

    Args:
        config: Live configuration.
        lookup: ``(target, source, stamp in [ns]) -> T_target_source``; raises
            ``TransformException``.
        now: Returns the node's time in [ns].
        steady: Returns a time in [s] by which an image waits for its transform: how
            fast simulated time goes does not make messages come sooner.
    """

    def __init__(
        self,
        config: LiveConfig[FusionConfig],
        lookup: Lookup,
        now: Callable[[], int],
        steady: Callable[[], float] = time.monotonic,
    ) -> None:
        self._config = config
        self._lookup = lookup
        self._now, self._steady = now, steady
        self._changed = threading.Condition(threading.RLock())
        self._camera: Intrinsics | None = None
        self._no_camera = ""  # why the camera info that came is of no use
        self._pending: deque[tuple[Image, float]] = deque()  # and when it came [s]
        self._problem: DetectionError | None = None
        self._newest = 0  # stamp of the newest image that came [ns]
        self._taken = 0  # and of the newest that was not too early [ns]
        self._revision = time.time_ns() // 10**6  # differs from an earlier run's
        self.counts = dict.fromkeys(COUNTS, 0)
        # what was configured, and what was found in an image instead
        self._found: tuple[WorkspaceConfig, WorkspaceConfig] | None = None
        self._clear()

    @property
    def _wanted(self) -> WorkspaceConfig:
        """The workspace of the next image: the configured one, or that found for it."""
        configured, found = self._config.current.workspace, self._found
        return found[1] if found and found[0] == configured else configured

    def _empty(self) -> TsdfVolume:
        config, workspace = self._config.current, self._wanted
        shape = workspace.voxels(config.voxel_size)
        return empty_volume(
            shape, shape[0] * config.voxel_size, config.truncation_voxels
        )

    def _clear(self) -> None:
        self._volume = self._empty()
        self._workspace = self._wanted
        self._T_frame_camera: FloatArray | None = None  # of the last view fused
        self._loaded = False  # the volume came from a file and no image since
        self._stamp = 0  # of the newest image in the volume [ns]
        self._seconds = 0.0
        self._valid_share = 0.0
        self._revision += 1

    def reset(self) -> None:
        """Forget the scene, and a workspace that was found; the revision goes on."""
        with self._changed:
            self._found = None
            self._clear()
            self._pending.clear()
            self._changed.notify_all()

    def forget(self) -> None:
        """Forget the scene and every stamp, after time has jumped back."""
        with self._changed:
            self.reset()
            self._newest = self._taken = 0
            self._problem = None

    def saved(self) -> SavedScene:
        """Return the scene now, however old, as it goes into a file.

        Raises:
            DetectionError: If no image was fused.
        """
        with self._changed:
            if not self._volume.view_count:
                raise DetectionError(
                    Code.NO_DEPTH, "nothing to save: no depth image was fused yet"
                )
            return SavedScene(self._volume, self._workspace, self._stamp)

    def load(self, scene: SavedScene) -> None:
        """Show a scene of a file as if it had been seen now, until the next image.

        Whoever loads it says that it is so: as long as no images are taken it does not
        age, and its stamp is 0.
        """
        with self._changed:
            self.reset()
            self._volume, self._workspace = scene.volume, scene.workspace
            self._stamp, self._loaded = self._now(), True
            self._problem = None

    def on_camera_info(self, info: CameraInfo) -> None:
        """Take the camera's intrinsics."""
        try:
            camera = read_intrinsics(info)
        except ConfigError as error:
            with self._changed:
                self._camera, self._no_camera = None, str(error)
            return
        with self._changed:
            self._camera = camera

    def on_depth(self, image: Image) -> bool:
        """Take a depth image; tell whether the volume has changed."""
        with self._changed:
            self.counts["received"] += 1
            stamp, config = from_stamp(image.header.stamp), self._config.current
            if stamp < self._newest - JUMP_BACK:
                self.forget()
            self._newest = max(self._newest, stamp)
            period = 1e9 / config.max_rate
            early = 0 < stamp - self._taken < RATE_SLACK * period
            if not config.integrating or early:
                return False
            self._taken = stamp
            if self._camera is None:
                return self._refuse(
                    DetectionError(
                        Code.NO_CAMERA_INFO,
                        self._no_camera or "no depth/camera_info has come yet",
                    )
                )
            self._pending.append((image, self._steady()))
            while len(self._pending) > config.tf_queue:
                self._drop()
            return self.retry()

    def retry(self) -> bool:
        """Fuse the images whose transform is there; tell whether one was."""
        changed = False
        with self._changed:
            camera = self._camera
            while self._pending and camera is not None:
                image, came = self._pending[0]
                stamp = from_stamp(image.header.stamp)
                frame = self._config.current.workspace.frame
                try:
                    T_frame_camera = self._lookup(frame, image.header.frame_id, stamp)
                except TransformException as error:
                    self._problem = DetectionError(
                        Code.TF_ERROR, f"{frame} <- {image.header.frame_id}: {error}"
                    )
                    waited = self._steady() - came
                    if waited <= self._config.current.tf_timeout:
                        break
                    self._drop()
                    continue
                self._pending.popleft()
                changed |= self._fuse(image, T_frame_camera, camera)
        return changed

    def _drop(self) -> None:
        self._pending.popleft()
        self.counts["no_tf"] += 1

    def _refuse(self, problem: DetectionError) -> bool:
        with self._changed:
            self._problem = problem
            self.counts["refused"] += 1
        return False

    def _fuse(
        self, image: Image, T_frame_camera: FloatArray, camera: Intrinsics
    ) -> bool:
        try:
            depth = clean(read_depth(image), self._config.current)
        except DepthImageError as error:
            return self._refuse(DetectionError(Code.NO_DEPTH, f"depth/image: {error}"))
        size = (camera.height, camera.width)
        if depth.shape != size:
            return self._refuse(
                DetectionError(
                    Code.NO_CAMERA_INFO,
                    f"depth/image is {image.width}x{image.height}, but "
                    f"depth/camera_info says {size[1]}x{size[0]}",
                )
            )
        stamp = from_stamp(image.header.stamp)
        if self._adds_nothing(T_frame_camera):
            return self._skip(stamp)
        try:
            self._find(depth, camera, T_frame_camera)
        except EmptySceneError as error:
            return self._refuse(DetectionError(Code.EMPTY_WORKSPACE, str(error)))
        self._problem = None
        self._valid_share = float(np.isfinite(depth).mean())
        T_task_camera = invert(workspace_pose(self._wanted)) @ T_frame_camera
        shot = DepthView(depth, camera, T_task_camera)
        changed = self._integrate(shot, stamp)
        self._T_frame_camera = T_frame_camera.copy()
        return changed

    def _find(
        self, depth: NDArray[np.float32], camera: Intrinsics, T_frame_camera: FloatArray
    ) -> None:
        """Find the workspace in an image, where that is wanted and not done yet."""
        config = self._config.current
        configured = config.workspace
        if not configured.find or self._wanted is not configured:
            return
        found = workspace_around(depth, camera, T_frame_camera, config)
        self._found = (configured, found)

    def _adds_nothing(self, T_frame_camera: FloatArray) -> bool:
        """Tell whether views are fused and this one is from the last one's place."""
        config, last = self._config.current, self._T_frame_camera
        if config.view_mode != "fuse" or not config.min_motion or last is None:
            return False
        if self._wanted != self._workspace:
            return False
        return not has_moved(last, T_frame_camera, config)

    def _skip(self, stamp: int) -> bool:
        """Take the scene for what is seen now, without fusing."""
        self.counts["skipped"] += 1
        self._problem = None
        self._stamp = max(self._stamp, stamp)
        self._changed.notify_all()
        return False

    def _integrate(self, shot: DepthView, stamp: int) -> bool:
        config, start = self._config.current, time.perf_counter()
        shape = self._wanted.voxels(config.voxel_size)
        if self._wanted != self._workspace or self._volume.distances.shape != shape:
            self._clear()
        if self._loaded:
            self._loaded, self._stamp = False, 0
        fuse = config.view_mode == "fuse"
        before = self._volume if fuse else self._empty()
        after = integrate(before, *shot, decay=fuse)
        if fuse:
            weights = np.minimum(after.weights, np.uint8(config.max_weight))
            after = replace(after, weights=weights)
        changed = not np.array_equal(
            after.distances, self._volume.distances, equal_nan=True
        )
        self._seconds = time.perf_counter() - start
        self._stamp = max(self._stamp, stamp)
        self.counts["fused"] += 1
        self._volume = after
        self._revision += changed
        self._changed.notify_all()
        return changed

    @property
    def newest(self) -> int:
        """Stamp of the newest image that came, in [ns]."""
        return self._newest

    @property
    def revision(self) -> int:
        """Revision of the volume now."""
        return self._revision

    def view(self) -> SceneView:
        """Return the scene now.

        Raises:
            DetectionError: Saying why there is none: no depth, no camera info, no
                transform, or depth that is too old.
        """
        with self._changed:
            self._require_fresh()
            return SceneView(
                volume=self._volume,
                T_frame_task=workspace_pose(self._workspace),
                frame_id=self._workspace.frame,
                stamp=0 if self._shows_file else self._stamp,
                revision=self._revision,
                seconds=self._seconds,
            )

    @property
    def _shows_file(self) -> bool:
        """Whether a loaded scene stands for what is seen: no images are taken."""
        return self._loaded and not self._config.current.integrating

    def _require_fresh(self) -> None:
        config = self._config.current
        age = (self._now() - self._stamp) / 1e9
        limit = config.max_depth_age
        fresh = self._stamp and not (limit and age > limit)
        if fresh or self._loaded:
            return
        if self._problem is not None:
            raise self._problem
        if not self.counts["received"]:
            raise DetectionError(Code.NO_DEPTH, "no depth/image since the node started")
        why = "" if config.integrating else "; integrating is off"
        if not self._stamp:
            raise DetectionError(
                Code.NO_DEPTH, "no depth/image since the scene was cleared" + why
            )
        raise DetectionError(
            Code.STALE_DEPTH,
            f"the newest depth image is {age:.2f} s old, max_depth_age is {limit} s"
            + why,
        )

    @property
    def valid_share(self) -> float:
        """Share of the newest image's pixels that were measured within range."""
        return self._valid_share

    def wait(
        self,
        is_enough: Callable[[SceneView], bool],
        deadline: float,
        stop: Stop = never,
    ) -> SceneView:
        """Return the scene as soon as it is enough, or as it is at the deadline.

        Args:
            is_enough: Asked after each image.
            deadline: Of ``time.monotonic()`` in [s].
            stop: Whether to wait no longer.

        Raises:
            DetectionError: As ``view``, at the deadline; CANCELED where it is stopped.
        """
        with self._changed:
            while True:
                left = deadline - time.monotonic()
                try:
                    view = self.view()
                except DetectionError:
                    if left <= 0:
                        raise
                else:
                    if left <= 0 or is_enough(view):
                        return view
                if stop():
                    raise DetectionError(
                        Code.CANCELED, "canceled while it waited for a depth image"
                    )
                self._changed.wait(min(left, WAKE_PERIOD))
