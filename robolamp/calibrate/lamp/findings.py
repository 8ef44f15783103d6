"""What a fit of a lamp says in words: what agrees, what does not, what nobody can tell and how it could be told."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robolamp.calibrate.lamp.lamp_fit import LampFit
from robolamp.calibrate.lamp.session import LampSession
from robolamp.calibrate.lamp.unknowns import GEARS
from robolamp.calibration import Calibration
from robolamp.lamp import Lamp

DELAY_AGREES = 0.0025
"""How far the two measurements of the delay may lie apart [s]: a physics step, and what the fit itself is uncertain."""

TRAVEL_AGREES = 0.10
"""How far a predicted hop may land from a real one, relative."""

TIME_AGREES = 0.020
"""How far a predicted take-off or landing may be from a real one [s]."""

HELD_OUT_AGREES = 0.005
"""Mean absolute error on recordings not fitted to, below which the joints count as predicted [rad]: chosen; 5 mrad are
1.5 mm at the head."""

_TARE = 0.05  # N: a foot sensor's zero that is off by more moves the contact thresholds
_ZERO = 0.01  # rad: a joint's zero that is off by more is worth setting again
_STRONG = 0.8  # correlation that is worth a word


@dataclass(frozen=True)
class FitVerdict:
    """Whether the twin predicts the lamp.

    Attributes:
        good: Whether it does.
        text: A sentence that says how well.
        held_out: Mean absolute error of the joints on recordings not fitted to, base and fitted [rad]; NaN without.
        travel: Largest relative error of a hop's length; NaN without hops.
        time: Largest error of a take-off or landing [s]; NaN without hops.
    """

    good: bool
    text: str
    held_out: tuple[float, float]
    travel: float
    time: float


def verdict(fit: LampFit) -> FitVerdict:
    """Judge a fit by what it was not fitted to, and by the hops."""
    unseen = {name: error for name, error in fit.mae.items() if name not in fit.trained}
    before, after = np.mean(list(unseen.values()), axis=0) if unseen else (math.nan, math.nan)
    way = time = math.nan
    said = []
    good = True
    if unseen:
        good = after <= HELD_OUT_AGREES
        said.append(
            f"joints within {after * 1e3:.1f} mrad on {', '.join(unseen)}, not fitted to (before: {before * 1e3:.1f}, "
            f"allowed: {HELD_OUT_AGREES * 1e3:.0f})"
        )
    if fit.floor and fit.floor.travel:
        way = max(abs(twin - lamp) / max(abs(lamp), 0.01) for lamp, twin in fit.floor.travel.values())
        good = good and way <= TRAVEL_AGREES
        said.append(f"hops' lengths within {way:.0%} (allowed: {TRAVEL_AGREES:.0%})")
    if fit.floor and fit.floor.flights:
        late = [
            abs(predicted - real)
            for flight in fit.floor.flights
            for real, predicted in (
                (flight.takeoff, flight.predicted_takeoff),
                (flight.landing, flight.predicted_landing),
            )
        ]
        time = max(late) if np.isfinite(late).all() else math.inf
        good = good and time <= TIME_AGREES
        if math.isfinite(time):
            said.append(f"take-offs and landings within {time * 1e3:.0f} ms (allowed: {TIME_AGREES * 1e3:.0f})")
        else:
            said.append("a flight that the twin does not predict")
    begin = "The twin predicts this lamp" if good else "The twin does not predict this lamp yet"
    return FitVerdict(
        bool(good), f"{begin}: {'; '.join(said) or 'nothing to judge it by'}.", (float(before), float(after)), way, time
    )


def findings(fit: LampFit, session: LampSession, lamp: Lamp, base: Calibration) -> list[str]:
    """Return what a person should know of a fit, a sentence or two each."""
    return [
        *_missing(session),
        *_delay(fit, lamp, base),
        *_zeros(fit),
        *_foot(fit),
        *_gears(fit),
        *_unknown(fit, session),
    ]


def _missing(session: LampSession) -> list[str]:
    gaps = [f"{recording.name} {recording.missing}" for recording in session.recordings if recording.missing]
    return [f"Readings are missing: {', '.join(gaps)}. Check cable and plugs."] if gaps else []


def _delay(fit: LampFit, lamp: Lamp, base: Calibration) -> list[str]:
    delays = fit.servo_delays()
    if not delays:
        return []
    nominal = float(np.mean([base.servo(joint.servo, joint.name)["delay"] for joint in lamp.joints]))
    fitted = float(np.mean(list(delays.values()))) - nominal
    told = (
        f"Delay beyond the servos' nominal {nominal * 1e3:.1f} ms, measured twice: {fit.latency * 1e3:+.1f} ms by the "
        f"stamps of the readings, {fitted * 1e3:+.1f} ms by the motion"
    )
    if abs(fitted - fit.latency) <= DELAY_AGREES:
        return [f"{told}. They agree within {DELAY_AGREES * 1e3:.1f} ms."]
    slow = "slower" if fitted > fit.latency else "quicker"
    return [
        f"{told}. They do not agree: the servos themselves are {slow} than nominal, or goal angles wait "
        "where no time stamp shows it (a latency timer, a hub)."
    ]


def _zeros(fit: LampFit) -> list[str]:
    found = []
    for index, unknown in enumerate(fit.asked):
        value = unknown.value(float(fit.z[index]))
        if unknown.name == "encoder_offset" and fit.identified(index) and abs(value) > _ZERO:
            found.append(
                f"The zero of {unknown.joint} is off by {value:+.3f} rad: set it again with `robolamp setup zero`, or "
                "leave it: the calibration holds it now."
            )
    return found


def _foot(fit: LampFit) -> list[str]:
    if math.isfinite(fit.foot_offset) and abs(fit.foot_offset) > _TARE:
        return [
            f"The foot sensor shows {fit.foot_offset:+.2f} N in the air: tare it with `robolamp setup foot`. The gain "
            "found here applies to what it shows beyond that."
        ]
    return []


def _gears(fit: LampFit) -> list[str]:
    """Say whether play and stiffness are in the twin, and why."""
    rigid, bent = fit.left_out
    if math.isnan(bent):
        return []
    if math.isinf(bent):
        return ["Play and bending of the arm are left out of the twin: the recordings determine neither."]
    tried = f"on recordings not fitted to, joints are off by {rigid * 1e3:.2f} mrad without them, {bent * 1e3:.2f} with"
    found = [
        f"{unknown.label} {value * 1e3:.1f} mrad" if unknown.joint else f"{unknown.label} {value:.0f} Nm/rad"
        for index, unknown in enumerate(fit.asked)
        if unknown.name in GEARS and (value := unknown.value(float(fit.z[index])))
    ]
    if not found:
        return [f"Play and bending of the arm are left out of the twin, because they do not improve it: {tried}."]
    return [f"Play and bending of the arm are in the twin ({', '.join(found)}): {tried}."]


def _unknown(fit: LampFit, session: LampSession) -> list[str]:
    """Name what the recordings do not tell, what it hides behind, and what would tell it."""
    found = []
    dropped = bool(session.named("drop"))
    for index, unknown in enumerate(fit.asked):
        if fit.identified(index):
            continue
        others = [
            (abs(float(fit.correlation[index, other])), fit.asked[other].label)
            for other in range(len(fit.asked))
            if other != index
        ]
        strength, partner = max(others)
        kept = f"{unknown.prior:g} {unknown.unit}".removesuffix(" 1")
        text = f"{unknown.label} is not determined by these recordings, and keeps its prior of {kept}"
        if strength > _STRONG:
            text += f"; it has the same effect as {partner}"
        if unknown.name in ("torque_constant", "resistance") and not dropped:
            text += ". Record a torque-off drop to separate K from R"
        found.append(text + ".")
    return found
