# SPDX-License-Identifier: Apache-2.0
from collections import Counter

import pytest

from neugrasp_ros.datagen.jobs import RunPlan
from neugrasp_ros.datagen.labels import WITHOUT_PHYSICS
from neugrasp_ros.errors import ConfigError


def plan(**changes):
    values = {
        "objects": ("pile:a", "packed:b", "procedural"),
        "kind": "mixed",
        "gripper": "mixed",
        "n_scenes": 100,
        "seed": 3,
    }
    return RunPlan(**(values | changes))


@pytest.mark.parametrize("n", [40, 200, 1000])
def test_every_start_of_a_run_is_a_balanced_mix(n):
    jobs = plan(n_scenes=n).jobs()
    kinds, grippers, sets = (
        Counter(getattr(job, name) for job in jobs)
        for name in ("kind", "gripper", "objects")
    )
    tolerance = max(0.04, 4 / n)
    assert abs(kinds["pile"] / n - 0.6) < tolerance
    assert abs(grippers["panda"] / n - 0.45) < tolerance
    assert abs(sets["procedural"] / n - 0.5) < tolerance
    both = Counter((job.kind, job.gripper) for job in jobs)
    assert abs(both["packed", "robotiq_2f85"] / n - 0.12) < tolerance
    assert abs(grippers["varied"] / n - 0.25) < tolerance
    assert 0 < sum(job.preset == "fast_shake" for job in jobs) < 0.25 * n


def test_sets_serve_the_kinds_they_are_for():
    jobs = plan().jobs()
    assert {job.objects for job in jobs if job.kind == "pile"} == {"a", "procedural"}
    assert {job.objects for job in jobs if job.kind == "packed"} == {"b", "procedural"}


def test_a_job_does_not_depend_on_how_many_there_are():
    assert plan().job(7) == plan(n_scenes=9).job(7)
    assert plan(seed=4).job(7) != plan().job(7)


def test_done_scenes_are_left_out():
    indices = [job.index for job in plan(n_scenes=6).jobs({1, 4})]
    assert indices == [0, 2, 3, 5]


def test_one_kind_and_one_gripper_can_be_asked_for():
    jobs = plan(kind="pile", gripper="my.yaml").jobs()
    assert {(job.kind, job.gripper) for job in jobs} == {("pile", "my.yaml")}


def test_physics_can_be_left_out():
    assert {job.preset for job in plan(physics=False).jobs()} == {WITHOUT_PHYSICS}


def test_a_kind_without_objects_is_refused():
    with pytest.raises(ConfigError, match="no object set for packed"):
        plan(objects=("pile:a",))
    with pytest.raises(ConfigError, match="n_scenes"):
        plan(n_scenes=0)
