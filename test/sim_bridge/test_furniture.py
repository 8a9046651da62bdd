# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import UnknownNameError
from sim_bridge.furniture import BINS, FURNITURE, read_kind


@pytest.mark.parametrize("item", FURNITURE.values(), ids=FURNITURE)
def test_the_support_is_at_its_height_and_in_front_of_the_robot(item):
    top = item.support.center[2] + item.support.size[2] / 2
    assert top == pytest.approx(item.support_height)
    for block in (item.support, *item.others, *item.later):
        assert block.center[0] - block.size[0] / 2 > 0.30, "the base has 0.27 m"
        assert block.center[2] - block.size[2] / 2 > -1e-9, "nothing below the floor"


def test_a_bin_is_hollow_and_its_solid_holds_all_of_it():
    for bin_ in BINS.values():
        solid = bin_.solid()
        low, high = solid.center - solid.size / 2, solid.center + solid.size / 2
        middle = solid.center + [0, 0, solid.size[2] / 2 - 0.05]
        for block in bin_.blocks():
            a, b = block.center - block.size / 2, block.center + block.size / 2
            assert (a >= low - 1e-9).all()
            assert (b <= high + 1e-9).all()
            assert not ((middle > a) & (middle < b)).all()


def test_kinds_name_furniture_scene_or_both():
    assert [v if isinstance(v, str) else v.name for v in read_kind("shelf")] == [
        "shelf", "packed",
    ]  # fmt: skip
    assert read_kind("cupboard:empty")[1] == "empty"
    assert read_kind("packed") == (FURNITURE["table"], "packed")
    with pytest.raises(UnknownNameError, match="cupboard, shelf, table"):
        read_kind("sofa:pile")


def test_bins_stand_clear_of_all_furniture():
    for bin_ in BINS.values():
        solid = bin_.solid()
        for item in FURNITURE.values():
            for block in (item.support, *item.others, *item.later):
                gap = (
                    np.abs(solid.center - block.center) - (solid.size + block.size) / 2
                )
                assert gap.max() > 0.02, (item.name, block)
