# SPDX-License-Identifier: Apache-2.0
import pytest

from neugrasp_ros.training.smoke import smoke_test


@pytest.mark.slow
def test_four_scenes_are_overfitted_and_a_finished_run_is_not_repeated(tmp_path):
    figures = smoke_test(tmp_path)
    assert figures["learned"], figures
    states = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.npz")}
    assert smoke_test(tmp_path) == figures
    assert states == {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.npz")}
