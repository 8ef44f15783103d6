"""The calibration file of a servo fitted on a bench: values, errors, what they rest on."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import InlineTable, Table

from robolamp.assets import bare_name
from robolamp.calibrate.file_tables import covariance_table, lines, parameter_row, rounded, row
from robolamp.calibrate.servo.model_scores import BENCH
from robolamp.calibrate.servo.servo_fit import ServoFit, advice
from robolamp.calibration import JOINT, SERVO, Parameter
from robolamp.files import write_atomic
from robolamp.log.run_context import versions


def write_servo_file(path: Path, fit: ServoFit, *, by: str = "", date: str = "") -> None:
    """Write a fit as a calibration file.

    Args:
        path: Where to.
        fit: What was found.
        by: Who measured.
        date: When, as YYYY-MM-DD.

    Raises:
        FileError: It cannot be written.
    """
    write_atomic(path, servo_file(bare_name(path.name), fit, by=by, date=date))


def servo_file(name: str, fit: ServoFit, *, by: str = "", date: str = "") -> str:
    """Return the text of a fit's calibration file; the arguments are those of `write_servo_file`."""
    document = tomlkit.document()
    document.add(tomlkit.comment("Made by `robolamp calibrate fit`; README.md in robolamp's calibration/ explains."))
    document.add("schema", tomlkit.item(1))
    document.add("name", tomlkit.item(name))
    document.add("provenance", _provenance(fit, by, date))
    lamp = tomlkit.table()
    for key, parameter in fit.base.groups["lamp"].items():
        lamp.add(key, parameter_row(parameter))
    document.add("lamp", lamp)
    values = fit.solution.values
    servo = tomlkit.table()
    for key, legal in SERVO.items():
        before = fit.base.groups[fit.servo].get(key)
        if key in fit.solution.chart.names:
            servo.add(key, _fitted(fit, key, values[key]))
        elif legal.default is None and (before is None or values[key] != before.value):
            off = "off: the left-out recordings were not predicted better with it"
            servo.add(key, parameter_row(Parameter(values[key], legal.unit, None, off)))
        elif before is not None:
            servo.add(key, parameter_row(before))
    servos = tomlkit.table(is_super_table=True)
    servos.add(fit.servo, servo)
    document.add("servo", servos)
    own = tomlkit.table()
    own.add("encoder_offset", _fitted(fit, "encoder_offset", values["encoder_offset"]))
    joints = tomlkit.table(is_super_table=True)
    joints.add(BENCH, own)
    document.add("joint", joints)
    return tomlkit.dumps(document)


def _fitted(fit: ServoFit, name: str, value: float) -> InlineTable:
    legal = {**SERVO, **JOINT}[name]
    if fit.identified(name):
        parameter = Parameter(
            rounded(value), legal.unit, rounded(fit.stderr[name]), f"fitted to {len(fit.recordings)} recordings", True
        )
    elif name in fit.at_bound:
        parameter = Parameter(rounded(value), legal.unit, None, "fitted: at its bound", False)
    else:
        source = f"not determined by the recordings: its prior, from {fit.base.name}"
        parameter = Parameter(rounded(value), legal.unit, None, source, False)
    return parameter_row(parameter)


def _provenance(fit: ServoFit, by: str, date: str) -> Table:
    table = tomlkit.table()
    table.add("kind", "servo")
    table.add("made_from", f"{len(fit.recordings)} recordings of one {fit.servo} on a pendulum bench")
    if date:
        table.add("date", date)
    if by:
        table.add("by", by)
    table.add("base", fit.base.name)
    table.add("base_sha256", fit.base.hash)
    table.add("versions", versions())
    table.add("mae", rounded(float(fit.mae.mean())))
    if math.isfinite(fit.left_out_mae):
        table.add("left_out_mae", rounded(fit.left_out_mae))
    table.add("findings", lines(advice(fit)))
    rungs = []
    for each in fit.ladder:
        rung: dict[str, Any] = {"name": each.rung.name, "kept": each.kept, "mae": rounded(each.mae)}
        if math.isfinite(each.left_out_mae):
            rung["left_out_mae"] = rounded(each.left_out_mae)
        rungs.append(row(rung))
    table.add("ladder", lines(rungs))
    recordings = [
        row({"file": recording.name, "sha256": recording.sha256, "fitted": True, "mae": rounded(float(mae))})
        for recording, mae in zip(fit.recordings, fit.mae, strict=True)
    ]
    table.add("recordings", lines(recordings))
    table.add("covariance", _covariance(fit))
    return table


def _covariance(fit: ServoFit) -> Table:
    """Return the covariance of the identified parameters, in their units."""
    names = fit.solution.chart.names
    known = [index for index, name in enumerate(names) if fit.identified(name)]
    slope = fit.solution.chart.slope(fit.solution.z)
    matrix = (fit.solution.covariance * np.outer(slope, slope))[np.ix_(known, known)]
    return covariance_table([names[index] for index in known], matrix, fit.at_bound)
