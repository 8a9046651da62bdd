# SPDX-License-Identifier: Apache-2.0
"""A training run in files small enough to commit, for when the machine is replaced.

In: the ``state.pt`` of each stage of a run. Out: per stage a JSON file and safetensors
files of at most 40 MB (unless one tensor alone is larger): weights as they are, the
optimiser's moments in half precision, and none of a stage that has ended. Rendered
views are not among them: they are made again from the labels.
"""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from neugrasp_ros.errors import CheckpointError

MAX_BYTES = 38_000_000  # of one file
STATE_FILE = "state.pt"
MOMENTS = ("exp_avg", "exp_avg_sq")  # bfloat16 keeps the range of the second
WEIGHTS, OPTIMISER, RANDOM = "weights", "optimiser", "random"


def pack_stage(folder: Path, out: Path, steps: int) -> list[Path]:
    """Write what a stage needs to go on, in small files.

    Args:
        folder: The stage's folder, with its ``state.pt``.
        out: Where to; files of the same stage are replaced.
        steps: Steps of the whole stage.

    Returns:
        The files.
    """
    state = torch.load(folder / STATE_FILE, weights_only=True)
    tensors = {f"{WEIGHTS}.{k}": v.contiguous() for k, v in state["model"].items()}
    tensors[RANDOM] = state["random"]
    record = {key: state[key] for key in ("stage", "step", "history")}
    record["groups"] = state["optimiser"]["param_groups"]
    if state["step"] < steps:
        tensors |= dict(_moments(state["optimiser"]["state"]))
    out.mkdir(parents=True, exist_ok=True)
    before = set(_files(out, folder.name))
    parts = _parts(tensors)
    name = f"{folder.name}_{state['step']:07d}"
    files = [out / f"{name}_{n:02d}.safetensors" for n in range(len(parts))]
    for path, part in zip(files, parts, strict=True):
        save_file(part, path)
    record["files"] = [path.name for path in files]
    about = out / f"{folder.name}.json"
    partial = about.with_suffix(".part")
    partial.write_text(json.dumps(record) + "\n")
    os.replace(partial, about)
    for path in before - set(files):
        path.unlink()
    return [about, *files]


def unpack_stage(out: Path, folder: Path) -> bool:
    """Make the ``state.pt`` of a stage from its small files, if it has none.

    Args:
        out: Where ``pack_stage`` wrote.
        folder: The stage's folder.

    Returns:
        Whether it was made.

    Raises:
        CheckpointError: If a file is missing or damaged.
    """
    about = out / f"{folder.name}.json"
    if (folder / STATE_FILE).exists():
        return False
    if not about.is_file():
        if _files(out, folder.name):
            raise CheckpointError(
                about, "is missing, but the stage's tensors are there"
            )
        return False
    try:
        record = json.loads(about.read_text())
        tensors: dict[str, Tensor] = {}
        for name in record["files"]:
            tensors |= load_file(out / name)
        state = _state(record, tensors)
    except (KeyError, ValueError, OSError, SafetensorError) as error:
        raise CheckpointError(about, f"cannot be resumed from ({error})") from error
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / "state.part"
    torch.save(state, partial)
    os.replace(partial, folder / STATE_FILE)
    return True


def drop_stage(out: Path, stage: str) -> None:
    """Remove the small files of a stage."""
    (out / f"{stage}.json").unlink(missing_ok=True)
    for path in _files(out, stage):
        path.unlink()


def _files(out: Path, stage: str) -> list[Path]:
    return sorted(out.glob(f"{stage}_*_[0-9][0-9].safetensors"))


def _moments(states: dict[int, dict[str, Tensor]]) -> Iterator[tuple[str, Tensor]]:
    for index, values in states.items():
        for key, value in values.items():
            small = value.to(torch.bfloat16) if key in MOMENTS else value
            yield f"{OPTIMISER}.{index}.{key}", small.contiguous()


def _parts(tensors: dict[str, Tensor]) -> list[dict[str, Tensor]]:
    """Share tensors out over files, in their order."""
    parts: list[dict[str, Tensor]] = [{}]
    size = 0
    for name, tensor in tensors.items():
        if parts[-1] and size + tensor.nbytes > MAX_BYTES:
            parts.append({})
            size = 0
        parts[-1][name] = tensor
        size += tensor.nbytes
    return parts


def _state(record: dict[str, Any], tensors: dict[str, Tensor]) -> dict[str, Any]:
    states: dict[int, dict[str, Tensor]] = {}
    model: dict[str, Tensor] = {}
    for name, tensor in tensors.items():
        kind, _, rest = name.partition(".")
        if kind == WEIGHTS:
            model[rest] = tensor
        elif kind == OPTIMISER:
            index, _, key = rest.partition(".")
            value = tensor.float() if key in MOMENTS else tensor
            states.setdefault(int(index), {})[key] = value
    return {
        "stage": record["stage"],
        "step": record["step"],
        "history": record["history"],
        "model": model,
        "optimiser": {"state": states, "param_groups": record["groups"]},
        "random": tensors[RANDOM],
    }
