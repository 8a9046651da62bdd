# SPDX-License-Identifier: Apache-2.0
import argparse

import pytest

from neugrasp_ros.cli.counts import require_positive
from neugrasp_ros.errors import ConfigError


def test_counts_from_one_pass_and_others_are_named_as_they_are_typed():
    args = argparse.Namespace(sets=1, slow_sets=0, seed=-3)
    require_positive(args, "sets")
    with pytest.raises(ConfigError, match="--slow-sets must be positive, got 0"):
        require_positive(args, "sets", "slow_sets")
    with pytest.raises(ConfigError, match="--seed must be positive, got -3"):
        require_positive(args, "seed")
