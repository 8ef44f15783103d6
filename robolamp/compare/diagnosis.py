"""Says in words why lamp and twin differ: simple rules over the comparison's numbers, the strongest first.

Every rule has a threshold below which a difference is not worth a word, fixed beforehand; a finding's weight is how
many times its threshold the difference is. Causes can look alike (a weak servo also answers late): each finding
says what it saw, so that a person can judge.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from robolamp.calibration import Calibration
from robolamp.compare.align import JointError
from robolamp.compare.replay import Replay
from robolamp.log.reader import Run

LAG = 0.003
"""A common lag worth a word [s]: a seventh of a control period at 50 Hz."""
SWING = 0.02
"""A joint that swings this much less or more than the twin's, as a share."""
BIAS = 0.005
"""A mean error worth a word [rad]: three counts of a 4096-count encoder."""
ODD_JOINT = 1.5
"""A joint whose error is this many times the median of the others' ..."""
ODD_JOINT_MAE = 0.005
"""... and is at least this large [rad] stands out."""
SENT = 0.002
"""Time by which goals leave later than the calibration's line delay says [s]."""
GAPS = 0.01
"""Share of readings that did not arrive, or of ticks that were missed."""
FORCE = 0.05
"""Difference of the standing foot force, as a share."""
STANDING = 0.5
"""Foot force below which the twin is not standing [N]."""
VOLTAGE = 0.15
"""Difference of the supply voltage [V]; servos report it in steps of 0.1 V."""
TRAVEL = 0.02
"""Difference of the base's travel [m]."""


@dataclass(frozen=True)
class Finding:
    """A cause that the evidence points to.

    Attributes:
        cause: What is probably different.
        evidence: The numbers it was seen in.
        remedy: What would settle it.
        weight: How many times its threshold the difference is.
    """

    cause: str
    evidence: str
    remedy: str
    weight: float


def diagnose(
    run: Run, replay: Replay, joints: Sequence[JointError], calibration: Calibration, travel: tuple[float, float]
) -> list[Finding]:
    """Return the findings, the strongest first; empty where nothing stands out.

    Args:
        run: The lamp's run.
        replay: The twin's.
        joints: Their difference, joint by joint.
        calibration: What the twin was calculated with.
        travel: The base's travel of lamp and twin [m]; NaN where unknown.
    """
    found = [
        *_late(joints),
        *_sent(run, calibration),
        *_weak(joints),
        *_odd(joints),
        *_bias(joints),
        *_foot(run, replay),
        *_supply(run, calibration),
        *_gaps(run, joints),
        *_slipping(joints, travel),
    ]
    return sorted(found, key=lambda finding: -finding.weight)


def _late(joints: Sequence[JointError]) -> Iterator[Finding]:
    lags = [joint.lag for joint in joints if np.isfinite(joint.lag)]
    if not lags or abs(common := float(np.median(lags))) < LAG:
        return
    each = ", ".join(f"{joint.name} {joint.lag * 1e3:+.1f} ms" for joint in joints if np.isfinite(joint.lag))
    word = "later" if common > 0 else "earlier"
    yield Finding(
        f"the lamp answers {abs(common) * 1e3:.1f} ms {word} than the twin",
        f"lag of the lamp behind the twin: {each}",
        f"friction or a weak servo can look like a lag: mend those first; then change the servos' delay by "
        f"{common * 1e3:+.1f} ms in the calibration",
        abs(common) / LAG,
    )


def _sent(run: Run, calibration: Calibration) -> Iterator[Finding]:
    taken, assumed = float(np.median(run.write_done - run.began)), calibration.lamp("line_delay")
    if taken - assumed >= SENT:
        yield Finding(
            "the goals leave later than the twin was evolved with",
            f"{taken * 1e3:.1f} ms after the tick's start (median); lamp.line_delay in the calibration is "
            f"{assumed * 1e3:.1f} ms",
            "leave the computer to the loop, or change lamp.line_delay in the calibration and evolve again",
            (taken - assumed) / SENT,
        )


def _weak(joints: Sequence[JointError]) -> Iterator[Finding]:
    for sign, what, far in (
        (-1, "weaker, or have more friction,", "less"),
        (1, "stronger, or have less friction,", "more"),
    ):
        found = [joint for joint in joints if sign * (joint.swing - 1) >= SWING]
        if not found:
            continue
        found.sort(key=lambda joint: -abs(joint.swing - 1))
        names = _names(found)
        one = len(found) == 1
        each = ", ".join(f"{joint.name} {abs(joint.swing - 1):.1%}" for joint in found)
        yield Finding(
            f"{names} {'is' if one else 'are'} {what.replace('have', 'has') if one else what} than in the twin",
            f"{'it swings' if one else 'they swing'} {far} far than the twin's: {each}",
            "look for play, a rubbing cable or a warm servo; then change torque_constant or the friction "
            f"{'of joint.' + found[0].name if one else 'of the servos'} in the calibration",
            abs(found[0].swing - 1) / SWING,
        )


def _names(joints: Sequence[JointError]) -> str:
    names = [f"the {joint.name}" for joint in joints]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _odd(joints: Sequence[JointError]) -> Iterator[Finding]:
    for joint in joints:
        others = [other.after.mae for other in joints if other is not joint and np.isfinite(other.after.mae)]
        if not others or joint.after.mae < ODD_JOINT_MAE:
            continue
        ratio = joint.after.mae / max(float(np.median(others)), 1e-9)
        if ratio >= ODD_JOINT:
            yield Finding(
                f"the {joint.name} is off more than the other joints",
                f"MAE {joint.after.mae * 1e3:.1f} mrad with the lag removed, {ratio:.1f} times the others'; worst "
                f"{joint.after.worst * 1e3:+.0f} mrad",
                f"compare the {joint.name}'s servo, gain and horn with the others'; calibrate it by itself "
                f"(joint.{joint.name} in the calibration)",
                ratio / ODD_JOINT,
            )


def _bias(joints: Sequence[JointError]) -> Iterator[Finding]:
    found = sorted(
        (joint for joint in joints if abs(joint.after.bias) >= BIAS), key=lambda joint: -abs(joint.after.bias)
    )
    if found:
        yield Finding(
            f"{_names(found)} {'sags, or its zero is' if len(found) == 1 else 'sag, or their zeros are'} off",
            "mean error, lamp minus twin: "
            + ", ".join(f"{joint.name} {joint.after.bias * 1e3:+.1f} mrad" for joint in found),
            "weigh what the joint carries and look for friction or a weak servo; check its horn, and zero in "
            "hardware/lamp.toml",
            abs(found[0].after.bias) / BIAS,
        )


def _foot(run: Run, replay: Replay) -> Iterator[Finding]:
    standing = run.phase == "start"
    lamp = run.foot_force[standing]
    lamp = lamp[np.isfinite(lamp)]
    twin = np.array([tick.observation.foot_force for tick in replay.ticks])[standing]
    if lamp.size == 0 or np.median(twin) < STANDING:
        return
    ratio = float(np.median(lamp) / np.median(twin))
    if abs(ratio - 1) >= FORCE:
        yield Finding(
            "the foot sensor's gain or the lamp's weight is off",
            f"standing still it reads {np.median(lamp):.2f} N, the twin {np.median(twin):.2f} N",
            f"weigh the lamp and tare the sensor; then change lamp.foot_gain (times {ratio:.2f}) or lamp.mass_scale "
            "in the calibration",
            abs(ratio - 1) / FORCE,
        )


def _supply(run: Run, calibration: Calibration) -> Iterator[Finding]:
    known = run.voltage[np.isfinite(run.voltage)]
    if known.size == 0:
        return
    measured, assumed = float(np.median(known)), calibration.lamp("supply_voltage")
    if abs(measured - assumed) >= VOLTAGE:
        word = "below" if measured < assumed else "above"
        yield Finding(
            f"the supply is {abs(measured - assumed):.1f} V {word} the calibration's",
            f"the servos report {measured:.1f} V (median), the twin has {assumed:.1f} V",
            "check supply and wiring, or change lamp.supply_voltage in the calibration",
            abs(measured - assumed) / VOLTAGE,
        )


def _gaps(run: Run, joints: Sequence[JointError]) -> Iterator[Finding]:
    for index, joint in enumerate(joints):
        share = float(np.mean(~np.isfinite(run.angle[:, index])))
        if share >= GAPS:
            yield Finding(
                f"the {joint.name}'s servo often does not answer",
                f"{share:.1%} of its readings are missing",
                "check its cable and the bus's baud rate; see the faults in the log",
                share / GAPS,
            )
    share = run.missed_ticks / max(1, run.index.size + run.missed_ticks)
    if share >= GAPS:
        yield Finding(
            "the loop did not keep its schedule",
            f"{run.missed_ticks} ticks missed ({share:.1%})",
            "leave the computer to the loop, or lengthen the control period",
            share / GAPS,
        )


def _slipping(joints: Sequence[JointError], travel: tuple[float, float]) -> Iterator[Finding]:
    difference = travel[0] - travel[1]
    alike = all(joint.after.mae < 2 * ODD_JOINT_MAE for joint in joints)
    if alike and abs(difference) >= TRAVEL:
        yield Finding(
            "the floor holds less or more than the twin's",
            f"the joints agree, yet the base travelled {travel[0]:.3f} m and the twin's {travel[1]:.3f} m",
            "clean foot and desk, or change lamp.floor_friction in the calibration",
            abs(difference) / TRAVEL,
        )
