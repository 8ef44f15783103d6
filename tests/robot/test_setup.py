from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.errors import SafetyError
from robolamp.robot.setup import edit_lamp, mean_angle, set_foot, sign_of


@given(st.floats(0, 2 * math.pi), st.lists(st.floats(-0.05, 0.05), min_size=1, max_size=12))
def test_a_mean_angle_is_right_across_the_seam(middle: float, noise: list[float]) -> None:
    samples = np.mod(middle + np.array([noise]).T, 2 * math.pi)
    (found,) = mean_angle(samples)
    assert 0.0 <= found <= 2 * math.pi
    assert math.remainder(found - middle - np.mean(noise), 2 * math.pi) == pytest.approx(0.0, abs=1e-4)


@given(st.floats(0, 2 * math.pi), st.floats(0.11, 3.0), st.sampled_from([1, -1]))
def test_a_push_shows_the_sign_across_the_seam(neutral: float, push: float, sign: int) -> None:
    assert sign_of(neutral, (neutral + sign * push) % (2 * math.pi), "knee") == sign


def test_a_push_that_is_too_small_shows_nothing() -> None:
    with pytest.raises(SafetyError, match=r"knee moved by 0\.050 rad, less than 0\.1"):
        sign_of(6.25, 6.30 - 2 * math.pi, "knee")


def test_who_reads_lamp_toml_while_it_is_edited_reads_the_old_one_whole(tmp_path: Path) -> None:
    path = tmp_path / "lamp.toml"
    old = "# mine\n[foot]\ntare = 0.0  # N\nscale = 1.0\n"
    path.write_text(old)
    with path.open() as reader:
        edit_lamp(path, lambda document: set_foot(document, 0.5, None))
        assert reader.read() == old
    assert path.read_text().startswith("# mine\n[foot]\ntare = 0.5")
    assert list(tmp_path.iterdir()) == [path]
