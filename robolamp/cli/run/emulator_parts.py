"""What `robolamp emulate` builds: a lamp or bare servos, their faults, and the lines it prints about them."""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any, TextIO

from robolamp.assets import Assets
from robolamp.calibration import Calibration, load_calibration
from robolamp.dynamixel.registers import BAUD_CODES, MODELS, Model, Name
from robolamp.emulator.bare_servos import BareServos
from robolamp.emulator.bare_servos_file import load_servos
from robolamp.emulator.faults.injector import Injection
from robolamp.emulator.faults.script import Faults, load_faults
from robolamp.emulator.ports.emulated import Emulated
from robolamp.emulator.ports.real_time import REAL_TIME_GAP
from robolamp.emulator.reality.file import Reality, load_reality
from robolamp.emulator.servo.eeprom_file import open_folder
from robolamp.emulator.servo.servo import Servo
from robolamp.errors import FileError
from robolamp.files import open_new
from robolamp.lamp import Lamp, load_lamp

if TYPE_CHECKING:
    from robolamp.emulator.truth_log import TruthLog


@dataclass(frozen=True)
class ServoFacts:
    """What `emulate` prints about one servo.

    Attributes:
        name: The joint it drives, or its place in the servos file.
        id: Its id at the start.
        model: Its model's name.
        baud: Its rate at the start [1/s].
    """

    name: str
    id: int
    model: str
    baud: int


@dataclass(frozen=True)
class Rig:
    """What is emulated.

    Attributes:
        world: The lamp or the servos.
        servos: What is said of them.
        faults: What goes wrong.
        plant: What moves, in words.
        foot: Whether there is a foot sensor.
        lamp: The lamp with its calibration and reality; None for bare servos.
    """

    world: Emulated
    servos: tuple[ServoFacts, ...]
    faults: Faults
    plant: str
    foot: bool
    lamp: tuple[Lamp, Calibration, Reality] | None = None

    @property
    def models(self) -> list[Model]:
        """The servos' models."""
        return [MODELS[servo.model] for servo in self.servos]

    def lines(self, servo_port: str, foot_port: str | None) -> list[str]:
        """Return the lines to print when it is ready."""
        servos = ", ".join(f"{servo.name} = {servo.model} id {servo.id}" for servo in self.servos)
        bauds = sorted({servo.baud for servo in self.servos})
        rates = " and ".join(map(str, bauds))
        foot = [f"foot port   {foot_port}   a frame every 2 ms (hardware/firmware/README.md)"] if foot_port else []
        return [
            f"servo port  {servo_port}   protocol 2.0, {rates} baud: {servos}",
            *foot,
            f"plant       {self.plant}, in real time",
            *([f"faults      {self.faults.name}"] if self.faults.rates or self.faults.events else []),
            "not modelled: gaps of 1.5 ms on a pseudo-terminal, power loss and more: docs/emulator.md has the list",
            "Ctrl-C ends it.",
        ]


def lamp_rig(
    folder: Path | None, calibration: str, reality: str, faults: Path | None, factory: bool, eeprom: Path | None
) -> Rig:
    """Return an emulated lamp.

    Args:
        folder: The lamp's folder; None: the shipped one.
        calibration: File or name.
        reality: File or name.
        faults: Fault script.
        factory: Whether its servos are new.
        eeprom: Folder that keeps their EEPROM.

    Raises:
        FileError: One of them is missing or malformed.
    """
    from robolamp.emulator.emulated_lamp import EmulatedLamp  # mujoco is loaded after the arguments are checked

    assets = Assets.of(folder)
    lamp = load_lamp(assets)
    numbers = load_calibration(assets, calibration)
    bent = load_reality(reality, lamp, assets)
    script = load_faults(faults, tuple(joint.id for joint in lamp.joints)) if faults else Faults("none")
    store = open_folder(eeprom) if eeprom else None
    world = EmulatedLamp(lamp, numbers, assets, bent, gap=REAL_TIME_GAP, faults=script, factory=factory, store=store)
    servos = tuple(_facts(name, servo) for name, servo in zip(lamp.names, world.servos, strict=True))
    plant = f"{lamp.name}: calibration {numbers.name}, reality {bent.name}; standing, held"
    return Rig(world, servos, script, plant, True, (lamp, numbers, bent))


def bare_rig(file: Path, faults: Path | None, factory: bool, eeprom: Path | None) -> Rig:
    """Return emulated servos without a lamp.

    Args:
        file: The servos file.
        faults: Fault script.
        factory: Whether they are new.
        eeprom: Folder that keeps their EEPROM.

    Raises:
        FileError: One of them is missing or malformed.
    """
    listed = load_servos(file)
    script = Faults("none")
    if faults:
        script = load_faults(faults, tuple(servo.id for servo in listed.servos), foot=False)
    store = open_folder(eeprom) if eeprom else None
    world = BareServos(listed.servos, gap=REAL_TIME_GAP, faults=script, factory=factory, store=store)
    facts = tuple(_facts(f"servo {number}", servo) for number, servo in enumerate(world.servos, 1))
    return Rig(world, facts, script, f"{listed.name}: a motor for each servo, its shaft free", False)


def _facts(name: str, servo: Servo) -> ServoFacts:
    rate = servo.register(Name.BAUD_RATE)
    baud = next(baud for baud, code in BAUD_CODES.items() if code == rate)
    return ServoFacts(name, servo.id, servo.model.name, baud)


class InjectionLog:
    """Writes injections to a file as they happen, a line of JSON each; once it is open it never raises.

    Args:
        path: The file; None: nowhere.

    Attributes:
        error: Why the file ended early; empty while all is well.

    Raises:
        FileError: The file cannot be made.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.error = ""
        self._stream: TextIO | None = None
        if path is not None:
            try:
                self._stream = os.fdopen(open_new(path), "w", encoding="utf-8", buffering=1)
            except OSError as error:
                raise FileError(f"cannot be written: {error.strerror or error}", str(path)) from None

    def write(self, injection: Injection) -> None:
        """Write one."""
        if self._stream is not None and not self.error:
            try:
                self._stream.write(injection.line() + "\n")
            except OSError as error:
                self.error = error.strerror or str(error)

    def close(self) -> None:
        """Close the file."""
        if self._stream is not None:
            try:
                self._stream.close()
            except OSError as error:  # what is buffered could not be written either
                self.error = self.error or error.strerror or str(error)


def check_logs(truth: TruthLog | None, injections: InjectionLog) -> None:
    """Check that what an emulated lamp logged is whole, once it is closed.

    Raises:
        FileError: A log ended early.
    """
    if truth is not None and truth.error:
        raise FileError(f"the truth log ended early: {truth.error}", str(truth.path))
    if injections.error:
        raise FileError(f"ended early: {injections.error}", str(injections.path))


class Hand:
    """Plugs new servos in, one at a time: at SIGUSR1, or when Enter is pressed.

    As a context manager it takes over SIGUSR1 (main thread only).

    Args:
        rig: Whose servos.
        enter: Whether Enter on stdin counts.
        say: Called with a line for each servo that is plugged in.
    """

    def __init__(self, rig: Rig, *, enter: bool, say: Callable[[str], None]) -> None:
        self._rig = rig
        self._enter = enter
        self._say = say
        self._asked = 0
        self._before: Any = None

    def __enter__(self) -> Hand:
        self._before = signal.signal(signal.SIGUSR1, self._signalled)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGUSR1, self._before)

    def poll(self) -> None:
        """Plug in as many servos as Enter or SIGUSR1 asked for."""
        if self._enter and select.select([sys.stdin], [], [], 0.0)[0]:
            if os.read(sys.stdin.fileno(), 1024):
                self._asked += 1
            else:
                self._enter = False  # stdin was closed
        while self._asked:
            self._asked -= 1
            index = self._rig.world.line.plug_next()
            servos = self._rig.servos
            self._say("all servos are plugged in" if index is None else f"plugged in: {servos[index].name}")

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        self._asked += 1
