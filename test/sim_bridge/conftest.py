# SPDX-License-Identifier: Apache-2.0
import pytest

from sim_bridge.world import World


@pytest.fixture
def make_world():
    worlds = []

    def make(**options):
        worlds.append(World(**options))
        worlds[-1].load_table()
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()
