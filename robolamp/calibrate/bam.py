"""Parameter files of Rhoban/bam (JSON), to and from calibration files.

BAM's friction (Duclusaud et al. 2024, models m1, m2, m5 and m6) is robolamp's but for two terms. Its Stribeck friction
under load is |e_s tau_e - m_s tau_m|, here e_s |tau_e| + m_s |tau_m|: the same wherever motor and load pull against
each other. Its m6 adds a quadratic term, which robolamp has not. `q_offset` belongs to BAM's bench and is left out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from robolamp.calibration import SERVO, Calibration, Parameter
from robolamp.errors import FileError
from robolamp.files import read_text, write_atomic

NAMES: Mapping[str, str] = {
    "kt": "torque_constant",
    "R": "resistance",
    "armature": "armature",
    "friction_viscous": "viscous",
    "friction_base": "coulomb",
    "friction_stribeck": "stribeck",
    "dtheta_stribeck": "stribeck_velocity",
    "alpha": "stribeck_exponent",
    "load_friction_motor": "load_motor",
    "load_friction_external": "load_external",
    "load_friction_external_stribeck": "load_external_stribeck",
    "load_friction_motor_stribeck": "load_motor_stribeck",
}
"""BAM's names and robolamp's."""

_MODELS = ("m1", "m2", "m5", "m6")
_QUADRATIC = ("load_friction_motor_quad", "load_friction_external_quad")
_OFF = {"stribeck_velocity": 0.2, "stribeck_exponent": 1.0}  # where a model lacks the term; the others are 0


def import_bam(path: Path, out: Path, servo: str, base: Calibration) -> list[str]:
    """Turn a parameter file of BAM into a calibration file.

    Args:
        path: BAM's file.
        out: The calibration file to write.
        servo: Servo model that it is of.
        base: What BAM has not: the lamp, the gain's divisor, the delay.

    Returns:
        What was left out, in words.

    Raises:
        FileError: The file is malformed, of a model that robolamp has not, or a value is outside its range.
    """
    try:
        data = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise FileError(f"not valid JSON: {error}", str(path)) from None
    if not isinstance(data, dict) or data.get("model") not in _MODELS:
        found = data.get("model") if isinstance(data, dict) else data
        raise FileError(f"model: {found!r} is not one of {', '.join(_MODELS)}", str(path))
    known = base.groups.get(servo)
    if known is None:
        raise FileError(f"has no servo {servo}", str(base.path))
    values = {}
    for theirs, ours in NAMES.items():
        value, legal = data.get(theirs, _OFF.get(ours, 0.0)), SERVO[ours]
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not number or not legal.low <= value <= legal.high:
            raise FileError(
                f"{theirs}: {value!r} is not a number from {legal.low:g} to {legal.high:g} {legal.unit}", str(path)
            )
        values[ours] = Parameter(float(value), legal.unit, None, f"{path.name} of Rhoban/bam, {data['model']}")
    document = tomlkit.document()
    document.add("schema", tomlkit.item(1))
    document.add("name", tomlkit.item(out.stem))
    document.add("provenance", {"kind": "bam", "made_from": path.name, "model": data["model"], "base": base.name})
    document.add("lamp", {name: _table(parameter) for name, parameter in base.groups["lamp"].items()})
    document.add("servo", {servo: {name: _table(each) for name, each in {**known, **values}.items()}})
    write_atomic(out, tomlkit.dumps(document))
    return [f"{name} = {data[name]:g}: robolamp has no quadratic term" for name in _QUADRATIC if data.get(name)]


def export_bam(calibration: Calibration, out: Path, servo: str) -> list[str]:
    """Write a servo's parameters as BAM has them, model m5.

    Args:
        calibration: The calibration.
        out: The JSON file to write.
        servo: Servo model.

    Returns:
        What BAM has no place for, in words.

    Raises:
        FileError: The calibration lacks the servo, or the file cannot be written.
    """
    values = calibration.servo(servo, "")
    data: dict[str, Any] = {"model": "m5", "actuator": servo, **{b: values[ours] for b, ours in NAMES.items()}}
    write_atomic(out, json.dumps(data, indent=4) + "\n")
    lost = [name for name, legal in SERVO.items() if name not in NAMES.values() and values[name] != legal.default]
    return [f"{name} = {values[name]:g} {SERVO[name].unit}: not in BAM's files" for name in lost]


def _table(parameter: Parameter) -> dict[str, Any]:
    error = {} if parameter.stderr is None else {"stderr": parameter.stderr}
    return {"value": parameter.value, "unit": parameter.unit, **error, "source": parameter.source}
