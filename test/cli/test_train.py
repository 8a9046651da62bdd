# SPDX-License-Identifier: Apache-2.0
import argparse
from dataclasses import replace

import pytest
from diamond import SMALL_NETWORK

from neugrasp_ros.cli.train import _shape, add_parser
from neugrasp_ros.config import CPU_NETWORK, PAPER_NETWORK
from neugrasp_ros.errors import CheckpointError
from neugrasp_ros.model import GraspNetwork, save_network


@pytest.fixture
def parsed():
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    return lambda *options: parser.parse_args(["train", *options])


def test_a_network_has_the_shape_asked_for_or_else_that_of_the_start(parsed, tmp_path):
    start = tmp_path / "start.safetensors"
    small = replace(SMALL_NETWORK, unet="residual")
    save_network(GraspNetwork(small), start)
    assert _shape(parsed()) == CPU_NETWORK
    assert _shape(parsed("--network", "paper")) == PAPER_NETWORK
    assert _shape(parsed("--start", str(start))) == small
    assert _shape(parsed("--start", str(start), "--network", "cpu")) == CPU_NETWORK


def test_a_start_that_is_no_weights_file_is_refused(parsed, tmp_path):
    broken = tmp_path / "start.safetensors"
    broken.write_bytes(b"no weights")
    with pytest.raises(CheckpointError, match="not a whole safetensors file"):
        _shape(parsed("--start", str(broken)))
    with pytest.raises(CheckpointError, match="no such weights file"):
        _shape(parsed("--start", str(tmp_path / "missing.safetensors")))
