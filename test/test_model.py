# SPDX-License-Identifier: Apache-2.0
import hashlib
import json
from dataclasses import asdict, replace

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from neugrasp_ros.config import PAPER_NETWORK, NetworkConfig
from neugrasp_ros.errors import CheckpointError, NeuGraspError, UnknownNameError
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.grasp.pointnet import DECODERS, DETECTORS
from neugrasp_ros.model import (
    FORMAT,
    GraspNetwork,
    file_sha256,
    load_network,
    quality_sha256,
    save_network,
    warm_start,
)
from neugrasp_ros.scene.encoder import ENCODERS

SMALL = NetworkConfig(
    resolution=16,
    plane_resolution=8,
    channels=4,
    unet_depth=2,
    unet_channels=4,
    occupancy_hidden=8,
    occupancy_blocks=2,
    local_points=16,
    pointnet_width=8,
    pointnet_out=16,
    affordances=("cut", "pour"),
)


@pytest.fixture
def network() -> GraspNetwork:
    torch.manual_seed(0)
    return GraspNetwork(SMALL).eval()


@pytest.fixture
def weights(network, tmp_path):
    path = tmp_path / "deep" / "w.safetensors"
    save_network(network, path, {"scenes": 3})
    return path


@pytest.fixture
def rewrite(weights, tmp_path):
    """Return a function that writes the weights again, changed."""

    def write(change=lambda tensors: None, **metadata) -> str:
        with safe_open(weights, framework="pt") as file:
            known = file.metadata()
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
        change(tensors)
        path = tmp_path / "changed.safetensors"
        told = {k: v for k, v in (known | metadata).items() if v is not None}
        save_file(tensors, path, metadata=told)
        return path

    return write


def score(network: GraspNetwork) -> tuple[torch.Tensor, torch.Tensor]:
    """Run everything once on fixed inputs."""
    generator = torch.Generator().manual_seed(1)
    size, classes = network.config.resolution, network.config.channels * 3
    planes = network.scene.encode(
        torch.randn(2, 3, size, size, size, generator=generator)
    )
    points = torch.rand(2, 6, 3, generator=generator)
    features = network.scene.features(planes, points)
    assert features.shape == (2, 6, classes)
    quality, _ = network.detector(
        torch.randn(2, 6, POINT_FEATURES, generator=generator),
        torch.randn(2, TOKEN_FEATURES, generator=generator),
        features,
    )
    return network.scene.occupancy(planes, points), quality


@torch.no_grad()
def test_weights_come_back_with_their_config_and_card(network, weights):
    loaded, card = load_network(weights)
    assert loaded.config == SMALL
    assert card == {"scenes": 3}
    assert not loaded.training
    for one, other in zip(score(loaded), score(network), strict=True):
        assert torch.equal(one, other)


def test_only_the_whole_file_appears(weights):
    assert [p.name for p in weights.parent.iterdir()] == ["w.safetensors"]


def test_the_quoted_sum_is_that_of_the_file(weights):
    assert file_sha256(weights) == hashlib.sha256(weights.read_bytes()).hexdigest()
    with pytest.raises(CheckpointError, match="cannot be read"):
        file_sha256(weights.with_name("none"))


def test_a_missing_file_says_how_to_make_one(tmp_path):
    with pytest.raises(CheckpointError, match="neugrasp train") as raised:
        load_network(tmp_path / "none.safetensors")
    assert raised.value.path == tmp_path / "none.safetensors"


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.999])
def test_a_truncated_file_is_told(weights, share):
    content = weights.read_bytes()
    weights.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CheckpointError, match="not a whole safetensors file"):
        load_network(weights)


def test_a_file_of_something_else_is_told(tmp_path):
    path = tmp_path / "w.safetensors"
    torch.save({"a": torch.zeros(3)}, path)
    with pytest.raises(CheckpointError, match="not a whole safetensors file"):
        load_network(path)


@pytest.mark.parametrize("marker", ["neugrasp-0", None])
def test_another_format_is_told(rewrite, marker):
    with pytest.raises(CheckpointError, match=f"expected '{FORMAT}'"):
        load_network(rewrite(format=marker))


@pytest.mark.parametrize(
    ("config", "told"),
    [
        (json.dumps(asdict(SMALL) | {"depth": 3}), r"unknown \['depth'\]"),
        (json.dumps(asdict(SMALL) | {"channels": 0}), "channels must be in"),
        (json.dumps(asdict(SMALL) | {"channels": "four"}), "channels must be"),
        (
            json.dumps(asdict(SMALL) | {"detector": "oracle"}),
            "unknown detector 'oracle'",
        ),
        (json.dumps(asdict(SMALL) | {"plane_resolution": 5}), "must divide"),
        (json.dumps([1, 2]), "its config is no JSON object"),
        ("{half", "its config is not JSON"),
        (None, "its config is no JSON object"),
    ],
)
def test_a_config_that_cannot_be_used_is_told(rewrite, config, told):
    with pytest.raises(CheckpointError, match=told):
        load_network(rewrite(config=config))


def test_a_broken_card_is_told(rewrite):
    with pytest.raises(CheckpointError, match="card"):
        load_network(rewrite(card="{half"))


def test_weights_for_another_shape_name_the_first_that_differs(rewrite):
    wider = json.dumps(asdict(replace(SMALL, occupancy_hidden=12)))
    with pytest.raises(CheckpointError, match=r"scene\..*expected shape .*12.*got .*8"):
        load_network(rewrite(config=wider))


def test_missing_and_unknown_weights_are_named(rewrite):
    def swap(tensors):
        tensors["extra"] = tensors.pop("scene.decoder.logit.bias")

    told = r"missing weights \['scene.decoder.logit.bias'\], unknown \['extra'\]"
    with pytest.raises(CheckpointError, match=told):
        load_network(rewrite(swap))


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_told(rewrite, value):
    def spoil(tensors):
        tensors["scene.decoder.logit.bias"][0] = value

    with pytest.raises(
        CheckpointError, match="logit.bias holds values that are not fin"
    ):
        load_network(rewrite(spoil))


def test_a_weights_error_is_ours(tmp_path):
    with pytest.raises(NeuGraspError):
        load_network(tmp_path)


def test_calibration_is_the_identity_until_it_is_fitted(network):
    logits = torch.linspace(-3, 3, 7)
    torch.testing.assert_close(network.probability(logits), logits.sigmoid())
    network.calibration.copy_(torch.tensor([2.0, -1.0]))
    torch.testing.assert_close(
        network.probability(logits), torch.sigmoid(2 * logits - 1)
    )


def test_an_unknown_detector_is_answered_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="unknown detector 'oracle'.*neugrasp"):
        GraspNetwork(replace(SMALL, detector="oracle"))


def test_the_papers_network_is_within_its_size():
    with torch.device("meta"):
        network = GraspNetwork(PAPER_NETWORK)
    count = sum(p.numel() for p in network.parameters())
    assert count == pytest.approx(33.9e6, rel=0.05)  # the paper's has a width head


@pytest.mark.parametrize("unet", ["plain", "residual"])
def test_what_is_large_is_stored_in_half_precision_and_all_else_as_it_is(
    tmp_path, unet
):
    network = GraspNetwork(replace(SMALL, context=4, unet=unet))
    path = tmp_path / "context.safetensors"
    save_network(network, path)
    with safe_open(path, framework="pt") as file:
        keys = list(file.keys())
        halves = {k for k in keys if file.get_tensor(k).dtype == torch.half}
    large = {key.partition(".unet.")[0] for key in halves if ".unet." in key}
    assert large == ({"scene.encoder"} if unet == "residual" else set())
    assert {key for key in halves if key.startswith("context.")}
    assert all(key.startswith(("context.", "scene.encoder.unet.")) for key in halves)
    again = load_network(path)[0].state_dict()
    for key, tensor in network.state_dict().items():
        assert again[key].dtype == tensor.dtype
        tolerance = 1e-3 if key in halves else 0.0
        torch.testing.assert_close(again[key], tensor, rtol=tolerance, atol=1e-6)


@pytest.mark.parametrize("head", ["part_head", "thing_head", "hand_view"])
def test_the_hash_of_the_quality_tells_what_else_differs_apart(weights, head):
    first = load_network(weights)[0]
    wider = GraspNetwork(replace(SMALL, context=4, **{head: 1}))
    warm_start(wider, weights)
    wider.affordance_calibration += 1
    assert quality_sha256(wider) == quality_sha256(first)
    for key in ("calibration", "detector.read.bias", "scene.decoder.logit.bias"):
        other = load_network(weights)[0]
        other.state_dict()[key] += 1e-3
        assert quality_sha256(other) != quality_sha256(first), key


def test_affordance_probabilities_have_a_scale_and_a_bias_a_class(network):
    network.affordance_calibration.copy_(torch.tensor([[2.0, 0.0], [1.0, -1.0]]))
    logits = torch.tensor([[0.5, 1.0], [-1.0, 3.0]])
    expected = torch.sigmoid(torch.tensor([[1.0, 0.0], [-2.0, 2.0]]))
    torch.testing.assert_close(network.affordance_probability(logits), expected)
    bare = GraspNetwork(replace(SMALL, affordances=()))
    assert bare.affordance_probability(torch.zeros(3, 0)).shape == (3, 0)


@pytest.fixture
def rival_parts():
    """An encoder, a decoder and a detector that only this test knows."""

    @ENCODERS.register("test-mean")
    class MeanEncoder(torch.nn.Module):
        """Every cell of every plane tells the mean of the volume."""

        def __init__(self, config: NetworkConfig) -> None:
            super().__init__()
            self.size = config.plane_resolution
            self.mix = torch.nn.Linear(3, 3 * config.channels)

        def forward(self, volume: torch.Tensor) -> torch.Tensor:
            flat = self.mix(volume.mean(dim=(2, 3, 4))).unflatten(1, (3, -1))
            return flat[..., None, None].expand(-1, -1, -1, self.size, self.size)

    @DETECTORS.register("test-linear")
    class LinearDetector(torch.nn.Module):
        """One layer on the mean of all that is given."""

        def __init__(self, config: NetworkConfig) -> None:
            super().__init__()
            inputs = POINT_FEATURES + TOKEN_FEATURES + 3 * config.channels
            self.decide = torch.nn.Linear(inputs, 1)

        def forward(self, point_features, tokens, plane_features):
            means = [point_features.mean(1), tokens, plane_features.mean(1)]
            quality = self.decide(torch.cat(means, dim=1))[:, 0]
            return quality, quality.new_zeros(len(quality), 0)

    @DECODERS.register("test-mean")
    class MeanDecoder(torch.nn.Module):
        """One layer on the mean of the points."""

        def __init__(self, inputs: int, config: NetworkConfig) -> None:
            super().__init__()
            self.layer = torch.nn.Linear(inputs, config.pointnet_out)

        def forward(self, points: torch.Tensor) -> torch.Tensor:
            return self.layer(points.mean(dim=1))

    yield
    for table in (ENCODERS, DECODERS, DETECTORS):
        for name in [n for n in table._builders if n.startswith("test-")]:
            del table._builders[name]


@pytest.mark.parametrize(
    "parts",
    [
        {"encoder": "test-mean"},
        {"decoder": "test-mean"},
        {"encoder": "test-mean", "detector": "test-linear"},
    ],
)
def test_a_rival_part_needs_no_change_elsewhere(rival_parts, tmp_path, parts):
    torch.manual_seed(0)
    config = replace(SMALL, affordances=(), **parts)
    network = GraspNetwork(config).eval()  # no dropout, so that the loss can fall to 0
    optimiser = torch.optim.Adam(network.parameters(), lr=0.02)
    losses = []
    for _ in range(20):
        occupancy, quality = score(network)
        loss = (occupancy - 1).square().mean() + (quality - 1).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.5 * losses[0]
    save_network(network, tmp_path / "rival.safetensors")
    loaded, _ = load_network(tmp_path / "rival.safetensors")
    assert loaded.config == config
    with torch.no_grad():
        for one, other in zip(score(loaded), score(network), strict=True):
            torch.testing.assert_close(one, other)
