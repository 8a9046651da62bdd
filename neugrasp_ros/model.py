# SPDX-License-Identifier: Apache-2.0
"""The whole network, and its weights on disk."""

import hashlib
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from neugrasp_ros.config import NetworkConfig, override
from neugrasp_ros.errors import CheckpointError, ConfigError, NeuGraspError
from neugrasp_ros.grasp.pointnet import DETECTORS
from neugrasp_ros.resources import weights_dir
from neugrasp_ros.scene.context import ContextNet
from neugrasp_ros.scene.hand_view import HandView
from neugrasp_ros.scene.network import SceneNetwork

FORMAT = "neugrasp-1"
SCENE, CONTEXT, PARTS, HANDS = "scene.", "context.", "parts.", "hands."
"""How names of tensors begin."""
AFFORDANCE_HEAD = "detector.affordance."
AFFORDANCES = AFFORDANCE_HEAD, "affordance_calibration"
NOT_QUALITY = CONTEXT, PARTS, HANDS, *AFFORDANCES
ENCODER, RESIDUAL = "scene.encoder.", "scene.encoder.unet."


class GraspNetwork(nn.Module):
    """Scene network and detector, trained jointly.

    The part head says of a surface point what holding its part affords. It is there to
    teach the shared planes what things are: points are labelled by the million, grasps
    by the thousand.

    Args:
        config: The network's shape.

    Raises:
        UnknownNameError: If an encoder or detector is not in its registry.
    """

    calibration: Tensor  # scale and bias of the quality logits, shape (2,)
    affordance_calibration: Tensor  # those of each class, shape (A, 2)

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.scene = SceneNetwork(config)
        self.detector = DETECTORS[config.detector](config)
        self.register_buffer("calibration", torch.tensor([1.0, 0.0]))
        if config.affordances:
            same = torch.tensor([1.0, 0.0]).repeat(len(config.affordances), 1)
            self.register_buffer("affordance_calibration", same)
        if config.part_head:
            self.parts = nn.Linear(3 * config.channels, len(config.affordances))
        self.context = ContextNet(config) if config.context else None
        self.hands = HandView(config) if config.hand_view else None

    def probability(self, quality_logits: Tensor) -> Tensor:
        """Turn quality logits into calibrated probabilities (Platt scaling)."""
        scale, bias = self.calibration
        return torch.sigmoid(scale * quality_logits + bias)

    def affordance_probability(self, logits: Tensor) -> Tensor:
        """Turn affordance logits (G, A) into calibrated probabilities, per class.

        They say what a grasp is good for given that it holds.
        """
        if not self.config.affordances:
            return logits
        scale, bias = self.affordance_calibration.unbind(dim=1)
        return torch.sigmoid(scale * logits + bias)


def default_weights() -> Path:
    """Return the path of the weights that ship with the package."""
    return weights_dir() / "neugrasp_cpu.safetensors"


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a weights file, as reports quote it.

    Raises:
        CheckpointError: If the file cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise CheckpointError(path, f"cannot be read ({error.strerror})") from error


def quality_sha256(network: GraspNetwork) -> str:
    """Return a SHA-256 of all that decides what is promised of a grasp's success.

    Weights that differ in context and affordances alone have the same.
    """
    shape = asdict(network.config) | {
        "affordances": (),
        "part_head": False,
        "context": 0,
    }
    for younger in ("thing_head", "hand_view"):  # than the hashes in reports
        del shape[younger]
    digest = hashlib.sha256(json.dumps(shape).encode())
    for key, tensor in sorted(network.state_dict().items()):
        if not key.startswith(NOT_QUALITY):
            digest.update(key.encode() + tensor.cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def save_network(
    network: GraspNetwork, path: Path, card: dict[str, Any] | None = None
) -> None:
    """Write weights, the configuration they need, and how they were made.

    The file appears only when it is whole. The matrices of the context and of a
    residual U-Net, most of a network that has them, are stored in half precision and
    read back in single.

    Args:
        network: The network.
        path: A ``.safetensors`` file.
        card: Facts about data and training, JSON-able.
    """
    metadata = {
        "format": FORMAT,
        "config": json.dumps(asdict(network.config)),
        "card": json.dumps(card or {}),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    large = (CONTEXT, RESIDUAL) if network.config.unet == "residual" else (CONTEXT,)
    tensors = {
        key: _stored(tensor, key.startswith(large))
        for key, tensor in network.state_dict().items()
    }
    part = path.with_suffix(".part")
    save_file(tensors, part, metadata=metadata)
    os.replace(part, path)


def _stored(tensor: Tensor, is_large: bool) -> Tensor:
    return (tensor.half() if is_large and tensor.dim() > 1 else tensor).contiguous()


def load_network(path: Path) -> tuple[GraspNetwork, dict[str, Any]]:
    """Build a network from a weights file, by the configuration stored in it.

    Args:
        path: A ``.safetensors`` file written by ``save_network``.

    Returns:
        The network in evaluation mode, and its card.

    Raises:
        CheckpointError: If the file is missing, damaged, of another format, or does
            not hold exactly the weights that its configuration needs.
    """
    if not path.is_file():
        raise CheckpointError(
            path, "no such weights file; `neugrasp train --help` says how to make one"
        )
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(
            path, f"not a whole safetensors file ({error})"
        ) from error
    if metadata.get("format") != FORMAT:
        raise CheckpointError(
            path, f"format {metadata.get('format')!r}, expected {FORMAT!r}"
        )
    values, card = (_mapping(metadata, key, path) for key in ("config", "card"))
    try:
        network = GraspNetwork(override(NetworkConfig, values, where="config"))
    except NeuGraspError as error:
        raise CheckpointError(path, f"unusable configuration ({error})") from error
    _load_exactly(network, tensors, path)
    return network.eval(), card


def placed(network: GraspNetwork, device: str) -> GraspNetwork:
    """Move a network to a torch device.

    Args:
        network: Moved in place, and returned.
        device: As torch names it, such as ``cuda:0``.

    Raises:
        ConfigError: If torch has no such device here, naming those it has.
    """
    try:
        return network.to(device)
    except (AssertionError, RuntimeError) as error:  # torch's word for "none here"
        known = ["cpu", *(f"cuda:{i}" for i in range(torch.cuda.device_count()))]
        reason = str(error).partition("\n")[0]
        raise ConfigError(
            f"device {device!r} cannot be used; torch {torch.__version__} has "
            f"{', '.join(known)} here ({reason})"
        ) from error


def warm_start(network: GraspNetwork, path: Path) -> tuple[str, ...]:
    """Take over the weights of a file; what it lacks stays as it is.

    Weights of a network with another encoder start all but the scene network. Those of
    a network without affordance heads start one that has them. Those of one without
    context start one with it, whose affordance head then reads more that has no say in
    the beginning; and the other way round, where it reads less. The same goes for the
    view along the hand. Heads that the network does not have are left out.

    Args:
        network: Changed in place.
        path: A weights file of the same shape, apart from encoder, heads, context
            and view along the hand.

    Returns:
        Names of the tensors that the file does not have.

    Raises:
        CheckpointError: If the file cannot be used, or holds a tensor that the network
            has not, or has in another shape.
    """
    source, _ = load_network(path)
    tensors, own = source.state_dict(), network.state_dict()
    heads = () if network.config.affordances else AFFORDANCES
    tensors = {
        k: v
        for k, v in tensors.items()
        if k in own or not k.startswith((CONTEXT, PARTS, HANDS, *heads))
    }
    if _told(network.config) != _told(source.config):
        tensors = {k: _fitted(k, v, own.get(k)) for k, v in tensors.items()}
    if _encoder_shapes(tensors) != _encoder_shapes(own):
        tensors = {k: v for k, v in tensors.items() if not k.startswith(SCENE)}
    wrong = sorted(
        k for k, v in tensors.items() if k not in own or own[k].shape != v.shape
    )
    if wrong:
        raise CheckpointError(
            path, f"does not fit {network.config}: it differs in {', '.join(wrong)}"
        )
    network.load_state_dict(tensors, strict=False)
    return tuple(sorted(set(own) - set(tensors)))


def _told(config: NetworkConfig) -> tuple[bool, bool]:
    """Return what the affordance head is told besides the local surface."""
    return bool(config.context), bool(config.hand_view)


def _encoder_shapes(tensors: dict[str, Tensor]) -> dict[str, torch.Size]:
    return {k: v.shape for k, v in tensors.items() if k.startswith(ENCODER)}


def _fitted(key: str, tensor: Tensor, own: Tensor | None) -> Tensor:
    """Return a layer of the affordance head without what it is told besides.

    That comes last among its inputs; those that it has not had have zeros.
    """
    if own is None or not key.startswith(AFFORDANCE_HEAD):
        return tensor
    if tensor.dim() != 2 or own.shape[0] != tensor.shape[0]:
        return tensor
    return nn.functional.pad(tensor, (0, own.shape[1] - tensor.shape[1]))


def _mapping(metadata: dict[str, str], key: str, path: Path) -> dict[str, Any]:
    try:
        values = json.loads(metadata.get(key, "null"))
    except json.JSONDecodeError as error:
        raise CheckpointError(path, f"its {key} is not JSON ({error})") from error
    if not isinstance(values, dict):
        raise CheckpointError(path, f"its {key} is no JSON object, got {values!r}")
    return values


def _load_exactly(
    network: GraspNetwork, tensors: dict[str, torch.Tensor], path: Path
) -> None:
    expected = network.state_dict()
    missing = sorted(set(expected) - set(tensors))
    unknown = sorted(set(tensors) - set(expected))
    if missing or unknown:
        raise CheckpointError(path, f"missing weights {missing}, unknown {unknown}")
    for key, tensor in tensors.items():
        if tensor.shape != expected[key].shape:
            raise CheckpointError(
                path,
                f"{key}: expected shape {tuple(expected[key].shape)}, "
                f"got {tuple(tensor.shape)}",
            )
        if not torch.isfinite(tensor.float()).all():
            raise CheckpointError(path, f"{key} holds values that are not finite")
    network.load_state_dict(tensors)
