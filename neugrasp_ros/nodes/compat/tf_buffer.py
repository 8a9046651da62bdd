# SPDX-License-Identifier: Apache-2.0
"""A small tf2: a buffer of transforms over time, listener and broadcasters.

Stands in for ``tf2_ros``, with the same names and signatures as far as they go.
"""

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, field
from threading import RLock
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from scipy.spatial.transform import Rotation, Slerp
from tf2_msgs.msg import TFMessage

from neugrasp_ros.geometry.transform import invert, make_transform, pose_from
from neugrasp_ros.nodes.compat.tf_message import to_transform

CACHE_TIME = 10.0  # [s], as in tf2
MAX_DEPTH = 1000  # links; a longer chain is a loop
QUEUE = 100  # messages on /tf that may wait

FloatArray = NDArray[np.float64]


class TransformException(Exception):
    """Base of what a lookup can raise."""


class LookupException(TransformException):
    """A frame is not known."""


class ConnectivityException(TransformException):
    """The two frames are in different trees."""


class ExtrapolationException(TransformException):
    """The time lies outside of what was received."""


class InvalidArgumentException(TransformException):
    """A frame id is empty or a transform is not a number."""


class _Sample(NamedTuple):
    stamp: int  # [ns]
    parent: str
    pose: tuple[float, ...]  # x, y, z, qx, qy, qz, qw


@dataclass(slots=True)
class _Track:
    """What is known of one child frame."""

    static: _Sample | None = None
    samples: list[_Sample] = field(default_factory=list)

    def latest(self) -> int | None:
        """Return the newest stamp [ns]; None for a static frame."""
        return None if self.static else self.samples[-1].stamp

    def add(self, sample: _Sample, cache: int) -> None:
        """Take a sample, in the place of one of its time; forget old ones [ns].

        One that is older than all that is kept is not late: time has jumped back, as
        when a simulator starts anew, and what was known before is of another run.
        """
        samples = self.samples
        if samples and sample.stamp < samples[-1].stamp - cache:
            samples.clear()
        oldest = max([sample, *samples[-1:]]).stamp - cache
        index = bisect_left(samples, (sample.stamp,))
        if index < len(samples) and samples[index].stamp == sample.stamp:
            samples[index] = sample
        else:
            samples.insert(index, sample)
        del samples[: bisect_left(samples, (oldest,))]

    def at(self, stamp: int, name: str) -> FloatArray:
        """Return ``T_parent_child`` at a time in [ns]."""
        if self.static:
            return _matrix(self.static)
        first, last = self.samples[0], self.samples[-1]
        if not first.stamp <= stamp <= last.stamp:
            side = "past" if stamp < first.stamp else "future"
            raise ExtrapolationException(
                f"Lookup of {name!r} would require extrapolation into the {side}: "
                f"requested {stamp / 1e9:.3f} s, known {first.stamp / 1e9:.3f} to "
                f"{last.stamp / 1e9:.3f} s"
            )
        index = bisect_left(self.samples, (stamp,))
        after = self.samples[index]
        before = self.samples[index - 1] if index else after
        if after.stamp == stamp or before.parent != after.parent:
            return _matrix(after)
        share = (stamp - before.stamp) / (after.stamp - before.stamp)
        return _between(before, after, share)


def _matrix(sample: _Sample) -> FloatArray:
    return pose_from(np.array(sample.pose[:3]), np.array(sample.pose[3:]))


def _between(before: _Sample, after: _Sample, share: float) -> FloatArray:
    start, end = np.array(before.pose), np.array(after.pose)
    turn = Slerp([0.0, 1.0], Rotation.from_quat([start[3:], end[3:]]))(share)
    position = (1 - share) * start[:3] + share * end[:3]
    return make_transform(turn.as_matrix(), position)


class Buffer:
    """Transforms of the last ten seconds; thread-safe.

    Args:
        cache_time: How long transforms are kept; default 10 s.
        node: Accepted for the signature's sake.
    """

    def __init__(
        self, cache_time: Duration | None = None, node: Node | None = None
    ) -> None:
        self._cache = int(CACHE_TIME * 1e9)
        if cache_time is not None:
            self._cache = cache_time.nanoseconds
        self._tracks: dict[str, _Track] = {}
        self._lock = RLock()

    def clear(self) -> None:
        """Forget all but the static transforms."""
        with self._lock:
            self._tracks = {k: v for k, v in self._tracks.items() if v.static}

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform.

        Raises:
            InvalidArgumentException: If a frame id is empty, both are the same, or a
                number is not finite.
        """
        sample = _sample(transform)
        with self._lock:
            track = self._tracks.setdefault(_name(transform.child_frame_id), _Track())
            track.static = None
            track.add(sample, self._cache)

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform that holds for ever."""
        with self._lock:
            name = _name(transform.child_frame_id)
            self._tracks[name] = _Track(static=_sample(transform))

    def all_frames(self) -> tuple[str, ...]:
        """Return the names of all frames."""
        with self._lock:
            parents = {
                (t.static or t.samples[-1]).parent for t in self._tracks.values()
            }
            return tuple(sorted(parents | set(self._tracks)))

    def all_frames_as_yaml(self) -> str:
        """Return each child frame with its parent, as YAML."""
        with self._lock:
            return "".join(
                f"{child!r}: {{parent: {(t.static or t.samples[-1]).parent!r}}}\n"
                for child, t in self._tracks.items()
            )

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration | None = None,
    ) -> TransformStamped:
        """Return the transform that takes coordinates in source to target.

        Args:
            target_frame: Frame to come to.
            source_frame: Frame of the data.
            time: When; zero = the newest time that all links know.
            timeout: Accepted for the signature's sake: this buffer never waits.

        Raises:
            TransformException: One of its four kinds.
        """
        target, source = _name(target_frame), _name(source_frame)
        with self._lock:
            for name in (target, source):
                if name not in self.all_frames():
                    raise LookupException(f"frame {name!r} does not exist")
            ups, downs = self._chain(source), self._chain(target)
            meeting = next((name for name in ups if name in downs), None)
            if meeting is None:
                raise ConnectivityException(
                    f"{target!r} and {source!r} are not part of the same tree"
                )
            ups, downs = ups[: ups.index(meeting)], downs[: downs.index(meeting)]
            stamp = time.nanoseconds or self._latest_common(ups + downs)
            T_meeting_source = self._climb(ups, stamp)
            T_meeting_target = self._climb(downs, stamp)
        T_target_source = invert(T_meeting_target) @ T_meeting_source
        return to_transform(T_target_source, target, source, stamp)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Time,
        timeout: Duration | None = None,
    ) -> bool:
        """Tell whether ``lookup_transform`` would succeed."""
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except TransformException:
            return False
        return True

    def _chain(self, name: str) -> list[str]:
        """Return a frame, its parent, and so on to the root."""
        chain = [name]
        while name in self._tracks:
            track = self._tracks[name]
            name = (track.static or track.samples[-1]).parent
            if len(chain) > MAX_DEPTH:
                raise ConnectivityException(f"the frames above {name!r} form a loop")
            chain.append(name)
        return chain

    def _latest_common(self, links: list[str]) -> int:
        """Return the newest time [ns] that every moving one of the links knows."""
        times = [self._tracks[name].latest() for name in links]
        return min((t for t in times if t is not None), default=0)

    def _climb(self, links: list[str], stamp: int) -> FloatArray:
        """Return the pose of the first of a chain of links in the last one's parent."""
        T_parent_frame = np.eye(4)
        for name in links:
            T_parent_frame = self._tracks[name].at(stamp, name) @ T_parent_frame
        return T_parent_frame


def _name(frame: str) -> str:
    if not frame.strip("/"):
        raise InvalidArgumentException("a frame id is empty")
    return frame.removeprefix("/")


def _sample(transform: TransformStamped) -> _Sample:
    parent, child = _name(transform.header.frame_id), _name(transform.child_frame_id)
    p, q = transform.transform.translation, transform.transform.rotation
    pose = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    if parent == child:
        raise InvalidArgumentException(f"frame {child!r} is its own parent")
    if not np.isfinite(pose).all() or not any(pose[3:]):
        raise InvalidArgumentException(f"transform of {child!r} is not a pose: {pose}")
    return _Sample(Time.from_msg(transform.header.stamp).nanoseconds, parent, pose)


class TransformListener:
    """Feeds a buffer from ``/tf`` and ``/tf_static``.

    Args:
        buffer: The buffer to feed.
        node: Node whose executor runs the callbacks.
    """

    def __init__(self, buffer: Buffer, node: Node, **_: object) -> None:
        self._buffer = buffer
        self._logger = node.get_logger()
        group = ReentrantCallbackGroup()
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._moving = node.create_subscription(
            TFMessage,
            "/tf",
            self._on_tf,
            QoSProfile(depth=QUEUE),
            callback_group=group,
        )
        node.create_subscription(
            TFMessage, "/tf_static", self._on_static, latched, callback_group=group
        )

    def _on_tf(self, message: TFMessage) -> None:
        """Take a message, and at once all that wait behind it.

        An executor takes one message in each of its turns. One whose turns are slower
        than ``/tf`` comes would stay a whole queue behind, and everything that waits
        for a transform with it.
        """
        self._feed(message, self._buffer.set_transform)
        for _ in range(QUEUE):
            with self._moving.handle:
                taken = self._moving.handle.take_message(TFMessage, False)
            if taken is None:
                return
            self._feed(taken[0], self._buffer.set_transform)

    def _on_static(self, message: TFMessage) -> None:
        self._feed(message, self._buffer.set_transform_static)

    def _feed(self, message: TFMessage, put) -> None:
        for transform in message.transforms:
            try:
                put(transform, "default_authority")
            except InvalidArgumentException as error:
                self._logger.warning(f"tf: {error}", throttle_duration_sec=5.0)


class TransformBroadcaster:
    """Publishes moving transforms."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))

    def sendTransform(  # noqa: N802 (tf2's name)
        self, transforms: TransformStamped | Iterable[TransformStamped]
    ) -> None:
        """Publish one transform or several."""
        self._publisher.publish(TFMessage(transforms=_as_list(transforms)))


class StaticTransformBroadcaster:
    """Publishes fixed transforms, latched; those sent before are sent again."""

    def __init__(self, node: Node) -> None:
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._publisher = node.create_publisher(TFMessage, "/tf_static", latched)
        self._sent: dict[str, TransformStamped] = {}

    def sendTransform(  # noqa: N802 (tf2's name)
        self, transforms: TransformStamped | Iterable[TransformStamped]
    ) -> None:
        """Publish one transform or several beside those sent before."""
        self._sent |= {t.child_frame_id: t for t in _as_list(transforms)}
        self._publisher.publish(TFMessage(transforms=list(self._sent.values())))


def _as_list(
    transforms: TransformStamped | Iterable[TransformStamped],
) -> list[TransformStamped]:
    if isinstance(transforms, TransformStamped):
        return [transforms]
    return list(transforms)
