# SPDX-License-Identifier: Apache-2.0
import pytest

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.fusion.tsdf import empty_volume
from neugrasp_ros.pipeline.scenes import check_volume


def test_distances_that_are_truncated_elsewhere_are_refused():
    with pytest.raises(ConfigError, match=r"truncated at 8\.00 voxels; .* at 4\.0"):
        check_volume(empty_volume(64, 0.3, 8.0), 64)
