"""What moments of a motion a strip shows."""

from __future__ import annotations

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.pictures.moments import caption, moments
from robolamp.twin.pictures.render import qpos_of

STEP = 0.004  # s
FLIGHT = 0.13  # s: as the real lamp's


@pytest.fixture(scope="module")
def twin() -> TwinModel:
    assets = Assets()
    return build(load_lamp(assets), load_calibration(assets), assets)


def motion(twin: TwinModel, hops: int, high: float = 0.02, lasts: float = FLIGHT) -> tuple[np.ndarray, np.ndarray]:
    """A lamp that stands for 0.5 s before each of its hops, a parabola each, and after the last."""
    time = np.arange(0.0, 0.5 + hops * (lasts + 0.5), STEP)
    since = (time - 0.5) % (lasts + 0.5)
    flying = (time >= 0.5) & (since < lasts) & (time < 0.5 + hops * (lasts + 0.5))
    share = since / lasts
    height = np.where(flying, 4 * high * share * (1 - share), 0.0)
    rest = 0.01
    return time, np.array([qpos_of(twin, (0.0, rest + z, 0.0), np.zeros(3)) for z in height])


def names(twin: TwinModel, count: int, *args: object, **more: float) -> list[str]:
    time, poses = motion(twin, *args, **more)  # type: ignore[arg-type]
    found = moments(twin, time, lambda at: poses[at], count)
    assert [moment.at for moment in found] == sorted({moment.at for moment in found})
    return [moment.name for moment in found]


def test_a_hop_is_shown_from_stance_to_end(twin: TwinModel) -> None:
    assert names(twin, 5, 1) == ["stance", "take-off", "apex", "landing", "end"]
    shown = names(twin, 8, 1)
    assert len(shown) == 8
    assert [name for name in shown if name] == ["stance", "take-off", "apex", "landing", "end"]


def test_the_apex_is_the_highest_and_the_others_are_on_the_floor(twin: TwinModel) -> None:
    time, poses = motion(twin, 1)
    found = {name: time[at] for at, name in moments(twin, time, lambda at: poses[at], 5)}
    assert found["take-off"] == pytest.approx(0.5, abs=2 * STEP)
    assert found["apex"] == pytest.approx(0.5 + FLIGHT / 2, abs=2 * STEP)
    assert found["landing"] == pytest.approx(0.5 + FLIGHT, abs=2 * STEP)


def test_with_little_room_every_flight_keeps_its_apex(twin: TwinModel) -> None:
    assert names(twin, 8, 4) == ["stance", "take-off", "apex", "landing", "apex", "apex", "apex", "end"]
    assert names(twin, 8, 9) == ["stance", *["apex"] * 6, "end"]


@pytest.mark.parametrize("flight", [{"high": 0.001}, {"lasts": 0.048}])
def test_a_rebound_is_no_flight(twin: TwinModel, flight: dict[str, float]) -> None:
    assert names(twin, 8, 2, **flight) == ["stance", *[""] * 6, "end"]


def test_the_shortest_motion_is_shown_whole(twin: TwinModel) -> None:
    time, poses = motion(twin, 0)
    assert [moment.at for moment in moments(twin, time[:3], lambda at: poses[at], 8)] == [0, 1, 2]


def test_captions() -> None:
    assert caption(0.456, "take-off", 0.1234) == "0.46 s   take-off   12.3 cm"
    assert caption(1.0, "", -0.00001) == "1.00 s   0.0 cm"
