# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from field_shapes import hand_at

from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.geometry.transform import apply, canonical_gripper
from neugrasp_ros.grasp.ablation import (
    CENTRE,
    GRID,
    GRID_SHAPE,
    GRIPPER_COLUMNS,
    RENDERED,
    restricted_inputs,
)
from neugrasp_ros.grasp.inputs import (
    LENGTH,
    POINT_FEATURES,
    TOKEN_FEATURES,
    LocalInputs,
    mirror_inputs,
)

HANDS = np.stack([
    hand_at(np.array([0.1, 0.2, 0.1]), [0, 0, -1], [0, 1, 0]),
    hand_at(np.array([0.2, 0.1, 0.15]), [1, 0, 0], [0, 1, 0]),
])  # fmt: skip


@pytest.fixture
def inputs() -> LocalInputs:
    rng = np.random.default_rng(0)
    return LocalInputs(
        rng.random((2, 16, 3), dtype=np.float32),
        rng.normal(size=(2, 16, POINT_FEATURES)).astype(np.float32),
        rng.normal(size=(2, TOKEN_FEATURES)).astype(np.float32),
        np.array([16, 3], dtype=np.int32),
    )


def test_the_full_view_is_left_alone(inputs):
    assert restricted_inputs(inputs, HANDS, RENDERED) is inputs


@pytest.mark.parametrize("view", [GRID, CENTRE])
def test_nothing_of_the_local_surface_remains_and_the_gripper_does(inputs, view):
    other = inputs._replace(
        points_task=inputs.points_task + 1,
        point_features=inputs.point_features + 1,
        tokens=inputs.tokens + 1,
    )
    other.tokens[:, GRIPPER_COLUMNS] = inputs.tokens[:, GRIPPER_COLUMNS]
    other.tokens[:, :4] = inputs.tokens[:, :4]
    a, b = (restricted_inputs(i, HANDS, view) for i in (inputs, other))
    for one, two in zip(a, b, strict=True):
        np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(
        a.tokens[:, GRIPPER_COLUMNS], inputs.tokens[:, GRIPPER_COLUMNS]
    )
    assert a.hits is inputs.hits


def test_the_grid_lies_between_the_jaws(inputs):
    grid = restricted_inputs(inputs, HANDS, GRID)
    assert grid.points_task.shape == (2, np.prod(GRID_SHAPE), 3)
    T = np.linalg.inv(canonical_gripper(HANDS))
    local = apply(T, grid.points_task.astype(np.float64))
    np.testing.assert_allclose(local, grid.point_features[..., :3] * LENGTH, atol=1e-6)
    assert np.abs(local[..., 1]).max() == pytest.approx(0.05, abs=1e-6)
    assert np.ptp(local[..., 2]) == pytest.approx(0.06, abs=1e-6)


def test_the_centre_is_the_tcp_and_tells_both_axes(inputs):
    centre = restricted_inputs(inputs, HANDS, CENTRE, unit=0.3)
    np.testing.assert_allclose(
        centre.points_task[:, 0] * 0.3, HANDS[:, :3, 3], atol=1e-6
    )
    told = centre.point_features[:, 0][:, [0, 2, 3]]
    np.testing.assert_allclose(told, HANDS[:, :3, 2], atol=1e-6)
    mirrored = mirror_inputs(centre)
    np.testing.assert_array_equal(mirrored.point_features, centre.point_features)
    np.testing.assert_array_equal(mirrored.tokens, centre.tokens)


def test_an_unknown_view_is_refused(inputs):
    with pytest.raises(UnknownNameError, match="known: centre, grid, rendered"):
        restricted_inputs(inputs, HANDS, "blind")
