"""Feedforward gains and PWM Slope: what a servo does beside its feedback."""

from __future__ import annotations

import numpy as np
import pytest

from robolamp.dynamixel.registers import Name

from .bench import MotorBench
from .test_emulated_lamp import Client


def ramp(**gains: int) -> tuple[float, float]:
    """How far a servo lags behind a steady profile [rad], and how it differs from it at worst while it speeds up."""
    bench = MotorBench("XL330-M288-T", load=2e-4)
    bench.set(profile_velocity=80, profile_acceleration=200, **gains)
    bench.set(torque_enable=1)
    bench.set(goal_position=3500)
    lags = []
    for _ in range(300):
        bench.run(0.001)
        lags.append(bench.get(Name.POSITION_TRAJECTORY) - bench.get(Name.PRESENT_POSITION))
    return float(np.mean(lags[200:])), float(np.max(np.abs(lags[:60])))


def test_the_velocity_gain_takes_the_lag_away() -> None:
    lag, _ = ramp()
    better, _ = ramp(feedforward_1st_gain=400)
    assert lag > 20
    assert abs(better) < lag / 2


def test_the_acceleration_gain_helps_it_to_speed_up() -> None:
    _, plain = ramp(feedforward_1st_gain=400)
    _, helped = ramp(feedforward_1st_gain=400, feedforward_2nd_gain=6000)
    assert helped < 0.8 * plain


def test_without_a_profile_there_is_nothing_to_feed_forward() -> None:
    def path(gain: int) -> list[float]:
        bench = MotorBench()
        bench.set(feedforward_1st_gain=gain, feedforward_2nd_gain=gain, torque_enable=1)
        bench.set(goal_position=2200)
        bench.run(0.1)
        return [bench.motor.angle, bench.motor.velocity]

    assert path(0) == path(1000)


@pytest.mark.parametrize(("slope", "seconds"), [(140, 0.018), (35, 0.072)])
def test_pwm_rises_as_in_the_e_manuals_example(slope: int, seconds: float) -> None:
    bench = MotorBench(supply=5.0)
    bench.set(operating_mode=16, pwm_slope=slope)
    bench.set(torque_enable=1)
    bench.set(goal_pwm=885)
    bench.run(0.8 * seconds)
    assert bench.get(Name.PRESENT_PWM) == pytest.approx(0.8 * 885, abs=80)
    bench.run(0.25 * seconds + 0.001)
    assert bench.get(Name.PRESENT_PWM) == 885


def test_a_gentle_slope_slows_the_lamps_position_control() -> None:
    def after(slope: int) -> float:
        client = Client()
        client.write(3, 62, slope, 1)
        client.start()
        client.wait(0.3)
        client.go([0.0, 0.0, 0.3])
        client.wait(0.06)
        return float(client.lamp.plant.angle[2])

    assert after(2) < after(140) - 0.03
