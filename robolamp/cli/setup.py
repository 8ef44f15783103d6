"""`robolamp setup`: from a bag of new servos to a lamp that `deploy` accepts."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from robolamp.assets import Assets
from robolamp.cli.screen.output import print_json
from robolamp.errors import RobolampError
from robolamp.lamp import Joint, Lamp, load_lamp

if TYPE_CHECKING:
    from robolamp.robot.setup import Found

_SAMPLES = 10  # readings of a pose
_LOOK = 1.0  # s: how long the foot's force is averaged
_LAST_ID = 20  # the largest id that is looked for unless another is given
GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

Ask = Callable[[str], None]


Port = Annotated[str | None, Parameter(name="--port")]
FootPort = Annotated[str | None, Parameter(name="--foot-port")]
LastId = Annotated[int, Parameter(name="--last-id")]
Yes = Annotated[bool, Parameter(name=["--yes", "-y"], negative="")]
Own = Annotated[Path | None, Parameter(name="--lamp")]
Json = Annotated[bool, Parameter(name="--json", negative="")]

app = App(name="setup", help_format="plaintext", result_action="return_value")


@app.command(sort_key=0)
def scan(*, port: Port = None, last_id: LastId = _LAST_ID, lamp: Own = None, as_json: Json = False) -> int:
    """Show which servos answer: id, baud rate, model and firmware, and where several share an id.

    It asks every id up to --last-id at every baud rate, which takes some 10 seconds. It writes nothing.

    Args:
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        last_id: The largest id to look for.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    last, description = _legal_id(last_id), load_lamp(Assets.of(lamp))
    return _told(_scan(port or description.bus_port, last), as_json)


@app.command(sort_key=1)
def assign(
    *,
    joint: str | None = None,
    port: Port = None,
    last_id: LastId = _LAST_ID,
    lamp: Own = None,
    as_json: Json = False,
) -> int:
    """Give the one new servo on the line the id and baud rate of a joint, and Return Delay Time 0.

    Plug the servos in one at a time: new ones all have id 1, and two with one id would both obey. A servo that already
    has a joint's id may stay plugged in.

    Args:
        joint: The joint that the servo will move, as ankle.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        last_id: The largest id to look for.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    last, description = _legal_id(last_id), load_lamp(Assets.of(lamp))
    return _told(_assign(port or description.bus_port, description, joint, last), as_json)


@app.command(sort_key=2)
def zero(
    *,
    keep_signs: Annotated[bool, Parameter(negative="")] = False,
    yes: Yes = False,
    port: Port = None,
    lamp: Own = None,
    as_json: Json = False,
) -> int:
    """Find zeros and signs from poses that you hold by hand, and write them to lamp.toml. Torque must be off.

    It asks for the neutral pose, then for a push of each joint forward, and waits for Enter each time.

    Args:
        keep_signs: Find zeros only; the signs stay as they are.
        yes: Do not wait for Enter: the lamp is in its neutral pose now. Needs --keep-signs.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        lamp: Folder of your own lamp, as `robolamp new` makes it; its hardware/lamp.toml is written.
        as_json: Print one JSON object.
    """
    description = load_lamp(Assets.of(lamp))
    result = _zero(port or description.bus_port, description, keep_signs, None if yes else _ask)
    return _told(result, as_json)


@app.command(sort_key=3)
def foot(
    *,
    weight: float | None = None,
    yes: Yes = False,
    foot_port: FootPort = None,
    lamp: Own = None,
    as_json: Json = False,
) -> int:
    """Tare the foot sensor with the lamp lifted, scale it with a known weight, and write both to lamp.toml.

    It refuses to tare while the lamp stands on the foot.

    Args:
        weight: A weight in kg that you will set on the foot, 0.05 to 5.
        yes: Do not wait for Enter: nothing touches the foot now.
            With --weight, the weight is on the foot now and the tare of lamp.toml is kept.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        lamp: Folder of your own lamp, as `robolamp new` makes it; its hardware/lamp.toml is written.
        as_json: Print one JSON object.
    """
    description = load_lamp(Assets.of(lamp))
    return _told(_foot(foot_port or description.foot_port, description, weight, None if yes else _ask), as_json)


@app.command(sort_key=4)
def check(
    *,
    fix: Annotated[bool, Parameter(negative="")] = False,
    port: Port = None,
    foot_port: FootPort = None,
    lamp: Own = None,
    as_json: Json = False,
) -> int:
    """Check everything that deploy checks before it moves: servos, settings, state, pose, foot sensor.

    Stand the lamp on its foot. It names everything that is wrong at once, each with its remedy; docs/registers.md lists
    the settings. Exit code 0: ready; 2: not.

    Args:
        fix: Mend wrong settings that software may mend, and list them. If that changes what servo angles mean, nothing
            runs until `robolamp setup zero` has found zeros and signs again.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    description = load_lamp(Assets.of(lamp))
    ports = port or description.bus_port, foot_port or description.foot_port
    return _told(_check(*ports, description, fix), as_json)


def _told(result: dict[str, Any], as_json: bool) -> int:
    said = result.pop("said")
    if as_json:
        print_json(result)
    else:
        print(said)
    return 0


def _ask(text: str) -> None:
    from robolamp.cli.screen.prompt import STOP, answered
    from robolamp.runtime.stop import StopRequest

    print(f"{text} Then press Enter ({STOP}).", file=sys.stderr, flush=True)
    try:
        with StopRequest() as stop:
            line = answered(sys.stdin.readline, stop)
    except KeyboardInterrupt:
        print("robolamp: stopped; nothing was written", file=sys.stderr, flush=True)
        raise
    if not line:
        raise RobolampError(
            "ended without an answer; --yes (for zero with --keep-signs) asks nothing", "standard input"
        )


def _scan(port: str, last_id: int) -> dict[str, Any]:
    from robolamp.robot.setup import scan
    from robolamp.runtime.clock import MonotonicClock

    found = scan(port, MonotonicClock(), last=last_id)
    rows = [_row(servo) for servo in found]
    lines = [
        f"id {row['id']:3}  {row['baud']:8} baud  "
        + ("several servos, which garble or double each other's answers" if row.get("doubled") else "")
        + ("" if row["firmware"] is None else f"  {row['model']}  firmware {row['firmware']}")
        for row in rows
    ]
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
    found = everyone = scan(port, clock, last=max(last_id, *(other.id for other in lamp.joints)))
    done = {other.id for other in lamp.joints if other is not joint}  # servos that are another joint's already
    new = [servo for servo in found if servo.baud != lamp.bus_baud or servo.id not in done]
    found = new if len(found) > 1 else found
    if len(found) != 1:
        said = ", ".join(f"id {servo.id} at {servo.baud} baud" for servo in found) or "none"
        raise RobolampError(f"expected one servo alone on the line, or one that is no joint's yet; found {said}", port)
    model = found[0].model
    if not found[0].doubled and (model is None or model.name != joint.servo):
        what = model.name if model else f"model number {found[0].model_number}"
        raise RobolampError(f"{joint.name} is {joint.servo} in {lamp.path.name}; this servo is {what}", port)
    assign(port, clock, found[0], joint.id, lamp.bus_baud, everyone)
    said = f"{joint.name}: id {joint.id}, {lamp.bus_baud} baud, return delay 0 (was id {found[0].id}, {found[0].baud})"
    return {"joint": joint.name, "id": joint.id, "baud": lamp.bus_baud, "was": _row(found[0]), "said": said}


def _zero(port: str, lamp: Lamp, keep_signs: bool, ask: Ask | None) -> dict[str, Any]:
    from robolamp.dynamixel.bus import Bus
    from robolamp.dynamixel.servos import Servos
    from robolamp.robot.preflight import check_meaning
    from robolamp.robot.roll_call import PATIENCE, check_servos
    from robolamp.robot.setup import edit_lamp, set_joint, sign_of
    from robolamp.runtime.clock import MonotonicClock

    if ask is None and not keep_signs:
        raise RobolampError("finding signs needs a pose for each joint: --keep-signs, or without --yes", "--yes")
    doubtful = [f"{joint.name}'s ({joint.sign_wanted})" for joint in lamp.joints if joint.sign_wanted]
    if keep_signs and doubtful:
        raise RobolampError(f"the signs must be found again: {', '.join(doubtful)}", "--keep-signs")
    path = _writable(lamp)
    bus = Bus(port, lamp.bus_baud, MonotonicClock(), labels=dict(_labels(lamp)), patience=PATIENCE)
    bus.open()
    try:
        models, _ = check_servos(lamp, bus)
        check_meaning(lamp, bus, models)
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
            set_joint(document, index, sign=sign, zero=round(zero, 6), zero_wanted="")
            if not keep_signs:
                set_joint(document, index, sign_wanted="")

    edit_lamp(path, change)
    said = "\n".join(
        f"{joint.name}: zero {zero:.4f} rad (was {joint.zero:.4f}), sign {sign:+d} (was {joint.sign:+d})"
        for joint, sign, zero in zip(lamp.joints, signs, zeros, strict=True)
    )
    return {"lamp": path, "zeros_rad": zeros, "signs": signs, "said": f"{said}\nwritten to {path}"}


def _foot(port: str, lamp: Lamp, weight: float | None, ask: Ask | None) -> dict[str, Any]:
    from robolamp.foot.sensor import FootSensor
    from robolamp.robot.setup import check_stands, check_tare, edit_lamp, foot_mean, set_foot
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
            check_tare(tare, lamp)
            if ask and weight is None:
                ask("Stand the lamp on its foot.")
                check_stands(foot_mean(sensor, clock, _LOOK), tare, lamp)
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
    from robolamp.robot.robot_lamp import RobotLamp, servo_traits
    from robolamp.robot.setup import check_strangers
    from robolamp.runtime.clock import MAX_PERIOD, PERIOD, MonotonicClock, check_period, least_period

    wire = servo_traits(lamp).tick_time
    check_period(MAX_PERIOD, lamp, wire)
    check_strangers(port, MonotonicClock(), lamp)  # first: a refusal must not hide what --fix has mended
    robot = RobotLamp(lamp, port, foot_port, MonotonicClock(), fix=fix)
    try:
        robot.open()
        transport = robot.transport
    finally:
        robot.close()
    least = least_period(wire)
    if least > PERIOD:
        robot.notices.append(
            f"at bus.baud = {lamp.bus_baud} deploy refuses controllers with a control_period below {least:.3f} s "
            f"({PERIOD:g} unless they say otherwise); raise the rate, of the servos too (`robolamp setup assign`)"
        )
    lines = [f"mended: {text}" for text in robot.mended] + [f"note: {text}" for text in robot.notices]
    said = "\n".join([*lines, f"ready; a tick is read by {transport}"])
    return {"ready": True, "transport": transport, "mended": robot.mended, "notices": robot.notices, "said": said}


def _row(servo: Found) -> dict[str, Any]:
    name = servo.model.name if servo.model else f"model number {servo.model_number}"
    known = servo.firmware if servo.firmware >= 0 else None
    row = {"id": servo.id, "baud": servo.baud, "model": name, "firmware": known}
    return {**row, "doubled": True} if servo.doubled else row


def _labels(lamp: Lamp) -> list[tuple[int, str]]:
    return [(joint.id, joint.name) for joint in lamp.joints]


def _legal_id(value: int) -> int:
    if not 0 <= value <= 252:
        raise RobolampError(f"{value} is not an id from 0 to 252", "--last-id")
    return value


def _writable(lamp: Lamp) -> Path:
    from robolamp.robot.setup import read_only

    why = read_only(lamp.path)
    if why:
        raise RobolampError(why, str(lamp.path))
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
