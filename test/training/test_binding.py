# SPDX-License-Identifier: Apache-2.0
import json
from dataclasses import replace

import pytest
from diamond import SMALL_NETWORK, diamond_network
from labelled import CENTER, SIDE, TOP, labels_of

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.model import save_network
from neugrasp_ros.training.binding import RUN_FILE, bind_folder

STAGES = (TrainConfig(stage="quality"), TrainConfig(stage="joint"))
SCENES = {"train": [labels_of(TOP, index=3)], "tune": [labels_of(SIDE, index=3)]}


@pytest.fixture
def start(tmp_path):
    path = tmp_path / "start.safetensors"
    save_network(diamond_network(SMALL_NETWORK, CENTER, 0.04), path)
    return path


@pytest.fixture
def folder(tmp_path, start):
    """A folder that a training was begun in."""
    made = tmp_path / "run"
    bind_folder(made, SMALL_NETWORK, STAGES, start, SCENES)
    return made


def test_the_same_training_goes_on_with_more_scenes_steps_and_stages(folder, start):
    longer = replace(STAGES[0], steps=9, threads=1), TrainConfig(stage="context")
    more = {**SCENES, "train": [*SCENES["train"], labels_of(TOP, index=4)]}
    bind_folder(folder, SMALL_NETWORK, longer, start, more)
    with pytest.raises(ConfigError, match="begun with train scene 4 = "):
        bind_folder(folder, SMALL_NETWORK, STAGES, start, SCENES)


def test_other_scenes_of_the_same_number_are_refused(folder, start):
    other = {**SCENES, "train": [labels_of(SIDE, index=3)]}
    with pytest.raises(ConfigError, match="train scene 3 = .*take a new folder"):
        bind_folder(folder, SMALL_NETWORK, STAGES, start, other)


def test_another_network_start_or_setting_is_refused(folder, start):
    grid = replace(SMALL_NETWORK, local_view="grid")
    with pytest.raises(ConfigError, match="network local_view = rendered, got grid"):
        bind_folder(folder, grid, STAGES, start, SCENES)
    with pytest.raises(ConfigError, match="start weights = .*, got none"):
        bind_folder(folder, SMALL_NETWORK, STAGES, None, SCENES)
    seeded = (replace(STAGES[1], seed=1),)
    with pytest.raises(ConfigError, match="stage joint seed = 0, got 1"):
        bind_folder(folder, SMALL_NETWORK, seeded, start, SCENES)
    bind_folder(folder, SMALL_NETWORK, STAGES, start, SCENES)


def test_a_setting_younger_than_the_folder_had_its_default(folder, start):
    path = folder / RUN_FILE
    begun = json.loads(path.read_text())
    del begun["stage joint"]["point_scenes"]
    path.write_text(json.dumps(begun))
    other = (replace(STAGES[1], point_scenes=5),)
    with pytest.raises(ConfigError, match="stage joint point_scenes = 3, got 5"):
        bind_folder(folder, SMALL_NETWORK, other, start, SCENES)
    bind_folder(folder, SMALL_NETWORK, STAGES, start, SCENES)
