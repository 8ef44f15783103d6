"""The calibration file of a whole lamp, made from a fit: every value with its error, and what it rests on."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import Table

from robolamp.assets import bare_name
from robolamp.calibrate.file_tables import covariance_table, lines, parameter_row, rounded, row
from robolamp.calibrate.lamp.findings import findings, verdict
from robolamp.calibrate.lamp.lamp_fit import LampFit
from robolamp.calibrate.lamp.session import LampSession
from robolamp.calibrate.lamp.unknowns import GEARS, MOST
from robolamp.calibration import LAMP, Calibration, Parameter
from robolamp.files import write_atomic
from robolamp.lamp import Lamp
from robolamp.log.run_context import versions

_SOURCES = {
    "line_delay": "median of tick begin to goals sent, by the log's stamps",
    "supply_voltage": "median of what the servos read",
    "supply_resistance": "voltage read against currents read",
    "arm_stiffness": "fitted to the clamped recordings",
    "mass_scale": "weighed",
    "foot_gain": "force at rest against the lamp's weight",
    "floor_friction": "length and flight times of the hops",
    "contact_softness": "length and flight times of the hops",
}


def write_lamp_file(path: Path, fit: LampFit, session: LampSession, lamp: Lamp, base: Calibration) -> None:
    """Write a fit as a calibration file.

    Args:
        path: Where to.
        fit: What was found.
        session: What it was found from.
        lamp: Whose it is.
        base: What was known before; parameters that were not found are its.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(path, lamp_file(bare_name(path.name), fit, session, lamp, base))


def lamp_file(name: str, fit: LampFit, session: LampSession, lamp: Lamp, base: Calibration) -> str:
    """Return the text of a fit's calibration file.

    Args:
        name: Of the calibration.
        fit: What was found.
        session: What it was found from.
        lamp: Whose it is.
        base: What was known before.
    """
    document = tomlkit.document()
    document.add(tomlkit.comment("Made by `robolamp calibrate lamp`; README.md in robolamp's calibration/ explains."))
    document.add("schema", tomlkit.item(1))
    document.add("name", tomlkit.item(name))
    document.add("provenance", _provenance(fit, session, lamp, base))
    whole = tomlkit.table()
    for key in LAMP:
        found, before = fit.lamp.get(key), base.groups["lamp"].get(key)
        if found:
            source = f"{_SOURCES[key]}; {session.folder.name}"
            whole.add(key, parameter_row(Parameter(rounded(found[0]), LAMP[key].unit, _error(found[1]), source)))
        elif before:
            whole.add(key, parameter_row(before))
    document.add("lamp", whole)
    servos = tomlkit.table(is_super_table=True)
    for model in dict.fromkeys(joint.servo for joint in lamp.joints):
        servo = tomlkit.table()
        for key, parameter in base.groups.get(model, {}).items():
            servo.add(key, parameter_row(parameter))
        servos.add(model, servo)
    document.add("servo", servos)
    joints = tomlkit.table(is_super_table=True)
    for joint in lamp.joints:
        own = tomlkit.table()
        for key, parameter in base.groups.get(f"joint {joint.name}", {}).items():
            own.add(key, parameter_row(parameter))
        for index, unknown in enumerate(fit.asked):
            if unknown.joint == joint.name and fit.identified(index):
                z = float(fit.z[index])
                error = unknown.stderr(z, float(fit.sigma[index]))
                source = f"fitted to {len(fit.trained)} recordings; {session.folder.name}"
                own[unknown.name] = parameter_row(
                    Parameter(rounded(unknown.value(z)), unknown.unit, _error(error), source)
                )
        joints.add(joint.name, own)
    document.add("joint", joints)
    return tomlkit.dumps(document)


def _provenance(fit: LampFit, session: LampSession, lamp: Lamp, base: Calibration) -> Table:
    manifest, judged = session.manifest, verdict(fit)
    table = tomlkit.table()
    table.add("kind", "lamp")
    table.add("made_from", f"{len(session.recordings)} recordings of {manifest.source}")
    table.add("session", session.folder.name)
    table.add("date", manifest.date)
    table.add("by", manifest.by)
    table.add("lamp_name", lamp.name)
    table.add("lamp_sha256", hashlib.sha256(lamp.source.encode()).hexdigest())
    table.add("base", base.name)
    table.add("base_sha256", base.hash)
    table.add("versions", versions())
    table.add("verdict", judged.text)
    table.add("findings", lines(findings(fit, session, lamp, base)))
    for key, value in (
        ("held_out_mae_before", judged.held_out[0]),
        ("held_out_mae", judged.held_out[1]),
        ("hop_travel_error", judged.travel),
        ("hop_time_error", judged.time),
    ):
        if math.isfinite(value):
            table.add(key, rounded(value))
    recordings = []
    for recording in session.recordings:
        said: dict[str, Any] = {"file": f"{recording.name}.mcap", "sha256": recording.sha256}
        if recording.name in fit.mae:
            before, after = fit.mae[recording.name]
            said |= {"fitted": recording.name in fit.trained, "mae_before": rounded(before), "mae": rounded(after)}
        recordings.append(row(said))
    table.add("recordings", lines(recordings))
    table.add("covariance", _covariance(fit))
    return table


def _covariance(fit: LampFit) -> Table:
    """Return the identified parameters' covariance, in their units: without play and stiffness, which no draw changes.

    A lamp drawn without play would be another model, not other numbers.
    """
    known = [index for index, unknown in enumerate(fit.asked) if fit.identified(index) and unknown.name not in GEARS]
    errors = np.array([fit.asked[i].stderr(float(fit.z[i]), float(fit.sigma[i])) for i in known])
    matrix = fit.correlation[np.ix_(known, known)] * np.outer(errors, errors)
    at_bound = [unknown.label for index, unknown in enumerate(fit.asked) if abs(fit.z[index]) >= 0.98 * MOST]
    return covariance_table([fit.asked[index].label for index in known], matrix, at_bound)


def _error(value: float) -> float | None:
    return rounded(value) if math.isfinite(value) else None
