# SPDX-License-Identifier: Apache-2.0
import argparse
from dataclasses import replace

import pytest
from diamond import SMALL_NETWORK

from neugrasp_ros.cli.train import CONTEXT, HAND_VIEW, _shape, _stages, add_parser
from neugrasp_ros.config import CPU_NETWORK, PAPER_NETWORK
from neugrasp_ros.errors import CheckpointError
from neugrasp_ros.model import GraspNetwork, save_network
from sim_bridge.objects.affordances import AFFORDANCE_NAMES

AFFORDING = replace(SMALL_NETWORK, affordances=AFFORDANCE_NAMES)


@pytest.fixture
def parsed():
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    return lambda *options: parser.parse_args(["train", *options])


def shape(args):
    return _shape(args, _stages(args))


@pytest.fixture
def saved(tmp_path):
    def save(config):
        path = tmp_path / "start.safetensors"
        save_network(GraspNetwork(config), path)
        return str(path)

    return save


def test_a_network_has_the_shape_asked_for_or_else_that_of_the_start(parsed, saved):
    small = replace(AFFORDING, unet="residual", context=CONTEXT)
    start = saved(small)
    taught = {"thing_head": True, "hand_view": HAND_VIEW}
    heads = {"affordances": AFFORDANCE_NAMES, "context": CONTEXT, **taught}
    assert shape(parsed()) == replace(CPU_NETWORK, **heads)
    assert shape(parsed("--network", "paper")) == replace(PAPER_NETWORK, **heads)
    assert shape(parsed("--start", start)) == replace(small, **taught)
    both = parsed("--start", start, "--network", "cpu")
    assert shape(both) == replace(CPU_NETWORK, **heads)


def test_a_context_stays_once_it_is_there_and_the_part_head_goes(parsed, saved):
    without = ("--steps", "context=0")
    plain = replace(AFFORDING, part_head=True)
    assert shape(parsed("--start", saved(plain), *without)) == plain
    kept = shape(parsed("--start", saved(replace(plain, context=CONTEXT)), *without))
    assert (kept.context, kept.part_head) == (CONTEXT, False)
    assert not kept.thing_head  # which nothing would teach
    assert not kept.hand_view
    blind = shape(parsed("--local-view", "grid"))
    assert (blind.local_view, blind.context, blind.part_head) == ("grid", 0, True)


def test_a_start_that_is_no_weights_file_is_refused(parsed, tmp_path):
    broken = tmp_path / "start.safetensors"
    broken.write_bytes(b"no weights")
    with pytest.raises(CheckpointError, match="not a whole safetensors file"):
        shape(parsed("--start", str(broken)))
    with pytest.raises(CheckpointError, match="no such weights file"):
        shape(parsed("--start", str(tmp_path / "missing.safetensors")))
