"""`robolamp monitor`: what servos and foot sensor report, live."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.cli.options import seconds
from robolamp.cli.screen.output import print_json
from robolamp.errors import RobolampError
from robolamp.lamp import Joint, load_lamp

if TYPE_CHECKING:
    from rich.table import Table

    from robolamp.dynamixel.servo_state import ServoState
    from robolamp.foot.sensor import FootSensor

_PERIOD = 0.05  # s: twenty looks a second
_WAIT = 0.3  # s: how long one look waits for the foot sensor


def monitor(
    *,
    port: str | None = None,
    foot_port: str | None = None,
    duration: Annotated[float | None, Parameter(validator=seconds(0.1, 86_400.0))] = None,
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Show angles, velocities, currents, duty, voltage, temperature, torque and errors, and the foot's force.

    It writes nothing and moves nothing. It shows which servos do not answer.
    Watching feeds the servos' watchdogs, but one that has tripped stays so
    (`robolamp stop` releases it).

    Args:
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml; "none" to do without.
        duration: Stop after this many seconds; by default at Ctrl-C. Not with --json, which reads once.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Read once, print one JSON object, and end.
    """
    if as_json and duration is not None:
        raise RobolampError("is for the live table; --json takes one look and ends", "--duration")

    from rich.console import Console
    from rich.live import Live

    from robolamp.dynamixel.bus import SETTING_PATIENCE, Bus
    from robolamp.dynamixel.registers import MODELS
    from robolamp.dynamixel.servos import Servos
    from robolamp.foot.sensor import FootSensor
    from robolamp.runtime.clock import MonotonicClock
    from robolamp.runtime.stop import StopRequest

    description = load_lamp(Assets.of(lamp))
    joints = description.joints
    clock = MonotonicClock()
    bus = Bus(port or description.bus_port, description.bus_baud, clock, patience=SETTING_PATIENCE)
    foot: FootSensor | None = None
    if foot_port != "none":
        tare, scale = description.foot_tare, description.foot_scale
        name = foot_port or description.foot_port
        foot = FootSensor(name, description.foot_baud, clock, tare=tare, scale=scale)
    with StopRequest() as stop:
        try:
            bus.open()
            if foot:
                foot.open()
            servos = Servos(bus, [joint.id for joint in joints], [MODELS[joint.servo] for joint in joints])
            end = math.inf if duration is None else clock.now() + duration
            if as_json:
                until = clock.now() + _WAIT
                while foot and not foot.poll() and clock.now() < until:
                    clock.sleep_until(clock.now() + 0.005)
                print_json(_facts(joints, servos.read(), foot))
                return 0
            console = Console()
            with Live(console=console, auto_refresh=False) as live:
                while not stop.requests and clock.now() < end:
                    state = servos.read()
                    if foot:
                        foot.poll()
                    live.update(_table(_facts(joints, state, foot)), refresh=True)
                    clock.sleep_until(clock.now() + _PERIOD)
            if not console.is_terminal:  # a live table ends its last line only there
                console.line()
        finally:
            bus.close()
            if foot:
                foot.close()
    return 0


def _facts(joints: Sequence[Joint], state: ServoState, foot: FootSensor | None) -> dict[str, Any]:
    """Return all readings once, with units in the keys; a missing value is NaN or None."""
    from robolamp.dynamixel.registers import HardwareError
    from robolamp.robot.joint_frame import wrapped

    rows: list[dict[str, Any]] = []
    for index, joint in enumerate(joints):
        torque, error = int(state.torque[index]), int(state.hardware_error[index])
        rows.append(
            {
                "joint": joint.name,
                "id": joint.id,
                "angle_rad": float(wrapped(joint.sign * (state.position[index : index + 1] - joint.zero))[0]),
                "servo_angle_rad": state.position[index],
                "velocity_rad_s": joint.sign * state.velocity[index],
                "current_a": joint.sign * state.current[index],
                "duty": joint.sign * state.pwm[index],
                "voltage_v": state.voltage[index],
                "temperature_degc": state.temperature[index],
                "torque": None if torque < 0 else bool(torque),
                "hardware_error": None if error < 0 else HardwareError.words(error),
            }
        )
    return {
        "servos": rows,
        "foot_force_n": foot.force if foot else None,
        "foot_age_s": foot.age if foot else None,
        "foot_lost_frames": foot.decoder.lost if foot else None,
    }


def _table(facts: dict[str, Any]) -> Table:
    from rich.table import Table

    force, age = facts["foot_force_n"], facts["foot_age_s"]
    said = "no foot sensor" if force is None else f"foot {force:.2f} N, {age * 1e3:.0f} ms old"
    table = Table(caption=f"{said}   Ctrl-C ends", highlight=False)
    for heading in ("joint", "angle rad", "rad/s", "A", "duty", "V", "degC", "torque", "state"):
        table.add_column(heading, justify="left" if heading in {"joint", "state"} else "right", no_wrap=True)
    for row in facts["servos"]:
        torque = {None: "?", True: "on", False: "off"}[row["torque"]]
        state = "no answer" if math.isnan(row["angle_rad"]) else row["hardware_error"] or "ok"
        keys = (("angle_rad", "+.3f"), ("velocity_rad_s", "+.2f"), ("current_a", "+.3f"), ("duty", "+.2f"))
        keys += (("voltage_v", ".1f"), ("temperature_degc", ".0f"))
        values = ["-" if math.isnan(row[key]) else format(row[key], form) for key, form in keys]
        table.add_row(row["joint"], *values, torque, state)
    return table
