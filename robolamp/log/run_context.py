"""The run's context: the texts that a log keeps beside its messages, so that it explains itself years later."""

from __future__ import annotations

import json
import math
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version

from robolamp.calibration import Calibration
from robolamp.lamp import Lamp

SERVO_SETTINGS = "servo_settings"
"""Where the context keeps what the servos were set to once torque was on; a log of 0.1.0 has none."""

ODOMETER = "odometer"
"""Where the context keeps the text of the lamp's odometer."""

PLAYED = ("gesture", "sequence")
"""Where the context keeps the text of what was played in place of a controller."""

_PACKAGES = ("robolamp", "mujoco", "numpy", "dynamixel-sdk", "mcap")


def versions() -> str:
    """Return the versions of Python and of the packages that a run depends on, as "python 3.11.7, mujoco 4.0.0"."""
    found = [f"python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def run_context(
    *,
    backend: str,
    lamp: Lamp,
    calibration: Calibration,
    controller: str,
    controller_name: str,
    terminals: Sequence[str],
    goal: float,
    control_period: float,
    goal_time: float | None = None,
) -> dict[str, str]:
    """Return the context of a run for `LogWriter`.

    Args:
        backend: What is being driven, "twin", "emulator" or "lamp".
        lamp: The lamp's description.
        calibration: The calibration in force.
        controller: The controller file's text; empty where something else drives.
        controller_name: Its name, or that of what else drives.
        terminals: Names of the controller's terminals, in the order of the ticks' `inputs`.
        goal: Where to go [m]; NaN: nowhere.
        control_period: Time from tick to tick [s].
        goal_time: Commanded time to take for the way [s]; None: none is commanded.
    """
    return {
        "backend": backend,
        "lamp": lamp.source,
        "lamp_name": lamp.name,
        "calibration": calibration.source,
        "calibration_name": calibration.name,
        "calibration_hash": calibration.hash,
        "controller": controller,
        "controller_name": controller_name,
        "terminals": " ".join(terminals),
        **({} if math.isnan(goal) else {"goal_m": repr(float(goal))}),
        **({} if goal_time is None else {"goal_time_s": repr(float(goal_time))}),
        "control_period": repr(float(control_period)),
        "flight_time_s": repr(float(lamp.flight_time)),
        **({} if lamp.odometer is None else {ODOMETER: lamp.odometer.source}),
        "versions": versions(),
        "command": shlex.join(sys.argv),
    }


def settings_context(settings: Mapping[str, Mapping[str, int]]) -> dict[str, str]:
    """Return what the servos are set to, as a context keeps it; empty where nothing is known.

    Args:
        settings: By joint and register, in counts.
    """
    return {SERVO_SETTINGS: json.dumps(settings)} if settings else {}


def servo_settings(context: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """Return what the servos were set to in a run, by joint and register, in counts; empty where it is not known.

    Args:
        context: The run's.
    """
    try:
        found = json.loads(context.get(SERVO_SETTINGS, "{}"))
        return {
            str(joint): {str(name): int(value) for name, value in registers.items()}
            for joint, registers in found.items()
        }
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):  # OverflowError: of an infinity
        return {}
