# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import torch
from diamond import AFFORDING_NETWORK, diamond_network

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.model import placed


def test_a_device_that_is_not_here_is_refused_with_those_that_are():
    network = diamond_network(AFFORDING_NETWORK, np.zeros(3), 0.04)
    assert placed(network, "cpu") is network
    absent = f"cuda:{torch.cuda.device_count()}"
    for device in ("gpu", absent):
        with pytest.raises(ConfigError, match=f"device '{device}' cannot.* has cpu"):
            placed(network, device)
