"""Hops, drift, spectra, partings and the controller's replay against known answers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from robolamp.compare.align import Trace, find_drift
from robolamp.compare.causes.ranking import roughness
from robolamp.compare.divergence import BANDS, spectrum
from robolamp.compare.replays.trajectory import Side
from robolamp.compare.travel.sensed_flights import flights, hops

from .lamps import LAMP
from .test_align import motion


def foot(offs: list[tuple[float, float]], rate: float = 500.0) -> Side:
    """A foot that presses with 2 N, but for these times."""
    tick = np.arange(-1.0, 4.0, 1 / rate)
    force = np.full(tick.size, 2.0)
    for off, on in offs:
        force[(tick >= off) & (tick < on)] = 0.0
    empty = np.zeros((tick.size, 3))
    return Side("lamp", empty, empty, empty, empty, force, tick, 0, None, math.nan, None)


def test_flights_give_their_times_and_the_apex_they_imply():
    ours = flights(foot([(0.5, 0.65), (1.0, 1.03), (1.5, 1.62), (-0.5, -0.3)]), LAMP)
    assert [flight.off for flight in ours] == pytest.approx([0.5, 1.5], abs=0.003)  # 30 ms are no hop, nor is a start
    assert [flight.time for flight in ours] == pytest.approx([0.15, 0.12], abs=0.003)
    assert ours[0].apex == pytest.approx(9.81 * 0.15**2 / 8, rel=0.05)


def test_hops_pair_by_time_and_one_that_only_the_lamp_makes_stays_alone():
    lamp, twin = foot([(0.5, 0.65), (1.5, 1.6), (2.5, 2.6)]), foot([(0.49, 0.66), (2.51, 2.61), (3.3, 3.4)])
    found = hops(flights(lamp, LAMP), flights(twin, LAMP))
    assert [(hop.lamp is not None, hop.twin is not None) for hop in found] == [
        (True, True), (True, False), (True, True), (False, True),
    ]  # fmt: skip
    assert found[0].off_late == pytest.approx(0.01, abs=0.003)
    assert found[0].on_late == pytest.approx(-0.01, abs=0.003)
    assert math.isnan(found[1].off_late)


@pytest.mark.parametrize("drift", [-2000e-6, 0.0, 1000e-6])
def test_a_known_drift_is_found_through_gaps_and_noise(drift):
    random = np.random.default_rng(2)
    dense = np.arange(-1.0, 41.0, 0.004)
    time = np.arange(0.0, 40.0, 0.02)
    angle = motion(time - 0.01 - drift * time) + random.normal(0.0, 0.001, time.size)
    angle[random.random(time.size) < 0.05] = np.nan
    angle[400:460] = np.nan
    slope, error = find_drift(Trace.of(dense, motion(dense)), Trace.of(time, angle))
    assert slope == pytest.approx(drift, abs=max(4 * error, 10e-6))
    assert error < 50e-6


def test_too_short_a_run_tells_no_drift():
    time = np.arange(0.0, 5.0, 0.02)
    trace = Trace.of(time, motion(time))
    assert all(math.isnan(value) for value in find_drift(trace, trace))


def test_a_spectrum_puts_a_sine_into_its_band_and_adds_up():
    time = np.arange(0.0, 10.0, 0.02)
    error = 0.01 * np.sin(2 * np.pi * 4.0 * time)
    bands = spectrum("knee", time, error).bands
    assert BANDS[2] <= 4.0 < BANDS[3]
    assert bands[2] == pytest.approx(0.01 / math.sqrt(2), rel=0.02)
    assert np.delete(bands, 2).max() < 1e-4
    assert math.sqrt((bands**2).sum()) == pytest.approx(float(error.std()), rel=0.02)


def test_roughness_is_the_noise_and_not_the_sway_it_rides_on():
    random = np.random.default_rng(1)
    time = np.arange(0.0, 20.0, 0.02)
    series = 0.001 * np.sin(2 * np.pi * 0.3 * time) + random.normal(0.0, 0.002, time.size)
    series[::17] = np.nan
    assert roughness(series) == pytest.approx(0.002, rel=0.15)
    assert roughness(series[:8]) == 0.0


def test_a_side_without_force_has_no_hops():
    side = foot([(0.5, 0.7)])
    assert flights(dataclasses.replace(side, force=np.full(side.force.size, np.nan)), LAMP) == []
