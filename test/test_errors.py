# SPDX-License-Identifier: Apache-2.0
import inspect
import pickle

import pytest

from neugrasp_ros import errors
from neugrasp_ros.errors import (
    CheckpointError,
    NeuGraspError,
    ObjectFileError,
    RobotModelError,
    ShapeError,
    UnknownAffordanceError,
    UnknownNameError,
)

ALL = [
    cls
    for _, cls in inspect.getmembers(errors, inspect.isclass)
    if cls.__module__ == errors.__name__
]


@pytest.mark.parametrize("cls", ALL)
def test_every_error_is_a_neugrasp_error(cls):
    assert issubclass(cls, NeuGraspError)


def test_a_shape_error_carries_both_shapes():
    error = ShapeError("points", "(N, 3)", (4, 2))
    assert (error.expected, error.got) == ("(N, 3)", (4, 2))
    assert str(error) == "points: expected shape (N, 3), got (4, 2)"
    assert isinstance(error, ValueError)


@pytest.mark.parametrize("cls", [UnknownNameError, UnknownAffordanceError])
def test_an_unknown_name_lists_the_known_ones_sorted(cls):
    error = cls("gripper", "hook", ["b", "a"])
    assert str(error) == "unknown gripper 'hook'; known: a, b"
    assert error.known == ("a", "b")
    assert isinstance(error, KeyError)


def test_a_robot_model_error_lists_what_there_is_in_order():
    error = RobotModelError("frame", "tool", ["hand", "arm"])
    assert error.known == ("hand", "arm")
    assert "no frame 'tool'; it has: hand, arm" in str(error)


@pytest.mark.parametrize("cls", [CheckpointError, ObjectFileError])
def test_a_file_error_carries_its_path(cls):
    error = cls("a/b.bin", "is empty")
    assert error.path == "a/b.bin"
    assert str(error) == "a/b.bin: is empty"


@pytest.mark.parametrize(
    "error",
    [
        ShapeError("points", "(N, 3)", (4, 2)),
        CheckpointError("w", "gone"),
        UnknownNameError("gripper", "hook", ["a"]),
        RobotModelError("frame", "tool", ["hand"]),
        ObjectFileError("m.obj", "broken"),
    ],
    ids=lambda e: type(e).__name__,
)
def test_an_error_comes_back_from_a_worker_process(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)
