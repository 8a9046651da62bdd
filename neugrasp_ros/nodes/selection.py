# SPDX-License-Identifier: Apache-2.0
"""Scored grasps in the order they are answered in, and what they serve."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.grasp.queries import Query, expected_gain
from neugrasp_ros.grasp.ranking import distinct
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.settings import SelectionConfig

FloatArray = NDArray[np.float64]

DESCRIPTIONS = {
    "handover": "A grasp that leaves the part for a person's hand free.",
    "cut": "A grasp from which the blade can cut.",
    "stab": "A grasp from which the point can stab.",
    "lift": "A grasp at a handle or strap, to lift and carry.",
    "wrap": "A grasp around the body, to hold it firmly.",
    "pour": "A grasp from which the content can be poured out.",
    "wear": "A grasp from which the thing can be put on.",
}


def rank_scores(grasps: GraspList, config: SelectionConfig) -> FloatArray:
    """Return what grasps are ordered by, higher first, shape (G,).

    Args:
        grasps: Scored grasps in a frame whose z is up.
        config: ``rank_by``: ``quality``, ``affordance``, their product with
            ``affordance_weight`` (``expected_gain``), or ``height``. Without a query
            the affordance counts as 1.
    """
    quality = np.nan_to_num(grasps.grasps.quality, nan=0.0)
    if config.rank_by == "height":
        return grasps.grasps.poses[:, 2, 3]
    if config.rank_by == "affordance":
        affordance = np.nan_to_num(grasps.affordance, nan=1.0)
        return affordance + 1e-6 * quality  # quality decides between equals
    if config.rank_by == "quality":
        return quality
    return expected_gain(quality, grasps.affordance, config.affordance_weight)


def ranked(grasps: GraspList, config: SelectionConfig) -> GraspList:
    """Return distinct grasps, best first."""
    if not len(grasps):
        return grasps
    scores, nms = rank_scores(grasps, config), config.nms
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
