# SPDX-License-Identifier: Apache-2.0
from dataclasses import asdict, fields, replace

import pytest
import yaml

from neugrasp_ros.config import (
    CPU_NETWORK,
    PAPER_NETWORK,
    Checked,
    NetworkConfig,
    PlannerConfig,
    RenderConfig,
    TrainConfig,
    load_config,
    override,
)
from neugrasp_ros.errors import ConfigError

CONFIGS = (NetworkConfig, RenderConfig, PlannerConfig, TrainConfig)


@pytest.fixture
def written(tmp_path):
    def write(text: str) -> str:
        path = tmp_path / "some.yaml"
        path.write_text(text)
        return str(path)

    return write


@pytest.mark.parametrize("config_type", CONFIGS)
def test_every_field_is_documented_and_its_default_allowed(config_type):
    config = config_type()
    assert isinstance(config, Checked)
    assert all(item.metadata["doc"] for item in fields(config))


def test_the_papers_network_is_the_papers():
    paper = PAPER_NETWORK
    assert (paper.channels, paper.unet_depth, paper.occupancy_hidden) == (128, 5, 256)
    assert paper != CPU_NETWORK


@pytest.mark.parametrize("config", [CPU_NETWORK, PAPER_NETWORK])
def test_a_network_config_survives_yaml(written, config):
    values = asdict(config) | {"affordances": list(config.affordances)}
    assert load_config(NetworkConfig, written(yaml.safe_dump(values))) == config


def test_a_file_overrides_only_what_it_names(written):
    config = load_config(TrainConfig, written("steps: 7\nstage: joint\n"))
    assert config == replace(TrainConfig(), steps=7, stage="joint")


def test_an_empty_file_means_the_defaults(written):
    assert load_config(RenderConfig, written("")) == RenderConfig()


def test_a_list_becomes_a_tuple_so_that_configs_stay_hashable(written):
    config = load_config(NetworkConfig, written("affordances: [grasp, cut]"))
    assert config.affordances == ("grasp", "cut")
    assert hash(config) == hash(replace(config))


def test_a_part_is_overridden_field_by_field(written):
    config = load_config(PlannerConfig, written("render: {cameras: 4}"))
    assert config.render == RenderConfig(cameras=4)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("cameras: 0", r"some.yaml: cameras must be in \[1, 32\], got 0"),
        ("cameras: 6.5", "cameras must be a whole number, got 6.5"),
        ("cameras: many", "cameras must be a whole number, got 'many'"),
        ("radius: far", "some.yaml"),
        ("radius: .nan", "radius must be in"),
        ("kameras: 6", r"some.yaml: unknown \['kameras'\]; known: \['cameras'"),
        ("- 6", "expected a mapping, got list"),
        ("cameras: [", "not a readable YAML file"),
    ],
)
def test_a_wrong_file_is_rejected_with_what_was_expected(written, text, told):
    with pytest.raises(ConfigError, match=told):
        load_config(RenderConfig, written(text))


def test_a_missing_file_is_our_error(tmp_path):
    with pytest.raises(ConfigError, match="missing.yaml"):
        load_config(RenderConfig, tmp_path / "missing.yaml")


def test_an_error_in_a_part_names_the_part(written):
    with pytest.raises(ConfigError, match="render: unknown"):
        load_config(PlannerConfig, written("render: {kameras: 4}"))


def test_a_word_that_is_not_a_choice_is_rejected():
    with pytest.raises(ConfigError, match="stage must be one of occupancy, quality"):
        TrainConfig(stage="dreaming")


def test_overrides_are_left_alone():
    values = {"affordances": ["cut"]}
    override(NetworkConfig, values, where="test")
    assert values == {"affordances": ["cut"]}


def test_a_configuration_cannot_be_changed():
    with pytest.raises(AttributeError):
        TrainConfig().steps = 3


def test_a_part_head_needs_classes():
    with pytest.raises(ConfigError, match="part_head needs affordances, got none"):
        NetworkConfig(part_head=True)


def test_a_thing_head_needs_a_context():
    with pytest.raises(ConfigError, match="thing_head needs a context, got none"):
        NetworkConfig(affordances=("pour",), thing_head=True)
