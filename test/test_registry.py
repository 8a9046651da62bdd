# SPDX-License-Identifier: Apache-2.0
import pytest

from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.registry import Registry


def test_a_builder_is_found_under_its_name_and_stays_usable():
    table: Registry = Registry("shape")

    @table.register("round")
    def make_round(radius: float) -> str:
        return f"round {radius}"

    assert table["round"] is make_round
    assert make_round(2) == "round 2"


def test_an_unknown_name_is_answered_with_the_known_ones():
    table: Registry = Registry("shape")
    table.register("round")(object)
    with pytest.raises(UnknownNameError, match="unknown shape 'flat'; known: round"):
        table["flat"]
