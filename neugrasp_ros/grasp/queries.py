# SPDX-License-Identifier: Apache-2.0
"""Affordance queries: what is asked for, how well grasps answer it, in which order."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, UnknownAffordanceError

FloatArray = NDArray[np.float64]

ANY, ALL = "|", "&"
KNOWN_FROM = 0.4
"""Least calibrated probability of a class to speak of it.

A lower value answers more queries, rightly where the class is there and wrongly where
it is not; chosen on the tuning split, see docs/affordances.md. A grasp none of whose
classes reaches it is good for nothing that is known.
"""


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


def expected_gain(
    quality: FloatArray, affordance: FloatArray, weight: float = 1.0
) -> FloatArray:
    """Return what grasps are ranked by, shape (G,).

        gain = quality * affordance ** weight

    The affordance heads predict what a grasp is good for given that it holds, so with
    weight 1 this is the probability that it holds *and* serves. Weight 0 ranks by the
    quality alone; a large one asks for the surest affordance first.

    Args:
        quality: Probability of success, shape (G,); NaN counts as 0.
        affordance: Score of the query, shape (G,); NaN = no query counts as 1.
        weight: At least 0.
    """
    served = np.nan_to_num(np.asarray(affordance), nan=1.0)
    return np.asarray(np.nan_to_num(np.asarray(quality), nan=0.0) * served**weight)


def good_for(
    affordances: Sequence[float], labels: Sequence[str], least: float = KNOWN_FROM
) -> list[str]:
    """Return the classes of one grasp that reach ``least``, best first.

    Args:
        affordances: Probability per class.
        labels: Names of the classes.
        least: Below it a class is not known.

    Returns:
        Names; none if nothing is known.
    """
    pairs = sorted(zip(affordances, labels, strict=True), key=lambda pair: -pair[0])
    return [label for probability, label in pairs if probability >= least]
