"""Eases: from 0 to 1, never back, and as fast as they say."""

from __future__ import annotations

import numpy as np
import pytest

from robolamp.ease import EASES, LINEAR, MINIMUM_JERK


@pytest.mark.parametrize("name", EASES)
def test_an_ease_goes_from_one_end_to_the_other(name: str) -> None:
    ease, share = EASES[name], np.linspace(0, 1, 1001)
    curve = np.array([ease(s) for s in share])
    speed = np.gradient(curve, share)
    assert (curve[0], curve[-1], ease(-1), ease(2)) == (0, 1, 0, 1)
    assert (np.diff(curve) > 0).all()
    assert speed.max() == pytest.approx(ease.fastest, rel=1e-3)
    assert curve + curve[::-1] == pytest.approx(np.ones(1001))
    if name != LINEAR:
        assert speed[[0, -1]] == pytest.approx([0, 0], abs=4e-3)


def test_minimum_jerk() -> None:
    """The curve of Flash and Hogan (1985), by its own numbers."""
    ease, share = EASES[MINIMUM_JERK], np.linspace(0, 1, 1001)
    speed = np.gradient(np.array([ease(s) for s in share]), share)
    assert speed.max() == pytest.approx(15 / 8, rel=1e-3)
    assert speed[[0, -1]] == pytest.approx([0, 0], abs=1e-4)
    assert ease(0.5) == pytest.approx(0.5, rel=1e-9)
