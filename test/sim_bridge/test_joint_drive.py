# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.motion.timing import time_line
from sim_bridge.joint_drive import DriveLimits, DriveState, JointDrive, Track

NAMES = ("a", "b")
LIMITS = DriveLimits(
    np.array([-2.0, -1.0]),
    np.array([2.0, 1.0]),
    np.array([2.0, 0.5]),
    np.array([4.0, 1.0]),
    np.array([30.0, 10.0]),
)
START, GOAL = np.array([-1.0, -0.4]), np.array([1.0, 0.4])
DT = 1 / 240


def motion(speed=0.8):
    slower = LIMITS._replace(
        velocity=LIMITS.velocity * speed,
        acceleration=LIMITS.acceleration * speed,
        jerk=LIMITS.jerk * speed,
    )
    return time_line(START, GOAL, slower, NAMES)


def started():
    drive = JointDrive(NAMES, LIMITS, START)
    m = motion()
    track = drive.read(m.times, m.positions, m.velocities, m.accelerations)
    drive.start(track, 0.0)
    return drive, track


def test_a_track_is_its_points_and_smooth_between_them():
    m = motion()
    track = Track(m.times, m.positions, m.velocities, m.accelerations)
    k = len(m.times) // 3
    point = track.at(m.times[k])
    assert point.position == pytest.approx(m.positions[k])
    assert point.velocity == pytest.approx(m.velocities[k])
    assert point.acceleration == pytest.approx(m.accelerations[k])
    t, h = m.times[k] + 0.004, 1e-6
    slope = (track.at(t + h).position - track.at(t - h).position) / (2 * h)
    assert track.at(t).velocity == pytest.approx(slope, abs=1e-5)


def test_it_arrives_and_holds():
    drive, track = started()
    drive.setpoint(track.duration / 2)
    assert drive.state is DriveState.FOLLOWING
    end = drive.setpoint(track.duration + 0.1)
    assert end.position == pytest.approx(GOAL)
    assert drive.state is DriveState.HOLDING
    assert drive.setpoint(99.0).velocity == pytest.approx(0.0)


@pytest.mark.parametrize("share", [0.02, 0.2, 0.5, 0.8, 0.97])
def test_a_stop_keeps_every_limit_and_stays_on_the_way(share):
    drive, track = started()
    now = share * track.duration
    drive.setpoint(now)
    drive.stop(now)
    direction = (GOAL - START) / np.linalg.norm(GOAL - START)
    last = None
    while drive.state is DriveState.STOPPING:
        point = drive.setpoint(now)
        assert (np.abs(point.velocity) <= LIMITS.velocity).all()
        assert (np.abs(point.acceleration) <= LIMITS.acceleration).all()
        assert (np.abs(point.jerk) <= LIMITS.jerk + 1e-9).all()
        off = point.position - START
        assert np.linalg.norm(off - (off @ direction) * direction) < 1e-9
        if last is not None:
            step = np.abs(point.position - last)
            assert (step <= LIMITS.velocity * DT + 1e-12).all()
        last, now = point.position, now + DT
        assert now < share * track.duration + 2.5
    assert drive.setpoint(now).velocity == pytest.approx(0.0)


@pytest.mark.slow
def test_a_stop_keeps_the_jerk_limit_between_any_two_steps():
    for share in np.linspace(0.02, 0.98, 30):
        drive, track = started()
        now = begin = share * track.duration
        drive.setpoint(now)
        drive.stop(now)
        while drive.state is DriveState.STOPPING and now < begin + 2.5:
            point = drive.setpoint(now)
            assert (np.abs(point.jerk) <= LIMITS.jerk).all(), (share, now - begin)
            now += 5e-4


def test_points_that_begin_later_begin_where_the_joints_are():
    drive = JointDrive(NAMES, LIMITS, START)
    drive.start(drive.read(np.array([1.0]), GOAL[None]), 5.0)
    assert drive.setpoint(5.0).position == pytest.approx(START)
    assert drive.setpoint(6.0).position == pytest.approx(GOAL)


@pytest.mark.parametrize("stopping", [False, True])
def test_a_motion_that_replaces_another_goes_on_as_the_joints_move(stopping):
    drive, track = started()
    now = track.duration / 2
    before = drive.setpoint(now)
    if stopping:
        drive.stop(now)
        now += 0.05
        before = drive.setpoint(now)
    assert np.abs(before.velocity).min() > 0.1
    drive.start(drive.read(np.array([1.5]), START[None]), now)
    after = drive.setpoint(now)
    assert after.position == pytest.approx(before.position)
    assert after.velocity == pytest.approx(before.velocity)
    assert after.acceleration == pytest.approx(before.acceleration)
    assert drive.setpoint(now + 1.5).position == pytest.approx(START)


def test_after_a_motion_the_next_one_begins_at_rest():
    drive, track = started()
    drive.setpoint(track.duration / 2)
    drive.hold(drive.target)
    drive.start(drive.read(np.array([1.5]), START[None]), 9.0)
    assert drive.setpoint(9.0).velocity == pytest.approx(0.0)
    assert drive.setpoint(9.0).acceleration == pytest.approx(0.0)


def test_bad_points_are_refused():
    drive = JointDrive(NAMES, LIMITS, START)
    with pytest.raises(ConfigError, match="b would leave its limits by 0.5"):
        drive.read(np.array([1.0]), np.array([[0.0, 1.5]]))
    with pytest.raises(ConfigError, match="increase from 0"):
        drive.read(np.array([0.0, 0.0]), np.stack([START, GOAL]))


def test_a_drive_that_holds_has_nothing_to_stop():
    drive = JointDrive(NAMES, LIMITS, START)
    drive.stop(0.0)
    assert drive.state is DriveState.HOLDING
