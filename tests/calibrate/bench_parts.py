"""Recordings of a servo whose parameters are known: MuJoCo's motion, sampled at odd times and rounded to counts."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibrate.servo.fast_pendulum import parameter_set
from robolamp.calibrate.servo.mujoco_bench import Bench
from robolamp.calibrate.servo.recordings import Recording
from robolamp.calibration import load_calibration

Array = NDArray[np.float64]

MODEL = "XL330-M288-T"
NOMINAL = {**load_calibration(Assets()).servo(MODEL, ""), "encoder_offset": 0.0}
COUNT = 2 * math.pi / 4096

TRUTH = {
    **NOMINAL, "torque_constant": 0.34, "resistance": 3.9, "armature": 0.0022, "viscous": 0.007, "coulomb": 0.013,
    "delay": 0.0062, "encoder_offset": 0.015, "load_motor": 0.2, "load_external": 0.15, "stribeck": 0.0,
    "load_external_stribeck": 0.0,
}  # fmt: skip
"""A servo that differs from the nominal one, without Stribeck terms."""


def steps(t: Array) -> Array:
    return np.choose((t / 0.6).astype(int) % 4, [0.9, -0.5, 0.3, -1.1])


def chirp(t: Array) -> Array:
    return 0.8 * np.sin(2.0 * t**2)


def drop(t: Array) -> Array:
    return np.full_like(t, 1.3)


def record(
    goal: Callable[[Array], Array],
    truth: dict[str, float] = TRUTH,
    *,
    seconds: float = 3.0,
    p_gain: float = 400.0,
    off_at: float = math.inf,
    name: str = "made.csv",
    seed: int = 0,
) -> Recording:
    """Record a servo of known parameters: irregular samples, goals sent before each, quantised angles, noisy supply."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.004, 0.0066, round(seconds / 0.0053)))
    count = len(time)
    nothing = np.full(count, math.nan)
    recording = Recording(
        name=name, path=Path(name), sha256="", source="csv", servo=MODEL, joint="", time=time,
        goal_time=time - 0.0021, goal=goal(time), angle=np.zeros(count), velocity=np.zeros(count), current=nothing,
        pwm=nothing, voltage=np.round(7.3 + rng.normal(0, 0.1, count), 1), temperature=np.full(count, 30.0),
        torque=time < off_at, p_gain=np.full(count, p_gain), mass=0.49, length=0.1, trajectory=goal.__name__,
    )  # fmt: skip
    angle = Bench([recording], workers=1).simulate(parameter_set(truth)[None])[0][0]
    angle = np.round(angle / COUNT) * COUNT
    return Recording(**{**vars(recording), "angle": angle})


def write_csv(folder: Path, recording: Recording, name: str, **keys: object) -> Path:
    """Write a recording as the documented table."""
    lines = [f"# {key} = {value}" for key, value in (
        ("servo", recording.servo), ("p_gain", recording.p_gain[0]), ("mass", recording.mass),
        ("length", recording.length), ("trajectory", recording.trajectory), *keys.items(),
    )]  # fmt: skip
    lines.append("time_s,goal_time_s,goal_rad,angle_rad,voltage_v,temperature_c,torque")
    for row in zip(recording.time, recording.goal_time, recording.goal, recording.angle, recording.voltage,
                   recording.temperature, recording.torque.astype(int), strict=True):  # fmt: skip
        lines.append(",".join(repr(float(value)) for value in row))
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def write_bam(folder: Path, recording: Recording, name: str, **changed: object) -> Path:
    """Write a recording as Rhoban/bam does."""
    entries = [
        {
            "timestamp": float(t), "goal_position": float(g), "position": float(q), "speed": 0.0, "load": 65535,
            "input_volts": float(v), "temp": 30, "torque_enable": bool(on),
        }
        for t, g, q, v, on in zip(
            recording.time, recording.goal, recording.angle, recording.voltage, recording.torque, strict=True
        )
    ]  # fmt: skip
    data = {
        "mass": 0.49, "length": 0.1, "kp": 400, "vin": 7.4, "motor": "xl330", "trajectory": "steps", "entries": entries,
        **changed,
    }  # fmt: skip
    path = folder / name
    path.write_text(json.dumps(data))
    return path
