# SPDX-License-Identifier: Apache-2.0
import argparse
import json

import pytest
from diamond import SMALL_NETWORK, diamond_network
from labelled import ASTRAY, CENTER, SIDE, TOP, labels_of

from neugrasp_ros.cli import evaluate
from neugrasp_ros.datagen.shards import write_shard
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.model import save_network


def parse(*words):
    parser = argparse.ArgumentParser()
    evaluate.add_parser(parser.add_subparsers())
    return parser.parse_args(["evaluate", *(str(word) for word in words)])


@pytest.fixture
def weights(tmp_path):
    network = diamond_network(SMALL_NETWORK, CENTER, 0.04)
    save_network(network, tmp_path / "w.safetensors")
    return tmp_path / "w.safetensors"


def test_figures_name_what_they_were_made_from(weights, tmp_path, capsys):
    (tmp_path / "val").mkdir()
    scenes = [labels_of(TOP, SIDE, TOP, SIDE, index=i) for i in range(2)]
    write_shard(tmp_path / "val" / "shard_000000.npz", scenes)
    args = parse(
        "--data", tmp_path / "val", "--weights", weights, "--views", 2,
        "--scenes", 1, "--seed", 3, "--json", tmp_path / "f.json",
    )  # fmt: skip
    assert args.run(args) == 0
    figures = json.loads((tmp_path / "f.json").read_text())
    assert (figures["scenes"], figures["views"], figures["seed"]) == (1, 2, 3)
    assert figures["data"] == "val"
    assert len(figures["weights_sha256"]) == 64
    assert figures["quality"]["positive"] == 0.5
    assert figures["command"].startswith("neugrasp ")
    assert "panda" in capsys.readouterr().out


def test_scenes_without_any_surface_are_told(weights, tmp_path):
    (tmp_path / "val").mkdir()
    write_shard(tmp_path / "val" / "shard_000000.npz", [labels_of(ASTRAY)])
    args = parse("--data", tmp_path / "val", "--weights", weights)
    with pytest.raises(ConfigError, match="no grasp of any scene meets a surface"):
        args.run(args)
