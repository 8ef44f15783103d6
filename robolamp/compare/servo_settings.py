"""The servos' settings in a run, by its log, against those that driver and lamp.toml want."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from robolamp.dynamixel.registers import FULL_PWM, MODELS, Model, Name, OperatingMode
from robolamp.lamp import Lamp
from robolamp.log.reader import Run
from robolamp.log.run_context import servo_settings


def wrong_settings(run: Run, lamp: Lamp) -> Iterator[tuple[str, str]]:
    """Yield each joint whose servo had wrong settings, and which, in words; nothing if the log does not say.

    Args:
        run: The log.
        lamp: The lamp's description.
    """
    found = servo_settings(run.context)
    gains = run.context.get("position_p_gain", "").split()  # a recording session's own
    own = len(gains) == len(lamp.joints) and all(gain.isdigit() for gain in gains)
    for index, joint in enumerate(lamp.joints):
        settings = found.get(joint.name, {})
        wanted = _wanted(MODELS[joint.servo], int(gains[index]) if own else joint.position_p_gain)
        wrong = [
            f"{name} {settings[name]}, not {value}"
            for name, value in wanted.items()
            if settings.get(name, value) != value
        ]
        if wrong:
            yield joint.name, ", ".join(wrong)


def _wanted(model: Model, p_gain: int) -> Mapping[Name, int]:
    """Return the right values by register: those that change how a servo goes to its goals, in counts.

    The twin's servos have a P gain alone, no profile, all of the supply (the e-manual's "Position PID Gain(80, 82,
    84), Feedforward Gain(88, 90)", "Drive Mode(10)", "Homing Offset(20)", "PWM Limit(36)", "PWM Slope(62)").
    """
    wanted = {
        Name.OPERATING_MODE: int(OperatingMode.POSITION),
        Name.DRIVE_MODE: 0,
        Name.HOMING_OFFSET: 0,
        Name.PWM_LIMIT: FULL_PWM,
        Name.POSITION_P_GAIN: p_gain,
        Name.POSITION_I_GAIN: 0,
        Name.POSITION_D_GAIN: 0,
        Name.FEEDFORWARD_1ST_GAIN: 0,
        Name.FEEDFORWARD_2ND_GAIN: 0,
        Name.PROFILE_ACCELERATION: 0,
        Name.PROFILE_VELOCITY: 0,
    }
    if Name.PWM_SLOPE in model.registers:
        wanted[Name.PWM_SLOPE] = model[Name.PWM_SLOPE].initial or 0
    return wanted
