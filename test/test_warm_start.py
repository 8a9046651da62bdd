# SPDX-License-Identifier: Apache-2.0
"""What weights of one network start of another."""

from dataclasses import replace

import pytest
import torch
from diamond import AFFORDING_NETWORK

from neugrasp_ros.errors import CheckpointError
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.model import GraspNetwork, load_network, save_network, warm_start


@pytest.fixture
def network() -> GraspNetwork:
    torch.manual_seed(0)
    return GraspNetwork(AFFORDING_NETWORK).eval()


@pytest.fixture
def weights(network, tmp_path):
    path = tmp_path / "network.safetensors"
    save_network(network, path)
    return path


def test_weights_without_heads_start_a_network_that_has_them(tmp_path):
    torch.manual_seed(1)
    old = GraspNetwork(replace(AFFORDING_NETWORK, affordances=()))
    save_network(old, tmp_path / "old.safetensors")
    torch.manual_seed(2)
    new = GraspNetwork(AFFORDING_NETWORK)
    before = {k: v.clone() for k, v in new.state_dict().items()}
    fresh = warm_start(new, tmp_path / "old.safetensors")
    assert fresh
    assert all("affordance" in key for key in fresh)
    for key, value in new.state_dict().items():
        expected = before[key] if key in fresh else old.state_dict()[key]
        assert torch.equal(value, expected), key


def test_weights_without_context_begin_one_with_it_as_they_were(network, weights):
    new = GraspNetwork(replace(AFFORDING_NETWORK, context=4)).eval()
    fresh = warm_start(new, weights)
    assert fresh
    assert all(key.startswith("context.") for key in fresh)
    torch.manual_seed(0)
    points, tokens = torch.randn(3, 5, POINT_FEATURES), torch.randn(3, TOKEN_FEATURES)
    planes, context = torch.randn(3, 5, 12), torch.randn(3, 5, 6)
    for old, now in zip(
        network.detector(points, tokens, planes),
        new.detector(points, tokens, planes, context),
        strict=True,
    ):
        torch.testing.assert_close(now, old)


def test_weights_with_context_begin_one_without_it(network, weights, tmp_path):
    wide = GraspNetwork(replace(AFFORDING_NETWORK, context=4)).eval()
    warm_start(wide, weights)
    save_network(wide, tmp_path / "wide.safetensors")
    narrow = GraspNetwork(AFFORDING_NETWORK).eval()
    assert warm_start(narrow, tmp_path / "wide.safetensors") == ()
    for key, value in network.state_dict().items():
        assert torch.equal(narrow.state_dict()[key], value), key


def test_a_part_head_is_left_where_the_network_has_none(tmp_path):
    torch.manual_seed(1)
    save_network(
        GraspNetwork(replace(AFFORDING_NETWORK, part_head=True)),
        tmp_path / "old.safetensors",
    )
    new = GraspNetwork(AFFORDING_NETWORK)
    assert warm_start(new, tmp_path / "old.safetensors") == ()
    old = load_network(tmp_path / "old.safetensors")[0].state_dict()
    assert all(torch.equal(v, old[k]) for k, v in new.state_dict().items())


def test_a_thing_head_is_new_or_left_and_the_rest_of_the_context_stays(tmp_path):
    torch.manual_seed(1)
    plain = replace(AFFORDING_NETWORK, context=4)
    for before, after in ((False, True), (True, False)):
        path = tmp_path / f"{before}.safetensors"
        save_network(GraspNetwork(replace(plain, thing_head=before)), path)
        network = GraspNetwork(replace(plain, thing_head=after))
        new = warm_start(network, path)
        assert len(new) == 4 * after
        assert all(key.startswith("context.things.") for key in new)
        old = load_network(path)[0].state_dict()
        for key in set(network.state_dict()) - set(new):
            assert torch.equal(network.state_dict()[key], old[key]), key


def test_a_view_along_the_hand_is_new_and_has_no_say_or_is_left(tmp_path):
    torch.manual_seed(1)
    plain = replace(AFFORDING_NETWORK, context=4)
    for before, after in ((0, 8), (8, 0)):
        path = tmp_path / f"{before}.safetensors"
        save_network(GraspNetwork(replace(plain, hand_view=before)), path)
        network = GraspNetwork(replace(plain, hand_view=after))
        new = warm_start(network, path)
        assert bool(new) == bool(after)
        assert all(key.startswith("hands.") for key in new)
        old = load_network(path)[0].state_dict()
        for key in set(network.state_dict()) - set(new):
            now, then = network.state_dict()[key], old[key]
            if now.shape != then.shape:
                assert key == "detector.affordance.decide.0.weight"
                shared = min(now.shape[1], then.shape[1])
                assert not now[:, shared:].any()
                now, then = now[:, :shared], then[:, :shared]
            assert torch.equal(now, then), key


@pytest.mark.parametrize("context", [0, 4])
def test_heads_are_left_where_the_network_has_none(context, tmp_path):
    torch.manual_seed(1)
    save_network(
        GraspNetwork(replace(AFFORDING_NETWORK, context=context)),
        tmp_path / "old.safetensors",
    )
    new = GraspNetwork(replace(AFFORDING_NETWORK, affordances=()))
    assert warm_start(new, tmp_path / "old.safetensors") == ()
    old = load_network(tmp_path / "old.safetensors")[0].state_dict()
    assert all(torch.equal(v, old[k]) for k, v in new.state_dict().items())


def test_weights_of_another_encoder_begin_the_rest(network, weights):
    new = GraspNetwork(replace(AFFORDING_NETWORK, unet="residual")).eval()
    fresh = warm_start(new, weights)
    assert fresh and all(key.startswith("scene.") for key in fresh)
    assert {key for key in new.state_dict() if key.startswith("scene.")} == set(fresh)
    for key, value in new.state_dict().items():
        assert key in fresh or torch.equal(value, network.state_dict()[key])


@pytest.mark.parametrize(
    ("change", "key"),
    [({"channels": 8}, "detector"), ({"affordances": ("a",)}, "detector.affordance")],
)
def test_weights_of_another_shape_do_not_start_a_network(weights, change, key):
    network = GraspNetwork(replace(AFFORDING_NETWORK, **change))
    with pytest.raises(CheckpointError, match=f"does not fit .*{key}"):
        warm_start(network, weights)
