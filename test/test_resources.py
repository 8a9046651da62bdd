# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from neugrasp_ros import resources
from neugrasp_ros.errors import ConfigError


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The package as if it were installed far from its source tree."""
    module = tmp_path / "lib" / "neugrasp_ros" / "resources.py"
    module.parent.mkdir(parents=True)
    module.touch()
    monkeypatch.setattr(resources, "__file__", str(module))
    monkeypatch.setattr(resources.sys, "prefix", str(tmp_path / "env"))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    return tmp_path


def make_share(prefix: Path) -> Path:
    folder = prefix / "share" / "neugrasp_ros" / "config"
    (folder / "grippers").mkdir(parents=True)
    return folder


def test_the_source_tree_is_found_first():
    assert (resources.config_dir() / "grippers" / "panda.yaml").is_file()


def test_the_environments_share_folder_is_found(installed):
    share = make_share(installed / "env")
    assert resources.config_dir() == share


def test_a_workspace_is_found_by_its_prefix(installed, monkeypatch):
    overlay = make_share(installed / "overlay")
    paths = f"{installed / 'empty'}:{installed / 'overlay'}"
    monkeypatch.setenv("AMENT_PREFIX_PATH", paths)
    assert resources.config_dir() == overlay


def test_where_it_was_looked_for_is_told(installed):
    with pytest.raises(ConfigError, match=r"no config folder in .*env/share"):
        resources.config_dir()


def test_weights_lie_in_the_package():
    assert resources.weights_dir().parent == Path(resources.__file__).parent
