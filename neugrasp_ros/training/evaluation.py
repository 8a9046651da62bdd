# SPDX-License-Identifier: Apache-2.0
"""How good the predictions are on labelled scenes that were not learned from.

In: weights and shards. Out: figures of quality and affordances, with intervals.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.training.figures import (
    MACRO,
    affordance_figures,
    average_precisions,
    intervals,
    quality_figures,
)
from neugrasp_ros.training.grasps import view_grasps
from neugrasp_ros.training.quality import Predictions, merged, predict
from neugrasp_ros.training.views import ViewRange

INTERVALS = ("auc", "ap", "ece")


@dataclass(frozen=True, eq=False)
class ViewScores:
    """The predictions of one view of one scene.

    Attributes:
        index: Number of the scene.
        kind: Kind of the scene.
        objects: Object set of the scene.
        gripper: Name of the gripper.
        scores: What was predicted and what is true.
        tried: Which grasps went through physics, shape (G,).
        left_out: Grasps that met no surface, so that nothing was predicted.
        left_out_positive: Successes among them.
    """

    index: int
    kind: str
    objects: str
    gripper: str
    scores: Predictions
    tried: NDArray[np.bool_]
    left_out: int
    left_out_positive: int


@torch.no_grad()
def score_scene(
    network: GraspNetwork, labels: SceneLabels, seed: int, view: int, threads: int = 1
) -> ViewScores | None:
    """Look at a labelled scene once and score its grasps.

    Args:
        network: In evaluation mode.
        labels: The scene.
        seed: Seed of view and noise, together with scene and view.
        view: Number of the view.
        threads: Worker threads.

    Returns:
        None if no grasp meets a surface.
    """
    rng = np.random.default_rng([seed, labels.index, view])
    entry = view_grasps(labels, network.scene, rng, threads=threads)
    if entry is None:
        return None
    return ViewScores(
        labels.index,
        labels.scene.kind,
        labels.scene.objects[0].set_name,
        labels.gripper.name,
        predict(network, [entry]),
        entry.tried,
        len(labels.grasps) - len(entry.labels),
        int(labels.grasps.labels.sum()) - int(entry.labels.sum()),
    )


def report(
    views: Sequence[ViewScores],
    classes: Sequence[str],
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Return the figures of all views, and of their parts.

    Args:
        views: At least one.
        classes: Names of the affordance classes; empty without heads.
        rng: Source of the bootstrap's randomness.

    Returns:
        ``quality`` (all grasps), ``tried`` (those that went through physics, the rest
        collides before the approach), ``by`` gripper, kind and object set, and, with
        heads, ``ap`` and ``prevalence`` per class, ``affordances``, ``ap_macro``.
        Figures that do not exist, such as a rate of nothing, are None.
    """
    figures: dict[str, Any] = {
        "scenes": len({view.index for view in views}),
        "views": len(views),
        "view_range": {
            k: np.float64(v).tolist() for k, v in asdict(ViewRange()).items()
        },
        "left_out": sum(view.left_out for view in views),
        "left_out_positive": sum(view.left_out_positive for view in views),
        "quality": _quality(_by_scene(views), rng),
        "tried": _quality(_by_scene(views, tried=True), rng),
        "by": {
            name: _by(views, key, rng)
            for name, key in (
                ("gripper", lambda view: view.gripper),
                ("kind", lambda view: view.kind),
                ("objects", lambda view: view.objects),
            )
        },
    }
    labelled = _by_scene(view for view in views if view.scores.known.any())
    if classes and labelled:
        figures |= _affordances(labelled, classes, rng)
    finite: dict[str, Any] = _finite(figures)
    return finite


def _by(
    views: Iterable[ViewScores],
    key: Callable[[ViewScores], str],
    rng: np.random.Generator,
) -> dict[str, Any]:
    groups: dict[str, list[ViewScores]] = {}
    for view in views:
        groups.setdefault(key(view), []).append(view)
    return {
        name: _quality(_by_scene(some), rng) for name, some in sorted(groups.items())
    }


def _by_scene(views: Iterable[ViewScores], *, tried: bool = False) -> list[Predictions]:
    """Join the views of each scene, whose grasps are the same.

    Args:
        views: The views.
        tried: Only grasps that went through physics.
    """
    scenes: dict[int, list[Predictions]] = {}
    for view in views:
        rows = view.tried if tried else np.ones_like(view.tried)
        scenes.setdefault(view.index, []).append(_rows(view.scores, rows))
    return [merged(parts) for parts in scenes.values()]


def _quality(parts: Sequence[Predictions], rng: np.random.Generator) -> dict[str, Any]:
    bounds = intervals(parts, quality_figures, rng)
    return {
        **quality_figures(merged(parts)),
        **{f"{name}_ci": bounds[name] for name in INTERVALS},
    }


def _affordances(
    parts: Sequence[Predictions], classes: Sequence[str], rng: np.random.Generator
) -> dict[str, Any]:
    scores = merged(parts)
    bounds = intervals(parts, lambda drawn: average_precisions(drawn, classes), rng)
    figures = {
        name: {**values, "ap_ci": bounds[name]}
        for name, values in affordance_figures(scores, classes).items()
    }
    return {
        "affordances": figures,
        "ap": {name: values["ap"] for name, values in figures.items()},
        "prevalence": {name: v["prevalence"] for name, v in figures.items()},
        "ap_macro": average_precisions(scores, classes)[MACRO],
        "ap_macro_ci": bounds[MACRO],
    }


def _rows(scores: Predictions, rows: NDArray[np.bool_]) -> Predictions:
    columns: list[Any] = [column[rows] for column in scores]
    return Predictions(*columns)


def _finite(value: Any) -> Any:
    """Return JSON-able values: None for what is not a number."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
