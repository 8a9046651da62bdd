# SPDX-License-Identifier: Apache-2.0
"""Which scored grasps are answered: affordance queries, thresholds, order."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, UnknownAffordanceError
from neugrasp_ros.grasp.ranking import distinct
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.settings import NmsConfig

FloatArray = NDArray[np.float64]

ANY, ALL = "|", "&"
DESCRIPTIONS = {
    "handover": "A grasp that leaves the part for a person's hand free.",
    "cut": "A grasp from which the blade can cut.",
    "stab": "A grasp from which the point can stab.",
    "lift": "A grasp at a handle or strap, to lift and carry.",
    "wrap": "A grasp around the body, to hold it firmly.",
    "pour": "A grasp from which the content can be poured out.",
    "wear": "A grasp from which the thing can be put on.",
}


@dataclass(frozen=True, slots=True)
class Query:
    """An affordance query.

    Attributes:
        text: As it was asked; empty = any grasp.
        names: The classes in it.
        every: All of them must hold, not any.
    """

    text: str = ""
    names: tuple[str, ...] = ()
    every: bool = False

    def score(self, affordances: FloatArray, labels: tuple[str, ...]) -> FloatArray:
        """Return the queried score of each grasp, NaN without a query.

        Any of several takes the largest probability, all of several the smallest.

        Args:
            affordances: Probability per class, shape (G, A).
            labels: Names of the classes.
        """
        if not self.names:
            return np.full(len(affordances), np.nan)
        columns = affordances[:, [labels.index(name) for name in self.names]]
        return np.asarray(columns.min(axis=1) if self.every else columns.max(axis=1))


def parse_query(text: str, labels: tuple[str, ...]) -> Query:
    """Read ``pour``, ``cut|stab`` (any of them) or ``pour&lift`` (all of them).

    Case and spaces do not matter.

    Raises:
        UnknownAffordanceError: If a name is none of ``labels``.
        ConfigError: If both signs are mixed or a name is empty.
    """
    if not text.strip():
        return Query()
    if ANY in text and ALL in text:
        raise ConfigError(f"affordance {text!r}: '|' and '&' cannot be mixed")
    names = [name.strip().lower() for name in text.split(ALL if ALL in text else ANY)]
    if not all(names):
        raise ConfigError(f"affordance {text!r}: a name is missing")
    known = {label.lower(): label for label in labels}
    for name in names:
        if name not in known:
            raise UnknownAffordanceError("affordance", name, labels)
    return Query(text, tuple(known[name] for name in names), ALL in text)


def rank_scores(grasps: GraspList, rank_by: str) -> FloatArray:
    """Return what grasps are ordered by, higher first, shape (G,).

    Args:
        grasps: Scored grasps in a frame whose z is up.
        rank_by: ``quality``, ``affordance``, their product, or ``height``; without a
            query the affordance counts as 1.
    """
    quality = np.nan_to_num(grasps.grasps.quality, nan=0.0)
    affordance = np.nan_to_num(grasps.affordance, nan=1.0)
    if rank_by == "height":
        return grasps.grasps.poses[:, 2, 3]
    if rank_by == "affordance":
        return affordance + 1e-6 * quality  # quality decides between equals
    return quality if rank_by == "quality" else quality * affordance


def ranked(grasps: GraspList, rank_by: str, nms: NmsConfig) -> GraspList:
    """Return distinct grasps, best first."""
    if not len(grasps):
        return grasps
    scores = rank_scores(grasps, rank_by)
    rows = distinct(
        grasps.grasps.poses, scores, nms.distance, float(np.deg2rad(nms.angle_deg))
    )
    return grasps.take(rows)


def with_query(grasps: GraspList, query: Query) -> GraspList:
    """Return scored grasps with the score of the query."""
    score = query.score(grasps.grasps.affordances, grasps.info.labels)
    info = replace(grasps.info, query=query.text)
    return replace(grasps, info=info, affordance=score)


def describe(label: str) -> str:
    """Return what a grasp is good for that affords ``label``, in one sentence."""
    return DESCRIPTIONS.get(label.lower(), f"A grasp that affords {label}.")
