"""A servo that turns a plain motor, in a time that the test lets pass."""

from __future__ import annotations

import math
from pathlib import Path

from robolamp.dynamixel.registers import MODELS, Name
from robolamp.emulator.line.line import Line
from robolamp.emulator.servo.bare_motor import Motor
from robolamp.emulator.servo.servo import Sensed, Servo

from .parts import Status, read, write

STEP = 0.001
COUNT = 2 * math.pi / 4096
VELOCITY = 0.229 * 2 * math.pi / 60


class MotorBench:
    """One servo, id 1, on a motor; `supply` [V] and `air` [degC] may be changed."""

    def __init__(
        self,
        model: str = "XL330-M288-T",
        *,
        supply: float = 5.0,
        eeprom: dict[Name, int] | None = None,
        store: Path | None = None,
        angle: float = math.pi,
        load: float = 0.0,
    ) -> None:
        self.model = MODELS[model]
        self.motor = Motor(self.model, angle=angle, load=load)
        self.supply, self.air, self.time = supply, 25.0, 0.0
        start = {Name.BAUD_RATE: 3, Name.RETURN_DELAY_TIME: 0, **(eeprom or {})}
        self.servo = Servo(self.model, start, self.sense, own_loop=True, store=store)
        self.line = Line([self.servo], 1_000_000, lambda _: None)

    def sense(self, _: float) -> Sensed:
        return self.motor.sensed(self.supply, self.air)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.servo.poll(self.time)
            drive = self.servo.drive()
            self.motor.step(STEP, (drive.duty or 0.0) * self.supply if drive.torque else None)
            self.time += STEP

    def ask(self, data: bytes) -> Status:
        (reply,) = self.line.feed(data, self.time)
        return Status.of(reply.data)

    def get(self, name: Name) -> int:
        register = self.model[name]
        answer = self.ask(read(1, register.address, register.size))
        return int.from_bytes(answer.data, "little", signed=register.signed)

    def put(self, name: Name, value: int) -> int:
        """Write a register and return the ERR byte."""
        register = self.model[name]
        return self.ask(write(1, register.address, value, register.size)).error

    def set(self, **values: int) -> None:
        """Write registers by name, as `torque_enable=1`; each must be granted."""
        for key, value in values.items():
            name = Name[key.upper()]
            assert self.put(name, value) == 0, name
