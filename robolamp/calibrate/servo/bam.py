"""Parameter files of Rhoban/bam (JSON), to and from calibration files.

BAM's friction (Duclusaud et al. 2024, models m1, m2, m5 and m6) is robolamp's but for two terms. Its Stribeck friction
under load is |e_s tau_e - m_s tau_m|, here e_s |tau_e| + m_s |tau_m|: the same wherever motor and load pull against
each other. Its m6 adds a quadratic term, which robolamp has not. `q_offset` belongs to BAM's bench. What is left out is
told, and a file without a parameter of its model is refused.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from robolamp.assets import bare_name
from robolamp.calibration import SERVO, Calibration, Parameter
from robolamp.errors import FileError
from robolamp.files import parse_json, read_text, shown, write_atomic

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
    "command_delay": "delay",
}
"""BAM's names and robolamp's."""

_MOTOR = ("kt", "R", "armature", "friction_base", "friction_viscous")
_STRIBECK = ("friction_stribeck", "dtheta_stribeck", "alpha")
_LOAD = (
    "load_friction_motor", "load_friction_external", "load_friction_motor_stribeck", "load_friction_external_stribeck",
)  # fmt: skip
_MODELS: Mapping[str, tuple[str, ...]] = {
    "m1": _MOTOR,
    "m2": (*_MOTOR, *_STRIBECK),
    "m5": (*_MOTOR, *_STRIBECK, *_LOAD),
    "m6": (*_MOTOR, *_STRIBECK, *_LOAD),
}
"""What each model must give (BAM's bam/model.py), but for the quadratic terms, which robolamp has not."""

_QUADRATIC = ("load_friction_motor_quad", "load_friction_external_quad")
_NEWER = "command_delay"  # of every model, but only in files of the newer versions
_OFF = {"stribeck_velocity": 0.2, "stribeck_exponent": 1.0}  # where a model lacks the term; the others are 0


def import_bam(path: Path, out: Path, servo: str, base: Calibration) -> list[str]:
    """Turn a parameter file of BAM into a calibration file.

    Args:
        path: BAM's file.
        out: The calibration file to write.
        servo: Servo model that it is of.
        base: What BAM has not: the lamp, the gain's divisor, the delay.

    Returns:
        What was left out, and what was taken for granted, in words.

    Raises:
        FileError: The file is malformed, of another actuator, of a model that robolamp has not or without one of its
            parameters, or a value is outside its range.
    """
    data = parse_json(read_text(path), str(path))
    if not isinstance(data, dict) or data.get("model") not in [*_MODELS]:
        found = data.get("model") if isinstance(data, dict) else data
        raise FileError(f"model: {shown(found)} is not one of {', '.join(_MODELS)}", str(path))
    known = base.groups.get(servo)
    if known is None:
        raise FileError(f"has no servo {servo}", str(base.path))
    model, actuator = data["model"], data.get("actuator")
    if "actuator" in data and not _is_of(actuator, servo):
        raise FileError(f"actuator: is of {shown(actuator)}; expected parameters of {servo} (--servo)", str(path))
    needed = [*_MODELS[model], *([_NEWER] if _NEWER in data else [])]
    given = {name: _number(data, name, path) for name in needed}
    values = {}
    for theirs, ours in NAMES.items():
        if theirs == _NEWER not in data:
            continue
        value = given.get(theirs, _OFF.get(ours, 0.0))
        values[ours] = Parameter(value, SERVO[ours].unit, None, f"{path.name} of Rhoban/bam, {model}")
    document = tomlkit.document()
    document.add("schema", tomlkit.item(1))
    document.add("name", tomlkit.item(bare_name(out.name)))
    document.add("provenance", {"kind": "bam", "made_from": path.name, "model": model, "base": base.name})
    document.add("lamp", {name: _table(parameter) for name, parameter in base.groups["lamp"].items()})
    document.add("servo", {servo: {name: _table(each) for name, each in {**known, **values}.items()}})
    write_atomic(out, tomlkit.dumps(document))
    why = dict.fromkeys(_QUADRATIC, "robolamp has no quadratic term") | {"q_offset": "of BAM's bench"}
    told = [] if "actuator" in data else [f"the file names no actuator: taken as one of {servo}"]
    for name in (*why, *(name for name in data if name not in why)):
        if name in data and name not in (*needed, "model", "actuator") and data[name] != 0:
            told.append(f"{name} = {shown(data[name])}: {why.get(name, f'no parameter of model {model}')}")
    return told


def _is_of(actuator: Any, servo: str) -> bool:
    """Whether an actuator's name, as "xl330", is a servo model's or the beginning of it."""
    name = actuator.lower().replace("_", "-") if isinstance(actuator, str) else ""
    return bool(name) and f"{servo.lower()}-".startswith(f"{name}-")


def _number(data: Mapping[str, Any], name: str, path: Path) -> float:
    if name not in data:
        raise FileError(f"{name}: missing; expected it in a file of model {data['model']}", str(path))
    value, legal = data[name], SERVO[NAMES[name]]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not legal.low <= value <= legal.high:  # which is false of NaN, too
        expected = f"a number from {legal.low:g} to {legal.high:g} {legal.unit}"
        raise FileError(f"{name}: {shown(value)} is not {expected}", str(path))
    return float(value)


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
