# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.grasp.pooling import run_maxima


def test_each_run_has_its_own_maxima():
    values = np.array([[1, -5], [3, -9], [-7, 2], [0, 0], [9, -1]], np.float32)
    found = run_maxima(values, np.array([2, 1, 2]))
    np.testing.assert_array_equal(found, [[3, -5], [-7, 2], [9, 0]])


@pytest.mark.parametrize("counts", [[2, 2], [5, 0], [6, -1]])
def test_runs_that_are_not_the_rows_are_refused(counts):
    with pytest.raises(ShapeError, match="runs of 1 up"):
        run_maxima(np.zeros((5, 3), np.float32), np.array(counts))
