"""How causes are put into words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from robolamp.compare.causes.words import noises


@pytest.mark.parametrize(
    ("sizes", "told"),
    [((1.0, 1.0), "1.0 mrad"), ((1.04, 0.93, 0.91), "0.9 to 1.0 mrad"), ((2.0, 10.0), "2.0 to 10.0 mrad")],
)
def test_the_sizes_of_several_encoders_noise_are_a_range(sizes: tuple[float, ...], told: str) -> None:
    found: list[Any] = [
        SimpleNamespace(joint=name, size=size * 1e-3, name="encoder_noise", share=0.1)
        for name, size in zip(("ankle", "knee", "neck"), sizes, strict=False)
    ]
    [finding] = noises(found)
    assert finding.cause.endswith(f"noisy by {told}")
