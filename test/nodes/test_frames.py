# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.geometry.transform import make_transform, random_rotation
from neugrasp_ros.nodes.frames import (
    R_GRIPPER_AXES,
    TCP_AHEAD,
    from_axes,
    tcp_from_model,
    to_axes,
)

APPROACH, CLOSING = 2, 1  # columns of our gripper frame


def poses() -> np.ndarray:
    rng = np.random.default_rng(1)
    rotations = np.array([random_rotation(rng) for _ in range(5)])
    return make_transform(rotations, rng.normal(size=(5, 3)))


@pytest.mark.parametrize(
    ("axes", "approach", "closing"), [(0, 0, 1), (1, 2, 1), (2, 2, 0)]
)
def test_approach_and_closing_lie_on_the_axes_that_the_message_names(
    axes, approach, closing
):
    T = poses()
    out = to_axes(T, axes)
    np.testing.assert_allclose(out[..., :3, approach], T[..., :3, APPROACH])
    np.testing.assert_allclose(out[..., :3, closing], T[..., :3, CLOSING])
    np.testing.assert_allclose(np.linalg.det(out[..., :3, :3]), 1.0)
    np.testing.assert_allclose(out[..., :3, 3], T[..., :3, 3])
    np.testing.assert_allclose(from_axes(out, axes), T, atol=1e-12)


def test_axes_zero_is_a_quarter_turn_back_about_y():
    np.testing.assert_allclose(R_GRIPPER_AXES[0], [[0, 0, -1], [0, 1, 0], [1, 0, 0]])


def test_unknown_axes_are_refused_and_input_is_left_alone():
    T = poses()
    before = T.copy()
    to_axes(T, 0)
    np.testing.assert_array_equal(T, before)
    with pytest.raises(ConfigError, match="axes must be 0, 1 or 2, got 3"):
        from_axes(T, 3)


@pytest.mark.parametrize("model", sorted(TCP_AHEAD))
def test_origins_of_other_models_move_along_the_approach(model):
    T = poses()
    moved = tcp_from_model(T, TCP_AHEAD[model])
    np.testing.assert_allclose(
        moved[:, :3, 3], T[:, :3, 3] + TCP_AHEAD[model] * T[:, :3, APPROACH]
    )
    np.testing.assert_allclose(tcp_from_model(T, (0.0, 0.0, TCP_AHEAD[model])), moved)
