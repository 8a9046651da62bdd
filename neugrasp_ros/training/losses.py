# SPDX-License-Identifier: Apache-2.0
"""Losses that torch does not have."""

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

EPSILON = 1e-6
FOCUS = 2  # exponent of the focal loss, its gamma


def known_entropy(logits: Tensor, targets: Tensor, known: Tensor) -> Tensor:
    """Return the mean cross entropy over what is known; 0 if nothing is.

    Args:
        logits: Shape (..., A), or that of ``known``.
        targets: 0 or 1, of the same shape.
        known: Which rows count, shape (...).
    """
    logits = logits.float()  # sums are too coarse in what mixed precision computes
    weight = known.to(logits.dtype)
    if logits.dim() > known.dim():
        weight = weight[..., None].expand_as(logits)
    total = binary_cross_entropy_with_logits(logits, targets, weight, reduction="sum")
    return total / weight.sum().clamp(min=1.0)


def focal_loss(logits: Tensor, targets: Tensor) -> Tensor:
    """Return the focal loss, summed over the classes, a mean over the rows.

    With q the probability given to what is true, ``-(1 - q)**2 log q`` (Lin et al.,
    2017, equation 4). What is known already weighs little, so a class that is hard in
    few rows, such as whether a blade has a point, is not lost among the rest.

    Args:
        logits: Shape (N, A).
        targets: 0 or 1, of the same shape.
    """
    entropy = binary_cross_entropy_with_logits(
        logits.float(), targets, reduction="none"
    )
    missed = 1 - (-entropy).exp()
    return (missed**FOCUS * entropy).sum(dim=-1).mean()


def overlap_loss(logits: Tensor, targets: Tensor, counted: Tensor) -> Tensor:
    """Return what the soft intersection over union lacks to 1, a mean over scenes.

    With p the predicted and t the true values of a scene, S a sum over its points:

        loss = 1 - (S(p t) + 1) / (S(p + t - p t) + 1)

    Cross entropy alone asks for a probability, and where that is 0.5 is not where the
    expected IoU is best.

    Args:
        logits: Shape (B, N).
        targets: 0 or 1, of the same shape.
        counted: Which points count: those drawn evenly, so that they measure volume.
    """
    p = logits.float().sigmoid()
    both = p * targets
    inner = (both * counted).sum(dim=1)
    outer = ((p + targets - both) * counted).sum(dim=1)
    return (1 - (inner + 1) / (outer + 1)).mean()


def affordance_loss(logits: Tensor, targets: Tensor, known: Tensor) -> Tensor:
    """Return cross entropy plus dice, summed over the classes (method sheet, e).

    With p the predicted and t the true values of a class, S a sum over the grasps:

        dice = 1 - (S(p t) + e) / (S(p + t) + e)
                 - (S((1 - p)(1 - t)) + e) / (S(2 - p - t) + e)

    Grasps that are not known, failed ones above all, count in neither term.

    Args:
        logits: Shape (G, A).
        targets: 0 or 1, shape (G, A).
        known: Which grasps count, shape (G,).

    Returns:
        A scalar; 0 if no grasp counts.
    """
    logits = logits.float()
    weight = known.to(logits.dtype)[:, None]
    entropy = binary_cross_entropy_with_logits(logits, targets, reduction="none")
    entropy = (weight * entropy).sum(dim=0) / weight.sum().clamp(min=1.0)
    p = logits.sigmoid()
    both = (weight * p * targets).sum(dim=0)
    neither = (weight * (1 - p) * (1 - targets)).sum(dim=0)
    yes = (weight * (p + targets)).sum(dim=0)
    no = (weight * (2 - p - targets)).sum(dim=0)
    dice = 1 - (both + EPSILON) / (yes + EPSILON) - (neither + EPSILON) / (no + EPSILON)
    return torch.where(known.any(), (entropy + dice).sum(), logits.sum() * 0.0)
