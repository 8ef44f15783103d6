"""Signals shifted and bent by known amounts give those amounts back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robolamp.compare.align import Trace, compare_joint, find_lag, measure


def motion(time: np.ndarray) -> np.ndarray:
    return 0.4 * np.sin(2 * np.pi * 3.0 * time) + 0.15 * np.sin(2 * np.pi * 7.1 * time + 1.0)


DENSE = np.arange(-1.0, 7.0, 0.002)
TWIN = Trace.of(DENSE, motion(DENSE))


def lamp_times(random: np.random.Generator) -> np.ndarray:
    return np.arange(0.0, 6.0, 0.02) + random.normal(0.0, 0.0005, 300) + 0.003


@settings(max_examples=40, deadline=None)
@example(lag=-0.0625, seed=162, gain=0.5, bias=0.0)
@given(lag=st.floats(-0.15, 0.15), seed=st.integers(0, 1000), gain=st.floats(0.5, 1.5), bias=st.floats(-0.2, 0.2))
def test_a_known_lag_is_found_through_noise_gaps_gain_and_bias(lag, seed, gain, bias):
    random = np.random.default_rng(seed)
    time = lamp_times(random)
    angle = gain * motion(time - lag) + bias + random.normal(0.0, 0.001, time.size)
    angle[random.random(time.size) < 0.1] = np.nan
    angle[100:120] = np.nan
    result = compare_joint("knee", TWIN, Trace.of(time, angle), time.size)
    assert result.lag == pytest.approx(lag, abs=0.0003)
    seen = time[np.isfinite(angle)]
    smaller = (gain - 1) * motion(seen - lag).mean()  # the motion's own mean over the samples is not quite 0
    assert result.after.bias == pytest.approx(bias + smaller, abs=0.003)
    assert result.swing == pytest.approx(gain, abs=0.01)
    assert result.samples < result.of == 300
    assert result.after.rmse <= result.before.rmse + 1e-3


def test_the_errors_of_a_known_difference():
    time = np.arange(0.0, 6.0, 0.02)
    angle = motion(time) + 0.02
    angle[50] += 0.08
    error, residual = measure(TWIN, Trace.of(time, angle))
    assert error.mae == pytest.approx(0.02 + 0.08 / 300, abs=1e-6)
    assert error.rmse == pytest.approx(math.sqrt((299 * 0.02**2 + 0.1**2) / 300), abs=1e-6)
    assert error.bias == pytest.approx(0.02 + 0.08 / 300, abs=1e-6)
    assert (error.worst, error.worst_at) == (pytest.approx(0.1, abs=1e-6), pytest.approx(1.0))
    assert residual.shape == (300,)


def test_a_joint_that_stands_still_has_no_lag():
    time = np.arange(0.0, 6.0, 0.02)
    still = Trace.of(time, np.random.default_rng(0).normal(0.0, 0.001, 300))
    result = compare_joint("neck", Trace.of(DENSE, np.zeros(DENSE.size)), still, 300)
    assert math.isnan(result.lag)
    assert result.after == result.before
    assert result.after.mae == pytest.approx(0.0008, abs=0.0002)
    assert math.isnan(result.swing)


def test_two_different_motions_have_no_lag():
    time = np.arange(0.0, 6.0, 0.02)
    other = Trace.of(time, 0.3 * np.sin(2 * np.pi * 0.9 * time) + 0.3 * np.sin(2 * np.pi * 5.3 * time**1.1))
    assert math.isnan(find_lag(TWIN, other))


@pytest.mark.parametrize("readings", [np.full(300, np.nan), np.r_[1.0, np.full(299, np.nan)]])
def test_a_joint_that_never_answers(readings):
    result = compare_joint("knee", TWIN, Trace.of(np.arange(300) * 0.02, readings), 300)
    assert math.isnan(result.lag)
    assert result.samples <= 1


def test_recordings_of_different_times_share_nothing():
    later = Trace.of(np.arange(300) * 0.02 + 100.0, np.zeros(300))
    assert math.isnan(find_lag(TWIN, later))
    assert math.isnan(measure(TWIN, later)[0].mae)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 10), st.floats(-1, 1) | st.just(math.nan)), max_size=50))
@example([(0.0, 0.0), (5e-324, 1.0)])
def test_a_trace_stays_finite_whatever_the_stamps(samples):
    time, value = np.array([pair[0] for pair in samples]), np.array([pair[1] for pair in samples])
    trace = Trace.of(time, value)
    assert (np.diff(trace.time) > 0).all()
    assert np.isfinite(trace.value).all()
    assert np.isnan(trace.at(np.array([-1.0, 11.0]))).all()


def test_interpolation_follows_a_curve_between_samples_and_stops_at_gaps():
    time = np.arange(0.0, 2.0, 0.02)
    value = motion(time)
    value[40:50] = np.nan
    trace = Trace.of(time, value)
    between = np.arange(0.05, 1.9, 0.0073)
    read = trace.at(between)
    gap = (between > time[39]) & (between < time[50])
    assert np.isnan(read[gap]).all()
    near = (between > time[37]) & (between < time[52])
    assert np.abs(read[~near] - motion(between[~near])).max() < 0.005
