"""Names the causes of a difference between lamp and twin.

First knobs, ranked by how much of the difference each explains; then what the log shows by itself. Every threshold
is fixed here or in `explain` and `knobs`, beforehand.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from robolamp.calibration import Calibration
from robolamp.compare.align import JointError
from robolamp.compare.causes.knobs import SLOW_LINE
from robolamp.compare.causes.ranking import Account, Explanation
from robolamp.compare.divergence import SAG
from robolamp.compare.pauses import silent
from robolamp.compare.servo_settings import wrong_settings
from robolamp.compare.travel.hop_count import count_hops
from robolamp.dynamixel.wire_time import wire_time
from robolamp.lamp import Lamp
from robolamp.log.reader import Run, Truth

SENT = 0.002
"""Time by which goals leave later than the calibration's line delay says [s]."""
HELD_UP = 0.0015
"""Excess of an answer's time over its packets' that is named [s]; chosen: an adapter whose latency timer
is set to 1 ms, on a full-speed USB of 1 ms frames, costs less."""
GAPS = 0.01
"""Share of readings that did not arrive, or of ticks that were missed."""
DRIFT = 500e-6
"""Rate by which the two clocks may differ: crystals are within 100 ppm, and a lag is known to some 0.3 ms."""
SAGGED = 3
"""Ticks from which on a fall of the supply is no single odd reading."""
STANDING = 10
"""Fewer readings than this have no median that stands for them."""
SATURATED = 0.98
"""Duty from which on a servo gives all it has."""


@dataclass(frozen=True)
class Finding:
    """A cause that the evidence points to.

    Attributes:
        cause: What is probably different.
        evidence: The numbers it was seen in.
        remedy: What would settle it.
        knob: The knob that explains it, as "strength knee"; empty where the log shows it by itself.
        size: How much is different, in `unit`; NaN where there is no such number.
        unit: Of the size.
        share: Of the difference that it explains, 0 to 1; NaN: not known, as the log says it by itself.
    """

    cause: str
    evidence: str
    remedy: str
    knob: str = ""
    size: float = math.nan
    unit: str = ""
    share: float = math.nan

    @property
    def explains(self) -> str:
        """Return the share in words."""
        return (
            f"explains {self.share * 100:.0f} % of the difference" if math.isfinite(self.share) else "share not known"
        )


def diagnose(
    run: Run,
    account: Account,
    joints: Sequence[JointError],
    calibration: Calibration,
    lamp: Lamp,
    than: str = "modelled",
    truth: Truth | None = None,
) -> list[Finding]:
    """Return the findings, the strongest first; empty if there are none.

    What is known for certain comes before what knobs make likely: hops that did not fly, by the truth, and servos
    that were not set as they should be, which any motor's strength would be blamed for. What the log only suggests
    comes last.

    Args:
        run: The lamp's run.
        account: How knobs explain it.
        joints: The differences, joint by joint.
        calibration: What the twin was calculated with.
        lamp: The lamp's description.
        than: What the lamp is compared with, as in "weaker than modelled".
        truth: What the lamp truly did; None: nobody knows.
    """
    turned = [told(run, each, joints, than) for each in account.causes if each.knob]
    noisy = [each for each in account.causes if not each.knob]
    first = not turned or (noisy and noisy[0].share > account.causes[0].share)
    heard = [*noises(noisy)]
    named = {each.knob for each in turned}
    rest = [each for each in complaints(run, joints, calibration, lamp) if not each.knob or each.knob not in named]
    known, likely = [*miscounted(run, truth, lamp)], [*(heard if first else ()), *turned, *(() if first else heard)]
    return [*(known if truth else ()), *misset(run, lamp), *likely, *(() if truth else known), *rest]


def miscounted(run: Run, truth: Truth | None, lamp: Lamp) -> Iterator[Finding]:
    """Yield a finding if hops were counted that did not fly, or probably did not.

    Args:
        run: The lamp's run.
        truth: What the lamp truly did; None: nobody knows.
        lamp: The lamp's description.
    """
    count = count_hops(run, truth, lamp)
    if count.text:
        yield Finding(
            count.text,
            count.evidence,
            "the controller uses the hops that it counts; look for what makes the lamp rebound or tilt: a loose "
            "joint, a slippery or soft floor",
        )


def misset(run: Run, lamp: Lamp) -> Iterator[Finding]:
    """Yield a finding for each servo with other settings than driver and lamp.toml want, if the log has the settings.

    Args:
        run: The lamp's run.
        lamp: The lamp's description.
    """
    for joint, wrong in wrong_settings(run, lamp):
        yield Finding(
            f"the {joint}'s servo has other settings: {wrong}",
            "as its registers said once torque was on; the twin has none of it, so correct it before blaming the motor",
            "`robolamp setup check --fix` sets what is kept without power; power it off and on for the rest",
        )


def noises(found: Sequence[Explanation]) -> Iterator[Finding]:
    """Yield a finding for each noisy sensor, one for all encoders together.

    Args:
        found: Explanations by noise.
    """
    seen = "standard deviation while the lamp stands still, beyond the sensor's own steps"
    encoders = [each for each in found if each.joint]
    for group in (encoders, [each for each in found if not each.joint]):
        if not group:
            continue
        joints = [each.joint for each in group]
        one = len(group) == 1
        if joints[0]:
            which = f"the {joints[0]}'s encoder is" if one else f"the encoders of {_list(joints)} are"
            told = sorted({f"{each.size * 1e3:.1f}" for each in group}, key=float)
            sizes = " to ".join(dict.fromkeys((told[0], told[-1]))) + " mrad"
        else:
            which, sizes = "the foot sensor is", f"{group[0].size:.3f} N"
        yield Finding(
            f"{which} noisy by {sizes}", seen,
            f"keep {'its cable' if one else 'their cables'} away from the motors', and check plug and ground",
            group[0].name, max(each.size for each in group), "rad" if joints[0] else "N",
            sum(each.share for each in group),
        )  # fmt: skip


def _list(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def told(run: Run, one: Explanation, joints: Sequence[JointError], than: str) -> Finding:
    """Return an explanation by a knob as a finding.

    Args:
        run: The lamp's run.
        one: The explanation.
        joints: The differences, joint by joint.
        than: What the lamp is compared with.
    """
    assert one.knob is not None
    facts = "; ".join(_facts(run, one, joints))
    return Finding(
        one.knob.cause(one.size, than),
        facts or "a twin changed so does what the log says",
        one.knob.remedy(),
        one.name, one.size, one.knob.about.unit, one.share,
    )  # fmt: skip


def _facts(run: Run, one: Explanation, joints: Sequence[JointError]) -> Iterator[str]:
    """Yield facts from the log that support a cause."""
    kind = one.knob.kind if one.knob else ""
    joint = next((each for each in joints if each.name == one.joint), None)
    if joint is not None and kind in ("strength", "friction"):
        yield f"the {joint.name} is off by {joint.after.mae * 1e3:.1f} mrad with its lag removed"
        if math.isfinite(joint.swing):
            yield f"its swing is {abs(joint.swing - 1):.1%} {'smaller' if joint.swing < 1 else 'larger'}"
        duty = np.abs(run.pwm[:, run.joints.index(joint.name)])
        if (full := float(np.mean(duty[np.isfinite(duty)] >= SATURATED)) if np.isfinite(duty).any() else 0.0) > 0:
            yield f"its servo is at full duty in {full:.1%} of the ticks"
    if kind == "delay":
        lags = ", ".join(f"{each.name} {each.lag * 1e3:+.1f} ms" for each in joints if math.isfinite(each.lag))
        if lags:
            yield f"lag behind the twin: {lags}"
    if kind == "latency":
        yield f"an answer takes {float(np.median(run.read_done - run.began)) * 1e3:.1f} ms (median)"
    if kind in ("supply", "resistance", "drain"):
        volts = run.voltage[np.isfinite(run.voltage)]
        if volts.size:
            yield (
                f"the servos report {np.median(volts[:30]):.1f} V at first, {np.median(volts[-30:]):.1f} V at last, "
                f"{volts.min():.1f} V at least"
            )
    if kind in ("foot gain", "foot offset", "foot drift", "mass"):
        standing = run.foot_force[(run.phase == "start") & np.isfinite(run.foot_force)]
        if standing.size >= STANDING:
            yield f"it reads {np.median(standing):.2f} N standing still"


def _sagged(run: Run, calibration: Calibration) -> Iterator[Finding]:
    """Yield a fact if the supply fell by more than the currents make it fall in the twin."""
    volts = np.ma.masked_invalid(run.voltage).mean(axis=1).filled(math.nan)
    own = volts + calibration.lamp("supply_resistance") * np.abs(run.current).sum(axis=1)
    known = np.isfinite(own)
    low = known & (own <= (np.median(own[known]) if known.any() else 0.0) - SAG)
    if (ticks := int(np.count_nonzero(low))) >= SAGGED:
        yield Finding(
            f"the supply sagged to {volts[low].min():.1f} V",
            f"{ticks} ticks at {SAG:g} V or more below the usual {np.median(volts[known]):.1f} V, "
            "beyond what the twin's supply gives way",
            "use thicker or shorter cables and a supply that holds its voltage at the largest current",
        )


def complaints(run: Run, joints: Sequence[JointError], calibration: Calibration, lamp: Lamp) -> Iterator[Finding]:
    """Yield what the log shows by itself, without a twin.

    Args:
        run: The lamp's run.
        joints: The differences, joint by joint.
        calibration: What the twin was calculated with.
        lamp: The lamp's description.
    """
    answer, wire = float(np.median(run.read_done - run.began)), run.answer_wire
    if not math.isfinite(wire):  # an older log
        wire = wire_time("reading", len(lamp.joints), lamp.bus_baud)
    if answer - wire >= HELD_UP:
        # Goals and questions are held up alike: the joints move later and are asked later, and the angles agree.
        yield Finding(
            f"the line to the servos delays everything by at least {(answer - wire) * 1e3:.1f} ms",
            f"an answer takes {answer * 1e3:.1f} ms (median); its packets are {wire * 1e3:.1f} ms on the wire",
            SLOW_LINE,
            "latency",
            answer - wire,
            "s",
        )
    taken, assumed = float(np.median(run.write_done - run.began)), calibration.lamp("line_delay")
    if taken - assumed >= SENT:
        yield Finding(
            "goal angles are sent later than the calibration says",
            f"{taken * 1e3:.1f} ms after the tick's start (median); lamp.line_delay in the calibration is "
            f"{assumed * 1e3:.1f} ms",
            "run nothing else on the computer, or change lamp.line_delay in the calibration and evolve again",
        )
    heard = ~silent(run)
    for index, joint in enumerate(run.joints):
        share = float(np.mean(~np.isfinite(run.angle[heard, index])))
        if share >= GAPS:
            yield Finding(
                f"the {joint}'s servo often does not answer",
                f"{share:.1%} of its readings are missing",
                "check its cable and the bus's baud rate; see the faults in the log",
            )
    share = run.missed_ticks / max(1, run.index.size + run.missed_ticks)
    if share >= GAPS:
        yield Finding(
            "the loop did not keep its schedule",
            f"{run.missed_ticks} ticks missed ({share:.1%})",
            "run nothing else on the computer, or lengthen the control period",
        )
    yield from _sagged(run, calibration)
    drifts = [joint.drift for joint in joints if math.isfinite(joint.drift)]
    errors = [joint.drift_stderr for joint in joints if math.isfinite(joint.drift)]
    if drifts and abs(drift := float(np.median(drifts))) >= max(DRIFT, 4 * float(np.median(errors))):
        yield Finding(
            f"the two clocks run apart by {drift * 1e6:+.0f} ppm",
            "the lag grows steadily: " + ", ".join(f"{value * 1e6:+.0f}" for value in drifts) + " ppm, joint by joint",
            "log both with one computer's monotonic clock",
        )
    for row, by in run.clock_steps:
        yield Finding(
            f"the clock of the time stamps was set by {by:+.1f} s",
            f"at tick {run.index[row]}; the run is compared on its own clock, which went on",
            "nothing to do; a truth log or an event of another clock may be shifted against the ticks",
        )
    faults = Counter(fault for tick in run.faults for fault in tick)
    if faults:
        text, count = faults.most_common(1)[0]
        more = f", and {len(faults) - 1} other kinds" if len(faults) > 1 else ""
        yield Finding(
            "the log holds faults",
            f"{text} ({count} times){more}",
            "`robolamp setup check` finds a loose plug; see the events in the log",
        )
