"""`robolamp gesture`: short motions of the lamp: which there are, whether it can play them, play one, record one."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from robolamp.assets import Assets
from robolamp.cli.options import Setup
from robolamp.cli.options import seconds as between
from robolamp.cli.run.played import HERE, Player
from robolamp.cli.screen.output import counted, print_json
from robolamp.errors import FileError, RobolampError
from robolamp.lamp import load_lamp

if TYPE_CHECKING:
    from robolamp.lamp import Lamp
    from robolamp.pose.gesture import Gesture
    from robolamp.twin.standing import Standing

app = App(name="gesture", help_format="plaintext", result_action="return_value")
Json = Annotated[bool, Parameter(name="--json", negative="")]


@app.command(name="list")
def list_(*, lamp: Path | None = None, as_json: Json = False) -> int:
    """List the gestures that play, check and `robolamp render` know by name.

    Args:
        lamp: Folder of your own lamp, as `robolamp new` makes it; its gestures come first.
        as_json: Print one JSON object.
    """
    from robolamp.pose.gesture_file import all_gestures, load_gesture

    assets = Assets.of(lamp)
    described = load_lamp(assets)
    rows = [(path, load_gesture(path, described)) for path in all_gestures(assets)]
    if as_json:
        print_json({"gestures": [{**_facts(gesture), "file": path} for path, gesture in rows]})
        return 0
    for _, gesture in rows:
        frames = counted(len(gesture.frames), "frame")
        print(f"{gesture.name:<12} {gesture.duration:5.1f} s  {frames:<10} {gesture.says}")
    own = [] if lamp is None else ["--lamp", str(lamp)]
    print(f"\nSee one move: {shlex.join(['robolamp', 'gesture', 'play', 'curious', '--open', *own])}")
    return 0


@app.command
def check(
    gesture: str,
    /,
    *,
    speed: float | None = None,
    loops: int | None = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: Json = False,
) -> int:
    """Try on the twin, the MuJoCo model of the lamp, whether the lamp can play a gesture where it stands.

    It must keep the joints inside their limits and below their slew limits, keep the lamp's balance, keep its links
    apart, and not strain the servos. Exit code 0: it does; 2: it does not, and a line names the moment and the joint.

    Args:
        gesture: A gesture file, or the name of a shipped one (nod).
        speed: How much faster than its file has it.
        loops: How many times over.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)
    found = _loaded(setup, gesture, speed, loops)
    from robolamp.cli.run.gesture_check import check_gesture

    standing = check_gesture(found, setup)
    if as_json:
        print_json({**_facts(found), **_measured(found, standing, setup.lamp)})
    else:
        print(_told(found, standing, setup.lamp))
    return 0


@app.command
def play(
    gesture: str,
    /,
    *,
    speed: float | None = None,
    loops: int | None = None,
    player: Player = HERE,
) -> int:
    """Play a gesture: on the emulated lamp, or with --port on the physical one.

    It is checked on the twin first, as `robolamp gesture check` does. Then it is played as dry-run and deploy run a
    controller: soft start, the gesture, soft landing, torque off; with log and report. Ctrl-C, and in a terminal q,
    Space or Esc, lands the lamp softly; Ctrl-C again turns its torque off at once.

    Args:
        gesture: A gesture file, or the name of a shipped one (nod).
        speed: How much faster than its file has it.
        loops: How many times over.
        player: Where and how.
    """
    found = _loaded(player.setup, gesture, speed, loops)

    from robolamp.cli.run.gesture_check import check_gesture
    from robolamp.pose.gesture import PERIOD

    check_gesture(found, player.setup)
    return player.play(found, found.goal, found.duration + PERIOD)  # the last goal is its last pose


@app.command
def record(
    name: str,
    /,
    *,
    port: str | None = None,
    foot_port: str | None = None,
    seconds: Annotated[float, Parameter(validator=between(1.0, 120.0))] = 10.0,
    soft: Annotated[bool, Parameter(negative="")] = False,
    tolerance: float = 0.05,
    frames: int = 20,
    calibration: str = "nominal",
    lamp: Path | None = None,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    as_json: Json = False,
) -> int:
    """Record a gesture: you move the lamp by hand, and a few key frames of what you did become a gesture file.

    Torque is off: hold the lamp before you start, and all the time. With --soft the servos carry its weight, and give
    way where you push. It says when to begin and when it is over; Ctrl-C ends it before. What the file has of the
    recording is said: how many frames, and how far a joint is off at most. The log of the recording stays beside it.

    Args:
        name: What to call it.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        seconds: How long to record; still beginnings and ends are cut off.
        soft: Let the servos carry the lamp's weight.
        tolerance: How far a joint may be off the recording, in radians.
        frames: How many key frames it may have.
        calibration: Calibration of the twin that it is tried on afterwards: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        output: The gesture file to write; by default NAME.toml here.
        as_json: Print one JSON object.
    """
    from robolamp.controller.controller_file import slug

    if slug(name) != name:
        raise RobolampError(f"{name[:64]!r} is not 1 to 64 letters, digits, spaces, or . _ - (no such first)", "NAME")
    for option, value, low, high in (("--tolerance", tolerance, 0.005, 0.5), ("--frames", frames, 3, 200)):
        if not low <= value <= high:
            raise RobolampError(f"{value:g} is not a number from {low:g} to {high:g}", option)
    setup = Setup.of(lamp, calibration)
    file = output or Path(f"{name}.toml")
    log = file.with_suffix(".mcap")
    for path in (file, log):
        if path.exists():
            raise FileError("is there already; give another -o", str(path))

    from robolamp.cli.run.gesture_check import check_gesture  # after the arguments are checked
    from robolamp.cli.run.recorded import recorded
    from robolamp.pose.gesture_file import load_gesture, save_gesture

    ports = port or setup.lamp.bus_port, foot_port or setup.lamp.foot_port
    found = recorded(setup, name, ports, log, seconds, soft, tolerance, frames, as_json)
    off = f"at most {found.worst * 1e3:.0f} mrad from it, {found.mean * 1e3:.0f} on the average"
    made = f"{counted(len(found.gesture.frames), 'key frame')} for {found.length:.1f} s of recording, {off}"
    save_gesture(found.gesture, file, f"Recorded by hand: {made}.")
    why = ""
    try:
        check_gesture(load_gesture(file, setup.lamp), setup)
    except RobolampError as error:
        why = error.message
    if as_json:
        print_json(
            {
                **_facts(found.gesture),
                "file": file,
                "log": log,
                "worst_mrad": found.worst * 1e3,
                "mean_mrad": found.mean * 1e3,
                "recorded_s": found.length,
                "playable": not why,
                "why": why or None,
            }
        )
        return 0
    print(f"{file}: {made}\nlog: {log}")
    again = shlex.join(["robolamp", "gesture", "play", str(file), *setup.words])
    print(f"The lamp cannot play it as it is: {why}" if why else f"See it move: {again}")
    return 0


def _loaded(setup: Setup, name: str, speed: float | None, loops: int | None) -> Gesture:
    """Return a gesture by path or name, at the speed and as often as was asked for.

    Raises:
        RobolampError: There is none, its file is malformed, or it is too fast or too long.
    """
    from robolamp.pose.gesture import MOST_LOOPS, QUICKEST, SLOWEST, altered, check_slew
    from robolamp.pose.gesture_file import find_gesture, load_gesture

    for option, value, low, high in (("--speed", speed, SLOWEST, QUICKEST), ("--loops", loops, 1, MOST_LOOPS)):
        if value is not None and not low <= value <= high:
            raise RobolampError(f"{value:g} is not a number from {low:g} to {high:g}", option)
    found = altered(load_gesture(find_gesture(name, setup.assets), setup.lamp), speed, loops)
    check_slew(found, setup.lamp)
    return found


def _facts(gesture: Gesture) -> dict[str, Any]:
    return {
        "gesture": gesture.name,
        "says": gesture.says,
        "duration_s": gesture.duration,
        "frames": len(gesture.frames),
        "loops": gesture.loops,
        "speed": gesture.speed,
    }


def _measured(gesture: Gesture, standing: Standing, lamp: Lamp) -> dict[str, Any]:
    turns = gesture.motion().turns()
    goals, stall = standing.goal, standing.stall
    return {
        "joints": [
            {
                "joint": joint.name,
                "lowest_rad": goals[:, index].min(),
                "highest_rad": goals[:, index].max(),
                "fastest_rad_s": max(turn.speed for turn in turns if turn.joint == index),
                "peak_torque_share": standing.torque[:, index].max() / stall[index],
                "mean_torque_share": standing.strain[:, index].max() / stall[index],
            }
            for index, joint in enumerate(lamp.joints)
        ],
        "balance_margin_m": standing.margin.min(),
        "balance_margin_at_s": standing.time[standing.margin.argmin()],
        "gap_m": standing.gap.min(),
        "gap_of": list(standing.links),
    }


def _told(gesture: Gesture, standing: Standing, lamp: Lamp) -> str:
    found = _measured(gesture, standing, lamp)
    lines = [f"{gesture.name}: the lamp can play it, {gesture.duration:.1f} s"]
    for row, joint in zip(found["joints"], lamp.joints, strict=True):
        limits = f"(limits {joint.lower:+.2f} to {joint.upper:+.2f})"
        lines.append(
            f"  {joint.name:<8} {row['lowest_rad']:+.2f} to {row['highest_rad']:+.2f} rad {limits}, at most "
            f"{row['fastest_rad_s']:.1f} of {joint.slew:g} rad/s, {row['peak_torque_share']:.0%} of the stall torque "
            f"(mean over 2 s: {row['mean_torque_share']:.0%})"
        )
    margin, at = found["balance_margin_m"] * 1e3, found["balance_margin_at_s"]
    lines.append(f"  balance  the floor pushes {margin:.0f} mm or more inside the foot's rim, the least at {at:.2f} s")
    lines.append(f"  links    {' and '.join(standing.links)} stay {found['gap_m'] * 1e3:.0f} mm apart")
    return "\n".join(lines)
