# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError, UnknownAffordanceError
from neugrasp_ros.grasp.queries import (
    KNOWN_FROM,
    expected_gain,
    good_for,
    parse_query,
)

LABELS = ("cut", "stab", "pour")
SCORES = np.array([[0.9, 0.2, 0.1], [0.3, 0.6, 0.5]])


def test_no_query_asks_for_nothing():
    query = parse_query("  ", LABELS)
    assert query.names == ()
    assert np.isnan(query.score(SCORES, LABELS)).all()


def test_one_class_is_its_own_probability():
    query = parse_query("Pour", LABELS)
    assert query.score(SCORES, LABELS).tolist() == [0.1, 0.5]


def test_any_of_several_is_the_best_and_all_of_them_the_worst():
    either = parse_query("cut | stab", LABELS)
    both = parse_query("cut&stab", LABELS)
    assert (either.names, either.every) == (("cut", "stab"), False)
    assert either.score(SCORES, LABELS).tolist() == [0.9, 0.6]
    assert both.score(SCORES, LABELS).tolist() == [0.2, 0.3]


def test_an_unknown_class_is_refused_with_the_known_ones():
    with pytest.raises(UnknownAffordanceError, match="'fly'; known: cut, pour, stab"):
        parse_query("cut|fly", LABELS)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("cut|stab&pour", "cannot be mixed"), ("cut|", "a name is missing")],
)
def test_a_query_without_one_meaning_is_refused(text, sentence):
    with pytest.raises(ConfigError, match=sentence):
        parse_query(text, LABELS)


def test_the_gain_is_the_chance_to_hold_and_to_serve():
    quality, affordance = np.array([0.8, 0.9]), np.array([0.5, 0.4])
    np.testing.assert_allclose(expected_gain(quality, affordance), [0.40, 0.36])
    np.testing.assert_allclose(expected_gain(quality, affordance, 0.0), quality)
    np.testing.assert_allclose(expected_gain(quality, affordance, 2.0), [0.2, 0.144])


def test_without_a_query_or_a_score_the_gain_is_the_quality_or_nothing():
    gain = expected_gain(np.array([0.7, np.nan]), np.array([np.nan, 0.9]))
    assert gain.tolist() == [0.7, 0.0]


def test_a_grasp_is_good_for_what_is_likely_enough():
    assert good_for([KNOWN_FROM, 0.2, 0.9], LABELS) == ["pour", "cut"]
    assert good_for([KNOWN_FROM - 0.01, 0.2, 0.1], LABELS) == []
    assert good_for([0.39, 0.2, 0.1], LABELS, least=0.2) == ["cut", "stab"]
