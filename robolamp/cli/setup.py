"""`robolamp setup`: from a bag of new servos to a lamp that `deploy` accepts."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.cli.output import print_json
from robolamp.errors import RobolampError
from robolamp.lamp import Joint, Lamp, load_lamp

if TYPE_CHECKING:
    from robolamp.robot.setup import Found

_SAMPLES = 10  # readings of a pose
_LOOK = 1.0  # s: how long the foot's force is averaged
_LAST_ID = 20  # the largest id that is looked for unless another is given
_STEPS_OF = {  # which steps an option is for; ports may be given to all
    "--joint": ("assign",),
    "--keep-signs": ("zero",),
    "--weight": ("foot",),
    "--last-id": ("scan", "assign"),
    "--fix": ("check",),
    "--yes": ("zero", "foot"),
}
GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

Ask = Callable[[str], None]


def setup(
    step: Literal["scan", "assign", "zero", "foot", "check"],
    /,
    *,
    port: str | None = None,
    foot_port: str | None = None,
    joint: str | None = None,
    keep_signs: Annotated[bool, Parameter(negative="")] = False,
    weight: float | None = None,
    last_id: int | None = None,
    fix: Annotated[bool, Parameter(negative="")] = False,
    yes: Annotated[bool, Parameter(name=["--yes", "-y"], negative="")] = False,
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Set up the physical lamp, step by step; torque stays off throughout.

    scan: which servos answer, at which id and baud rate. assign: give the one
    new servo on the line the id and baud rate of --joint. zero: find zeros and
    signs from poses you hold by hand, and write them to lamp.toml. foot: tare
    the foot sensor, and scale it with a known --weight. check: everything that
    deploy checks before it moves.

    Args:
        step: What to do.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        joint: For assign: whose servo it is to be.
        keep_signs: For zero: find zeros only; the signs stay as they are.
        weight: For foot: a weight in kg that you will set on the foot.
        last_id: For scan and assign: the largest id to look for; 20 unless given.
        fix: For check: mend settings that software may mend.
        yes: Do not wait for Enter: the lamp is as it should be now. With zero it needs --keep-signs.
            With foot and --weight, the weight is on the foot now and the tare of lamp.toml is kept.
        lamp: A folder of your own lamp, laid out like robolamp's; zero and foot write into it.
        as_json: Print one JSON object.
    """
    given = {
        "--joint": joint is not None,
        "--keep-signs": keep_signs,
        "--weight": weight is not None,
        "--last-id": last_id is not None,
        "--fix": fix,
        "--yes": yes,
    }
    for option, steps in _STEPS_OF.items():
        if given[option] and step not in steps:
            raise RobolampError(f"is for {' and '.join(steps)}, not for {step}", option)
    last = _legal_id(_LAST_ID if last_id is None else last_id)
    description = load_lamp(Assets.of(lamp))
    servos, foot = port or description.bus_port, foot_port or description.foot_port
    if step == "scan":
        result = _scan(servos, last)
    elif step == "assign":
        result = _assign(servos, description, joint, last)
    elif step == "zero":
        result = _zero(servos, description, keep_signs, None if yes else _ask)
    elif step == "foot":
        result = _foot(foot, description, weight, None if yes else _ask)
    else:
        result = _check(servos, foot, description, fix)
    said = result.pop("said")
    if as_json:
        print_json(result)
    else:
        print(said)
    return 0


def _ask(text: str) -> None:
    from robolamp.cli.prompt import STOP, answered
    from robolamp.runtime.stop import StopRequest

    print(f"{text} Then press Enter ({STOP}).", file=sys.stderr, flush=True)
    try:
        with StopRequest() as stop:
            line = answered(sys.stdin.readline, stop)
    except KeyboardInterrupt:
        print("robolamp: stopped; nothing was written", file=sys.stderr, flush=True)
        raise
    if not line:
        raise RobolampError("nobody answers here; --yes goes without questions", "standard input")


def _scan(port: str, last_id: int) -> dict[str, Any]:
    from robolamp.robot.setup import scan
    from robolamp.runtime.clock import MonotonicClock

    found = scan(port, MonotonicClock(), last=last_id)
    rows = [_row(servo) for servo in found]
    lines = [f"id {row['id']:3}  {row['baud']:8} baud  {row['model']}  firmware {row['firmware']}" for row in rows]
    nothing = f"no servo with an id up to {last_id} answers; check supply and cable, or try --last-id 252"
    return {"port": port, "servos": rows, "said": "\n".join(lines) or nothing}


def _assign(port: str, lamp: Lamp, name: str | None, last_id: int) -> dict[str, Any]:
    from robolamp.robot.setup import assign, scan
    from robolamp.runtime.clock import MonotonicClock

    joint = next((joint for joint in lamp.joints if joint.name == name), None)
    if joint is None:
        said = "assign wants --joint" if name is None else f"{name!r} is not a joint"
        raise RobolampError(f"{said}; expected one of {', '.join(lamp.names)}", "--joint")
    clock = MonotonicClock()
    found = scan(port, clock, last=last_id)
    done = {other.id for other in lamp.joints if other is not joint}  # servos that are another joint's already
    new = [servo for servo in found if servo.baud != lamp.bus_baud or servo.id not in done]
    found = new if len(found) > 1 else found
    if len(found) != 1:
        said = ", ".join(f"id {servo.id} at {servo.baud} baud" for servo in found) or "none"
        raise RobolampError(f"expected one servo alone on the line, or one that is no joint's yet; found {said}", port)
    model = found[0].model
    if model is None or model.name != joint.servo:
        what = model.name if model else f"model number {found[0].model_number}"
        raise RobolampError(f"{joint.name} is {joint.servo} in {lamp.path.name}; this servo is {what}", port)
    assign(port, clock, found[0], joint.id, lamp.bus_baud)
    said = f"{joint.name}: id {joint.id}, {lamp.bus_baud} baud, return delay 0 (was id {found[0].id}, {found[0].baud})"
    return {"joint": joint.name, "id": joint.id, "baud": lamp.bus_baud, "was": _row(found[0]), "said": said}


def _zero(port: str, lamp: Lamp, keep_signs: bool, ask: Ask | None) -> dict[str, Any]:
    from robolamp.dynamixel.bus import SETTING_PATIENCE, Bus
    from robolamp.dynamixel.servos import Servos
    from robolamp.robot.preflight import check_servos
    from robolamp.robot.setup import edit_lamp, set_joint, sign_of
    from robolamp.runtime.clock import MonotonicClock

    if ask is None and not keep_signs:
        raise RobolampError("finding signs needs a pose for each joint: --keep-signs, or without --yes", "--yes")
    path = _writable(lamp)
    bus = Bus(port, lamp.bus_baud, MonotonicClock(), labels=dict(_labels(lamp)), patience=SETTING_PATIENCE)
    bus.open()
    try:
        models, _ = check_servos(lamp, bus)
        servos = Servos(bus, [joint.id for joint in lamp.joints], models)
        if (servos.read().torque != 0).any():
            raise RobolampError("torque is on; `robolamp stop` first, holding the lamp", bus.name)
        if ask:
            ask("Hold the lamp in its neutral pose (all joints at 0).")
        zeros = _pose(servos, lamp)
        signs = [joint.sign for joint in lamp.joints]
        for index, joint in enumerate(lamp.joints if ask and not keep_signs else ()):
            assert ask
            ask(f"Push {joint.name} forward (what is above it pitches forward and down) by about 20 degrees.")
            signs[index] = sign_of(zeros[index], _pose(servos, lamp)[index], joint.name)
    finally:
        bus.close()
    for joint, sign, zero in zip(lamp.joints, signs, zeros, strict=True):
        _inside(joint, sign, zero, port)

    def change(document: Any) -> None:
        for index, (sign, zero) in enumerate(zip(signs, zeros, strict=True)):
            set_joint(document, index, sign=sign, zero=round(zero, 6))

    edit_lamp(path, change)
    said = "\n".join(
        f"{joint.name}: zero {zero:.4f} rad (was {joint.zero:.4f}), sign {sign:+d} (was {joint.sign:+d})"
        for joint, sign, zero in zip(lamp.joints, signs, zeros, strict=True)
    )
    return {"lamp": path, "zeros_rad": zeros, "signs": signs, "said": f"{said}\nwritten to {path}"}


def _foot(port: str, lamp: Lamp, weight: float | None, ask: Ask | None) -> dict[str, Any]:
    from robolamp.foot.sensor import FootSensor
    from robolamp.robot.setup import edit_lamp, foot_mean, set_foot
    from robolamp.runtime.clock import MonotonicClock

    if weight is not None and not 0.05 <= weight <= 5.0:
        raise RobolampError(f"{weight:g} is not a weight from 0.05 to 5 kg", "--weight")
    path = _writable(lamp)
    clock = MonotonicClock()
    sensor = FootSensor(port, lamp.foot_baud, clock)
    sensor.open()
    try:
        tare, scale = lamp.foot_tare, None
        if ask or weight is None:
            if ask:
                ask("Lift the lamp: nothing touches its foot.")
            tare = foot_mean(sensor, clock, _LOOK)
        if weight is not None:
            if ask:
                ask(f"Set {weight:g} kg on the plate of the foot, the lamp lying on its side or held.")
            loaded = foot_mean(sensor, clock, _LOOK)
            if loaded - tare < lamp.contact_on:
                raise RobolampError(
                    f"{weight:g} kg raise it by {loaded - tare:.2f} N only; expected {weight * GRAVITY:.2f} N", port
                )
            scale = weight * GRAVITY / (loaded - tare)
    finally:
        sensor.close()
    edit_lamp(path, lambda document: set_foot(document, tare, scale))
    said = f"foot: tare {tare:+.3f} N" + (f", scale {scale:.4f}" if scale else "")
    scale = lamp.foot_scale if scale is None else scale
    return {"lamp": path, "tare_n": tare, "scale": scale, "said": f"{said}\nwritten to {path}"}


def _check(port: str, foot_port: str, lamp: Lamp, fix: bool) -> dict[str, Any]:
    from robolamp.robot.lamp import RobotLamp
    from robolamp.runtime.clock import MonotonicClock

    robot = RobotLamp(lamp, port, foot_port, MonotonicClock(), fix=fix)
    try:
        robot.open()
        transport = robot.transport
    finally:
        robot.close()
    lines = [f"mended: {text}" for text in robot.mended] + [f"note: {text}" for text in robot.notices]
    said = "\n".join([*lines, f"ready; a tick is read by {transport}"])
    return {"ready": True, "transport": transport, "mended": robot.mended, "notices": robot.notices, "said": said}


def _row(servo: Found) -> dict[str, Any]:
    name = servo.model.name if servo.model else f"model number {servo.model_number}"
    return {"id": servo.id, "baud": servo.baud, "model": name, "firmware": servo.firmware}


def _labels(lamp: Lamp) -> list[tuple[int, str]]:
    return [(joint.id, joint.name) for joint in lamp.joints]


def _legal_id(value: int) -> int:
    if not 0 <= value <= 252:
        raise RobolampError(f"{value} is not an id from 0 to 252", "--last-id")
    return value


def _writable(lamp: Lamp) -> Path:
    if "_assets" in lamp.path.parts:
        raise RobolampError("is part of the installed package; give a folder of your own with --lamp", str(lamp.path))
    return lamp.path


def _pose(servos: Any, lamp: Lamp) -> list[float]:
    """Return the servo angles of the pose the lamp is held in [rad]."""
    import numpy as np

    from robolamp.robot.setup import mean_angle

    samples = np.array([servos.read().position for _ in range(_SAMPLES)])
    if np.isnan(samples).any():
        names = ", ".join(lamp.names[index] for index in np.flatnonzero(np.isnan(samples).any(axis=0)))
        raise RobolampError(f"{names} did not answer to every reading; check the cable", "the servo bus")
    return [float(value) for value in mean_angle(samples)]


def _inside(joint: Joint, sign: int, zero: float, port: str) -> None:
    ends = sorted((zero + sign * joint.lower, zero + sign * joint.upper))
    if ends[0] < 0.0 or ends[1] >= 2 * math.pi:
        raise RobolampError(
            f"{joint.name} would turn from {ends[0]:.2f} to {ends[1]:.2f} rad, across the end of the servo's turn "
            "(0 to 6.28); mount its horn half a turn on, and try again",
            port,
        )
