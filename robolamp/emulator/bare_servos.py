"""Servos without a lamp: each turns a motor of its own, with a load or a pendulum on its shaft."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from robolamp.dynamixel.registers import BAUD_CODES, MODELS, RETURN_DELAY_UNIT, Name
from robolamp.emulator.bare_servos_file import BareServo
from robolamp.emulator.faults.injector import Injector
from robolamp.emulator.faults.script import Faults
from robolamp.emulator.faults.strike import strike
from robolamp.emulator.line.line import GAP, Line, Reply
from robolamp.emulator.plant.pendulum import Pendulum, bent
from robolamp.emulator.reality.reality import Reality
from robolamp.emulator.servo.bare_motor import Motor
from robolamp.emulator.servo.drive import Sensed
from robolamp.emulator.servo.servo import WAKING, Servo
from robolamp.twin.actuators.motors import LEAST_VOLTAGE

TIMESTEP = 0.001
"""Physics step [s]."""

ROOM = 25.0
"""Temperature around the servos [degC]."""


class BareServos:
    """Servos that answer bytes, in a time that is given to them.

    Args:
        descriptions: The servos.
        gap: Silence inside a packet that ends it [s].
        faults: What goes wrong; None: nothing.
        factory: The servos are new (id 1, 57,600 baud, Return Delay Time 250) and only the first is plugged in.
        store: Folder that keeps each servo's EEPROM, as servo-1.toml for the first; None: it is not kept.
        reality: How pendulums, the line and the supply differ from what the descriptions say; None: not at all.

    Attributes:
        servos: The servos, in the order of the descriptions.
        motors: What they turn.
        line: What connects them.
        injector: What lets things go wrong.
    """

    def __init__(
        self,
        descriptions: Sequence[BareServo],
        *,
        gap: float = GAP,
        faults: Faults | None = None,
        factory: bool = False,
        store: Path | None = None,
        reality: Reality | None = None,
    ) -> None:
        self._steps = 0
        self._reality = reality or Reality(name="none")
        self._supply = [servo.voltage + self._reality.supply for servo in descriptions]
        self._room = ROOM if reality is None else reality.temperature
        self.motors = [self._motor(servo) for servo in descriptions]
        self.injector = Injector(
            faults or Faults("none"),
            [servo.id for servo in descriptions],
            lambda index, event, time: strike(self.servos[index], event, time),
        )
        self.servos = tuple(
            Servo(
                MODELS[servo.model],
                {} if factory else _eeprom(servo),
                self._senses(index),
                own_loop=servo.pendulum is None,
                store=store / f"servo-{index + 1}.toml" if store else None,
                woke=index * WAKING,
            )
            for index, servo in enumerate(descriptions)
        )
        self.line = Line(self.servos, descriptions[0].baud, self.advance_to, self._latency(), gap, self.injector)
        if factory:
            self.line.unplugged = set(range(1, len(self.servos)))

    @property
    def time(self) -> float:
        """Simulated time, 0 at the start [s]."""
        return self._steps * TIMESTEP

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        return TIMESTEP

    def advance_to(self, time: float) -> None:
        """Let the motors turn up to a time; where they have been there already, nothing happens.

        Args:
            time: In simulated time [s].
        """
        while self.time + TIMESTEP <= time:
            self._step()
        self.injector.poll(time)

    def receive(self, data: bytes, time: float) -> list[Reply]:
        """Take bytes from the client and return the servos' answers.

        Args:
            data: What the client sends.
            time: When [s].
        """
        return self.line.feed(data, time)

    def frames(self, time: float) -> bytes:
        """Return nothing: there is no foot sensor."""
        return b""

    def _step(self) -> None:
        self.injector.poll(self.time)
        for index, (servo, motor) in enumerate(zip(self.servos, self.motors, strict=True)):
            servo.poll(self.time)
            drive, volts = servo.drive(), self._volts(index)
            if isinstance(motor, Pendulum):
                motor.step(drive, volts, self._room + servo.heat, (servo.written - self.time) / TIMESTEP)
                continue
            voltage = drive.duty * volts if drive.torque and drive.duty is not None else None
            motor.step(TIMESTEP, voltage)
        self._steps += 1

    def _motor(self, servo: BareServo) -> Motor | Pendulum:
        if servo.pendulum is None:
            return Motor(MODELS[servo.model], angle=servo.position, load=servo.load)
        pendulum, differs = servo.pendulum, self._reality
        values = bent(pendulum.values, differs)
        noise = float(np.atleast_1d(differs.encoder_noise)[0])
        return Pendulum(values, pendulum.load, TIMESTEP, zero=servo.position, noise=noise, seed=differs.seed)

    def _latency(self) -> Callable[[], float] | None:
        fixed, jitter = self._reality.latency, self._reality.jitter
        if not fixed and not jitter:
            return None
        random = np.random.default_rng([self._reality.seed, 1])
        return lambda: fixed + (float(random.exponential(jitter)) if jitter else 0.0)

    def _volts(self, index: int) -> float:
        motor, supply = self.motors[index], self._supply[index] - self._reality.drain * self.time
        drop = self._reality.resistance * abs(motor.current) if isinstance(motor, Pendulum) else 0.0
        return max(supply - self.injector.sag() - drop, LEAST_VOLTAGE)

    def _senses(self, index: int) -> Callable[[float], Sensed]:
        motor = self.motors[index]
        if isinstance(motor, Pendulum):
            return lambda time: motor.sensed(time, self._volts(index), self._room)
        return lambda _: motor.sensed(self._volts(index), self._room)


def _eeprom(servo: BareServo) -> dict[Name, int]:
    return {
        Name.ID: servo.id,
        Name.BAUD_RATE: BAUD_CODES[servo.baud],
        Name.RETURN_DELAY_TIME: round(servo.return_delay / RETURN_DELAY_UNIT),
    }
