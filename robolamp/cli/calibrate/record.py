"""`robolamp calibrate record`: the recordings that a calibration of a lamp, or of one servo, is fitted to."""

from __future__ import annotations

import contextlib
import datetime
import math
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from robolamp.cli.options import Setup, length
from robolamp.cli.screen.output import counted, print_json
from robolamp.errors import RobolampError

if TYPE_CHECKING:
    from robolamp.calibrate.procedure import Step
    from robolamp.calibrate.recorder import Connect, Person, StepConnection
    from robolamp.calibrate.servo.procedure import ServoBench
    from robolamp.lamp import Lamp
    from robolamp.runtime.result import RunResult
    from robolamp.runtime.stop import StopRequest

_LEAST_GRAMS, _MOST_GRAMS = 50, 5000  # what a desk lamp on hobby servos may weigh


def record(
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    port: str | None = None,
    foot_port: str | None = None,
    emulate: Annotated[bool, Parameter(negative="")] = False,
    reality: str | None = None,
    servo: Path | None = None,
    fix: Annotated[bool, Parameter(negative="")] = False,
    step: Annotated[tuple[str, ...], Parameter(negative="", consume_multiple=False, show_default=False)] = (),
    unattended: Annotated[bool, Parameter(negative="")] = False,
    by: str = "",
    calibration: str = "nominal",
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Record a lamp for its calibration: the joints swing, drop and hop, one log a step. Or one servo on a bench.

    It says what to do with your hands before each step (clamp the base, stand the lamp up) and waits for Enter. Stop
    it at any time (Ctrl-C lands the lamp softly; at a prompt, q or Ctrl-C ends with exit code 130, torque is off there)
    and start it again with the same folder: it goes on where it stopped. Some 20 minutes for the whole lamp, 3 for one
    servo. With --emulate there is no lamp and no waiting.

    Args:
        output: Folder for the recordings and their manifest.
        port: Serial port of the servos; by default bus.port of hardware/lamp.toml.
        foot_port: Serial port of the foot sensor; by default foot.port of hardware/lamp.toml.
        emulate: Record an emulated lamp, in virtual time.
        reality: With --emulate, a reality, which says how that lamp differs from its twin: none, a file, or the name
            of one (worn); random:SEED: everything differs; knob:KIND:SEED: one number does, as knob:backlash:7. By
            default worn for a lamp, none for a servo.
        servo: Record one servo that turns a pendulum instead of a lamp: a file as `robolamp emulate --servos` takes,
            with one servo and its [servo.pendulum] (calibration/README.md has one).
        fix: Mend wrong servo settings (EEPROM), such as a new servo's Return Delay Time.
        step: Only this step; may be given several times. All steps: see calibration/README.md.
        unattended: Do not wait for Enter: for a lamp that stays clamped. Steps that need hands are left out.
        by: Your name, for the manifest.
        calibration: The calibration that the logs name: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object. Needs --emulate or --unattended, because it cannot wait for Enter.
    """
    if emulate and (port or foot_port):
        raise RobolampError("is of no use together with --emulate", "--port" if port else "--foot-port")
    if as_json and not (emulate or unattended):
        raise RobolampError("cannot wait for Enter; expected --emulate or --unattended with it", "--json")
    if servo is not None and foot_port:
        raise RobolampError("is of no use together with --servo: a bench has no foot sensor", "--foot-port")
    if reality is not None and not emulate:
        raise RobolampError("is of no use without --emulate", "--reality")
    if servo is not None and not emulate and not port:
        raise RobolampError("is missing; expected the servo's serial port, or --emulate", "--port")
    setup = Setup.of(lamp, calibration)

    from robolamp.calibrate.manifest import load_manifest
    from robolamp.calibrate.procedure import procedure
    from robolamp.calibrate.recorder import Session
    from robolamp.calibrate.recorder import record as record_all
    from robolamp.calibrate.servo.procedure import bench_procedure, load_bench
    from robolamp.cli.run.outcome import Failure, concluded, noted
    from robolamp.cli.screen.prompt import STOPPED
    from robolamp.runtime.stop import StopRequest

    bench = None if servo is None else load_bench(servo, setup.assets, port or "")
    described = setup.lamp if bench is None else bench.lamp
    steps = procedure(setup.lamp) if bench is None else bench_procedure(bench)
    known = [one.name for one in steps]
    for name in step:
        if name not in known:
            raise RobolampError(f"{name!r} is not a step; expected one of {', '.join(known)}", "--step")
    chosen = [one for one in steps if (not step or one.name in step) and (emulate or not unattended or one.clamped)]
    say = (lambda text: None) if as_json else print
    bent = reality or ("worn" if bench is None else "none")
    source = f"emulator {bent}" if emulate else "lamp"
    if not emulate:
        connect = _physical(described, port, foot_port, foot=bench is None)
    else:
        connect = emulated(setup, bent) if bench is None else emulated_servo(setup, bench, bent)
    runs: list[dict[str, Any]] = []
    failures: list[Failure] = []
    with StopRequest() as stop:
        session = Session(
            described, setup.calibration, setup.assets, output, source, by, datetime.date.today().isoformat(), stop,
            servo=bench.servo.model if bench else "", fix=fix,
        )  # fmt: skip
        person = None if emulate or unattended else _person(stop)
        try:
            record_all(session, chosen, connect, person=person, say=say, told=telling(runs, say))
        except KeyboardInterrupt:
            print(
                "robolamp: stopped, torque is off; the same command goes on where it stopped",
                file=sys.stderr,
                flush=True,
            )
            return STOPPED
        except RobolampError as error:
            if not runs:
                raise
            failures.append(Failure(error.message, error.where))
    manifest = load_manifest(output)
    entries = manifest.entries if manifest else ()
    left = [one.name for one in steps if one.name not in {entry.step for entry in entries}]
    if as_json:
        recordings = [
            {"step": entry.step, "file": entry.file, "clamped": entry.clamped, "travel_m": entry.travel}
            for entry in entries
        ]
        print_json({"folder": output, "recordings": recordings, "left": left, "runs": runs, **noted(failures)})
    else:
        own = ["--lamp", str(lamp)] if lamp is not None and bench is None else []
        again = shlex.join(
            ["robolamp", "calibrate", "lamp" if bench is None else "fit", str(output), *own, "-o", "FILE"]
        )
        rest = f"; left: {', '.join(left)}" if left else f"; next: {again}"
        print(f"{counted(len(entries), 'recording')} in {output}{rest}")
    return concluded(0, failures)


def telling(runs: list[dict[str, Any]], say: Callable[[str], None]) -> Callable[[Step, RunResult], None]:
    """Return what takes note of how each run went, and says it where there is something amiss.

    Args:
        runs: Where to note it.
        say: Called with a line.
    """
    from robolamp.cli.run.outcome import account, ended

    def told(step: Step, result: RunResult) -> None:
        runs.append(
            {
                "step": step.name, "ended": result.ended, "reason": result.reason, "ticks": result.ticks,
                "missed_ticks": result.missed_ticks, "faults": result.faults,
            }
        )  # fmt: skip
        if result.ended != "finished" or result.faults or result.missed_ticks:
            say(f"  {ended(result)}. {account(result)}")

    return told


def _person(stop: StopRequest) -> Person:
    from robolamp.calibrate.recorder import Person
    from robolamp.cli.screen.prompt import STOP, answered

    if not sys.stdin.isatty():
        raise RobolampError(
            "is no terminal, so nobody can be asked to clamp the base; expected one, --unattended, or --emulate",
            "standard input",
        )

    def ask(prompt: str) -> str:
        try:
            return answered(lambda: input(prompt), stop)
        except EOFError:
            raise RobolampError("ended before an answer came", "standard input") from None

    def prompt(text: str) -> None:
        print(text)
        ask(f"  Enter when ready, {STOP}: ")

    def travel(text: str) -> float:
        while True:
            try:
                return length(ask(f"  {text} (as 14.5cm, {STOP}) "), "the way it went")
            except RobolampError as error:
                print(f"  {error.message}")

    def mass(text: str) -> float:
        while True:
            answer = ask(f"{text}\n  How many grams ({STOP})? ").strip().removesuffix("g").strip()
            try:
                grams = float(answer)
            except ValueError:
                grams = math.nan
            if _LEAST_GRAMS <= grams <= _MOST_GRAMS:
                return grams / 1e3
            print(f"  {answer!r} is not a number from {_LEAST_GRAMS} to {_MOST_GRAMS} (grams)")

    return Person(prompt, travel, mass)


def _physical(lamp: Lamp, port: str | None, foot_port: str | None, *, foot: bool) -> Connect:
    from robolamp.calibrate.recorder import StepConnection
    from robolamp.runtime.clock import MonotonicClock

    servo, sensor = port or lamp.bus_port, (foot_port or lamp.foot_port) if foot else None

    @contextlib.contextmanager
    def connect(step: Step) -> Iterator[StepConnection]:
        yield StepConnection.real(servo, sensor, MonotonicClock())

    return connect


def emulated(setup: Setup, reality: str) -> Connect:
    """Return what gives an emulated lamp, in lockstep, clamped where a step wants it.

    Args:
        setup: The lamp, and its twin's calibration.
        reality: How it differs from that twin: a file, the name of one, or "none".

    Raises:
        FileError: There is no such reality, or it is malformed.
    """
    import time

    from robolamp.calibrate.recorder import StepConnection
    from robolamp.emulator.emulated_lamp import EmulatedLamp
    from robolamp.emulator.ports.lockstep import Lockstep
    from robolamp.emulator.reality.file import load_reality

    bent = load_reality(reality, setup.lamp, setup.assets)

    @contextlib.contextmanager
    def connect(step: Step) -> Iterator[StepConnection]:
        world = EmulatedLamp(setup.lamp, setup.calibration, setup.assets, bent, clamped=step.clamped)
        start = world.plant.truth().base_x
        ports = Lockstep(world, setup.lamp.bus_baud)
        yield StepConnection(
            ports.servo_port, ports.foot_port, ports.clock, time.time_ns(),
            travelled=lambda: world.plant.truth().base_x - start, mass=round(world.plant.mass, 3),
        )  # fmt: skip

    return connect


def emulated_servo(setup: Setup, bench: ServoBench, reality: str) -> Connect:
    """Return what gives an emulated servo with its pendulum, in lockstep.

    Args:
        setup: Where realities are.
        bench: The servo.
        reality: How it differs from what its file says: a file, "none", or "random:SEED".

    Raises:
        FileError: There is no such reality, or it is malformed.
    """
    import dataclasses
    import time

    from robolamp.calibrate.recorder import StepConnection
    from robolamp.emulator.bare_servos import BareServos
    from robolamp.emulator.ports.lockstep import Lockstep
    from robolamp.emulator.reality.file import load_reality

    bent = load_reality(reality, bench.lamp, setup.assets)
    servo = dataclasses.replace(bench.servo, return_delay=0.0)  # as `robolamp setup` leaves it

    @contextlib.contextmanager
    def connect(step: Step) -> Iterator[StepConnection]:
        ports = Lockstep(BareServos([servo], reality=bent), bench.lamp.bus_baud)
        yield StepConnection(ports.servo_port, None, ports.clock, time.time_ns())

    return connect
