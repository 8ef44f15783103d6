"""Recordings simulated with a calibration, as the report shows them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from robolamp.assets import Assets
from robolamp.calibrate.lamp.session import LampSession
from robolamp.calibrate.lamp.simulation import simulate
from robolamp.calibrate.procedure import procedure
from robolamp.calibrate.report.calibration_page import Shown
from robolamp.calibrate.report.plots import Track
from robolamp.calibrate.servo.fast_pendulum import Pendulum, parameter_set
from robolamp.calibrate.servo.model_scores import parameters_of
from robolamp.calibrate.servo.recordings import Recording
from robolamp.calibration import Calibration
from robolamp.lamp import Lamp
from robolamp.twin.lamp_model import build


def show_session(session: LampSession, lamp: Lamp, calibration: Calibration, assets: Assets) -> list[Shown]:
    """Simulate every recording of a session with a calibration.

    Args:
        session: The recordings.
        lamp: The lamp that they are of.
        calibration: The twin's numbers.
        assets: Where the model is.

    Returns:
        The recordings, in the order in which they were made.
    """
    twins = {clamped: build(lamp, calibration, assets, clamped=clamped) for clamped in (True, False)}
    notes = {step.name: step.shows for step in procedure(lamp)}
    used = _used(calibration)
    shown = []
    for recording in session.recordings:
        run, rows = recording.run, recording.rows
        angle = simulate(recording, [twins[recording.clamped]]).angle[0]
        begin = float(run.began[recording.first])
        tracks = tuple(
            Track(
                label=joint,
                time=run.sampled_at[rows, index] - begin,
                goal=run.goal[rows, index],
                measured=run.angle[rows, index],
                simulated=angle[:, index],
            )
            for index, joint in enumerate(run.joints)
        )
        row = used.get(recording.sha256, {})
        before = row.get("mae_before")
        # Hops are fitted to for floor and contact alone: their joints were left out.
        fitted = bool(row.get("fitted", False)) if used else None
        note = notes.get(recording.name, "")
        shown.append(
            Shown(recording.name, note, fitted, tracks, float(before) if isinstance(before, float) else math.nan)
        )
    return shown


def show_bench(recordings: Sequence[Recording], calibration: Calibration) -> list[Shown]:
    """Simulate recordings of a servo on a pendulum bench with a calibration.

    Args:
        recordings: The recordings.
        calibration: The servo's numbers.

    Raises:
        FileError: A recording is of no pendulum, or the calibration knows nothing of its servo.
    """
    used, shown = _used(calibration), []
    for recording in recordings:
        values = parameters_of(recording, calibration)
        angle = Pendulum([recording]).simulate(parameter_set(values)[None])[0][0]
        track = Track("servo", recording.time - recording.time[0], recording.goal, recording.angle, angle)
        gains = sorted({round(float(gain)) for gain in recording.p_gain if math.isfinite(gain)})
        note = f"{recording.trajectory}, P gain {', '.join(map(str, gains))}".removeprefix(", ")
        row = used.get(recording.sha256)
        fitted = bool(row.get("fitted", True)) if row else (False if used else None)
        shown.append(Shown(recording.name, note, fitted, (track,)))
    return shown


def _used(calibration: Calibration) -> Mapping[str, Mapping[str, object]]:
    """Return what a calibration says of the recordings it was made from, by their hash."""
    rows = calibration.provenance.get("recordings", [])
    return {str(row["sha256"]): row for row in rows if isinstance(row, Mapping) and "sha256" in row}
