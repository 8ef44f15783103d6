from __future__ import annotations

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest

from robolamp.evolve.tasks.fitness import HOPELESS, term, terms, terms_of, weighted
from robolamp.twin.judges.lamp_judge import Outcome

LANES = 2


def outcome(**changed: object) -> Outcome:
    """Two lanes that stand where they were sent."""
    zero = np.zeros(LANES)
    still = Outcome(
        goal=np.full(LANES, 0.3), x=np.full(LANES, 0.3), nearest=zero, travel=np.full(LANES, 0.3),
        flight=np.full(LANES, 0.3), hops=zero, bad_landings=zero, fall_time=np.full(LANES, np.nan), arrival=zero,
        travel_after=zero, tilt=zero, max_tilt=zero, angles=np.zeros((LANES, 3)), motion=zero,
        goal_time=zero, duration=np.full(LANES, 5.0), pole=np.zeros(LANES, bool), pose_error=zero,
        unstable=np.zeros(LANES, bool), interventions=np.zeros(LANES, np.int64),
    )  # fmt: skip
    return replace(still, **{name: np.array(value) for name, value in changed.items()})


@pytest.mark.parametrize(
    ("name", "changed", "expected"),
    [
        ("distance", {"x": [0.0, 0.45]}, [1.0, 0.5]),
        ("fall", {"fall_time": [np.nan, 0.2]}, [0, 1]),
        ("shuffle", {"flight": [0.06, 0.27]}, [0.5, 0.0]),
        ("shuffle", {"travel": [0.001, 0.3]}, [0.7, 0.0]),  # nothing travelled: all of it is missing
        ("landing", {"bad_landings": [0.0, 3.0]}, [0, 3]),
        ("restless", {"motion": [0.02, np.inf]}, [0.4, 1.0]),
        ("posture", {"angles": [[0.3, -0.6, 0.0], [9.0, 0.0, 0.0]]}, [0.3, 1.0]),
        ("arrival", {"arrival": [1.0, np.nan]}, [0.2, 1.0]),
        ("travel_after", {"travel_after": [0.03, 2.0]}, [0.1, 1.0]),
        ("pole", {"pole": [True, False]}, [1, 0]),
        ("pose", {"pose_error": [0.25, 3.0]}, [0.25, 1.0]),
        ("timing", {"arrival": [1.0, np.nan], "goal_time": [3.0, 3.0]}, [0.4, 1.0]),
    ],
)
def test_terms(name: str, changed: dict, expected: list[float]) -> None:
    assert terms()[name](outcome(**changed)) == pytest.approx(expected)


def test_a_perfect_run_costs_nothing() -> None:
    assert weighted(outcome(), dict.fromkeys(terms_of("lamp"), 1.0)).tolist() == [0.0, 0.0]


def test_terms_are_weighted_and_nonsense_is_hopeless() -> None:
    weights = {"distance": 2.0, "fall": 3.0}
    assert weighted(outcome(x=[0.0, 0.3], fall_time=[0.1, np.nan]), weights) == pytest.approx([5.0, 0.0])
    assert weighted(outcome(x=[np.nan, np.inf]), weights).tolist() == [HOPELESS, HOPELESS]


def test_no_term_sees_what_the_envelope_did() -> None:
    seen = []
    mine = {"spy": lambda shown: seen.append(shown.interventions.sum()) or np.zeros(LANES)}
    with mock.patch("robolamp.evolve.tasks.fitness._TERMS", mine):
        weighted(outcome(interventions=[3, 4]), {"spy": 1.0})
    assert seen == [0]


def test_a_term_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robolamp.evolve.tasks.fitness._TERMS", dict(terms()))
    term("leaning")(lambda outcome: outcome.max_tilt)
    assert weighted(outcome(max_tilt=[0.1, 0.2]), {"leaning": 10.0}) == pytest.approx([1.0, 2.0])
