# SPDX-License-Identifier: Apache-2.0
"""Several processes as one training, when ``torchrun`` has started them."""

import os
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import nn

PATIENCE = timedelta(days=2)  # others wait while the first one renders scenes
LAST_WORK = 0.2  # [s] for gloo's threads to let go of it; else leaving aborts at times

Value = TypeVar("Value")


@contextmanager
def processes() -> Iterator[None]:
    """Join the other processes of a ``torchrun`` around a block; nothing for one."""
    if int(os.environ.get("WORLD_SIZE", "1")) <= 1:
        yield
        return
    backend = "nccl" if torch.cuda.is_available() else "gloo"
    dist.init_process_group(backend, timeout=PATIENCE)
    try:
        yield
        dist.barrier()
        time.sleep(LAST_WORK)
    finally:
        dist.destroy_process_group()


def is_distributed() -> bool:
    """Tell whether there are other processes."""
    return bool(dist.is_available() and dist.is_initialized())


def process_count() -> int:
    """Return how many processes train together."""
    return dist.get_world_size() if is_distributed() else 1


def process_rank() -> int:
    """Return the number of this process, from 0."""
    return dist.get_rank() if is_distributed() else 0


def is_first_process() -> bool:
    """Tell whether this process is the one that writes."""
    return process_rank() == 0


def own_share(values: Sequence[Value]) -> Sequence[Value]:
    """Return every n-th value for one of n processes; all where there are too few."""
    return values[process_rank() :: process_count()] or values


@contextmanager
def first_on_machine() -> Iterator[bool]:
    """Let one process of each machine do a block's work while the others wait.

    Yields:
        True in the process that is to do it.
    """
    yield int(os.environ.get("LOCAL_RANK", "0")) == 0
    if is_distributed():
        dist.barrier()


def share_weights(model: nn.Module) -> None:
    """Give all processes the first one's parameters and buffers."""
    if is_distributed():
        for value in model.state_dict().values():
            dist.broadcast(value, src=0)


def average_gradients(parameters: Iterable[nn.Parameter]) -> None:
    """Replace gradients by their mean over the processes.

    A parameter that this process has not used counts as zero there.
    """
    if not is_distributed():
        return
    for parameter in parameters:
        if parameter.grad is None:
            parameter.grad = torch.zeros_like(parameter)
        dist.all_reduce(parameter.grad)
        parameter.grad /= dist.get_world_size()
