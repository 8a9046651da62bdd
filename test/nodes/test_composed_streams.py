# SPDX-License-Identifier: Apache-2.0
"""What the composed suite does unasked: its topics, and how they give requests way."""

import time

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import GraspArray  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from nodes.bench import LEFT, RIGHT, ask, begin, newest  # noqa: E402
from nodes.standin import SurfacePlanner  # noqa: E402

pytestmark = pytest.mark.ros

STREAM_SEED = 1  # of the candidates that nobody asked for


@pytest.fixture(autouse=True)
def usual(bench, wait_until):
    """Begin each test with both boxes seen, whatever the one before did."""
    begin(bench, wait_until)


def topics_agree(bench) -> bool:
    """Return whether the last poses and the best one are those of the last array."""
    poses = [grasp.pose for grasp in newest(bench, "grasps").grasps]
    listed = list(newest(bench, "grasps/poses").poses)
    return listed == poses and newest(bench, "grasps/best").pose == poses[0]


def test_a_listener_who_never_calls_hears_of_a_change_within_three_seconds(
    bench, wait_until
):
    bench.show(LEFT)
    wait_until(
        lambda: (
            (a := newest(bench, "grasps"))
            and a.grasps
            and all(g.pose.position.y > 0 for g in a.grasps)
        ),
        seconds=10.0,
    )
    bench.show(RIGHT)
    wait_until(
        lambda: (
            (a := newest(bench, "grasps")).grasps
            and all(g.pose.position.y < 0 for g in a.grasps)
        ),
        seconds=3.0,
    )
    wait_until(lambda: topics_agree(bench), seconds=3.0)
    wait_until(lambda: len(newest(bench, "grasps/markers").markers) == 2, seconds=3.0)
    bench.show()
    wait_until(lambda: not newest(bench, "grasps").grasps, seconds=3.0)
    wait_until(lambda: len(newest(bench, "grasps/markers").markers) == 1, seconds=3.0)


def test_every_answer_appears_on_the_topics_too(bench, wait_until):
    bench.show(LEFT, RIGHT)
    wait_until(lambda: len(newest(bench, "grasps").grasps) > 1)
    response = ask(bench, max_grasps=1)
    wait_until(lambda: len(newest(bench, "grasps").grasps) == 1)
    heard = newest(bench, "grasps")
    assert heard.header == response.grasps.header
    assert heard.grasps[0].pose == response.grasps.grasps[0].pose


def settled(value, seconds: float = 2.0):
    """Return a value once it has not changed for a while: the streams are done."""
    last, since = value(), time.monotonic()
    while time.monotonic() - since < seconds:
        if (now := value()) != last:
            last, since = now, time.monotonic()
        time.sleep(0.05)
    return last


def test_the_two_nodes_share_one_encoder_pass(bench):
    planner = bench.suite._make_planner._made[1].planner
    bench.show(LEFT)
    ask(bench, scene=DetectGrasps.Request.SCENE_FRESH)
    passes = settled(lambda: planner.encoder_passes)
    ask(bench)
    ask(bench)
    assert planner.encoder_passes == passes
    bench.show(LEFT, RIGHT)
    ask(bench, scene=DetectGrasps.Request.SCENE_FRESH)
    assert settled(lambda: planner.encoder_passes) == passes + 1


def quiet_with_grasps(bench, wait_until):
    """Return grasps to stream, and who streams them; the camera shows nothing new."""
    found = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).grasps
    scored = bench.user.create_publisher(GraspArray, "grasps/scored", 1)
    wait_until(scored.get_subscription_count)
    bench.camera.sends = {"info"}
    return found, scored


def test_grasps_that_nobody_asked_for_wait_for_a_running_request(bench, wait_until):
    found, scored = quiet_with_grasps(bench, wait_until)
    heard = bench.user.heard["grasps"]
    before = settled(lambda: len(heard))
    with bench.suite.stages.request():
        scored.publish(found)
        time.sleep(1.0)
        assert len(heard) == before
    wait_until(lambda: len(heard) > before)


def test_an_answer_stays_when_older_grasps_come_after_it(bench, wait_until):
    found, scored = quiet_with_grasps(bench, wait_until)
    heard = bench.user.heard["grasps"]
    settled(lambda: len(heard))
    with bench.suite.stages.request():
        scored.publish(found)
        time.sleep(0.5)
        ask(bench, max_grasps=1)
        wait_until(lambda: len(heard[-1].grasps) == 1)
    settled(lambda: len(heard))
    assert len(heard[-1].grasps) == 1 < len(found.grasps)


def test_a_scene_that_a_request_held_back_and_another_replaced_is_left(bench):
    planner = bench.suite._make_planner._made[1].planner
    settled(lambda: planner.encoder_passes)
    with bench.suite.stages.request():
        for boxes in ((LEFT,), (RIGHT,), (LEFT, RIGHT)):
            bench.show(*boxes)
            time.sleep(1.0)  # the stream of each waits, or is replaced
        bench.camera.sends = {"info"}
        passes = planner.encoder_passes
    assert settled(lambda: planner.encoder_passes) == passes + 1


def test_a_view_that_has_not_changed_keeps_the_seed_that_was_drawn(bench):
    fresh = DetectGrasps.Request.SCENE_FRESH
    drawn = []
    for _ in range(2):
        assert ask(bench, scene=fresh, seed=0).success
        bench.camera.sends = set()  # nothing changes any more
        before = len(SurfacePlanner.seeds)
        first, again = ask(bench, seed=0), ask(bench, seed=0, max_candidates=1)
        assert first.success and again.success
        assert again.report.sampled == 1
        seeds = {s for s in SurfacePlanner.seeds[before:] if s != STREAM_SEED}
        assert len(seeds) == 1
        drawn += seeds
        bench.camera.sends = {"depth", "info"}
        bench.show(LEFT)
    assert drawn[0] != drawn[1]
