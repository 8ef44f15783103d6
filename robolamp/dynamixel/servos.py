"""Several servos as arrays in SI units: their state in two sync reads, their goals in one sync write."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.bus import Bus, Status
from robolamp.dynamixel.registers import COUNTS_PER_TURN, RAD_PER_COUNT, WATCHDOG_UNIT, Model, Name, Register
from robolamp.errors import BusError, SafetyError

STATE = (124, 23)
"""Address and length of Present PWM ... Present Temperature, the same in every model."""

CONDITION = (64, 7)
"""Address and length of Torque Enable ... Hardware Error Status, the same in every model."""

TORQUE_OFF_ATTEMPTS = 3
"""How often each servo is told to turn its torque off, on top of the bus's own attempts."""


def tick_wire_time(n: int, baud: int) -> float:
    """Return how long a tick's packets are on the line [s]: two sync reads and a sync write, without any pauses.

    Instruction packets have 10 bytes around their parameters, status packets 11 around their data
    (https://emanual.robotis.com/docs/en/dxl/protocol2/, "Instruction Packet", "Sync Read", "Sync Write"); a byte is 10
    bits on the line (8 data, start, stop). Bytes stuffed are not counted.

    Args:
        n: How many servos.
        baud: Of the line [1/s].
    """
    reads = sum(10 + 4 + n + n * (11 + length) for _, length in (STATE, CONDITION))
    write = 10 + 4 + n * (1 + 4)  # Goal Position(116) has 4 bytes
    return (reads + write) * 10.0 / baud


@dataclass
class ServoState:
    """What the servos measured, in servo terms, shape (n,) each; a servo that did not answer has NaN and -1.

    Attributes:
        position: Servo angle, 0 to 2 pi over its turn [rad].
        velocity: [rad/s].
        current: [A]; NaN for a model that does not measure it.
        pwm: Duty, -1 to 1.
        voltage: [V].
        temperature: [degC].
        torque: Torque Enable: 1, 0, or -1 unknown.
        hardware_error: Hardware Error Status bits, or -1 unknown.
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    current: NDArray[np.float64]
    pwm: NDArray[np.float64]
    voltage: NDArray[np.float64]
    temperature: NDArray[np.float64]
    torque: NDArray[np.int64]
    hardware_error: NDArray[np.int64]

    @classmethod
    def unknown(cls, n: int) -> ServoState:
        """Return the state of n servos of which nothing is known."""
        gap, flag = np.full(n, np.nan), np.full(n, -1)
        return cls(gap, gap.copy(), gap.copy(), gap.copy(), gap.copy(), gap.copy(), flag, flag.copy())


class Servos:
    """Servos on a bus, in a fixed order.

    Args:
        bus: An open bus.
        ids: Their ids.
        models: Their models.
    """

    def __init__(self, bus: Bus, ids: Sequence[int], models: Sequence[Model]) -> None:
        self._bus = bus
        self._ids = tuple(ids)
        self._models = tuple(models)
        self._silent: set[int] = set()  # ids that did not answer last time

    def read(self) -> ServoState:
        """Read position, velocity, current, PWM, voltage, temperature, torque and hardware error of all.

        A servo that does not answer is asked once more, unless it was silent last time already: a dead servo costs the
        bus's patience once a reading, not twice.

        Raises:
            BusError: The port is gone. A servo that does not answer is a gap, not an error.
        """
        state = ServoState.unknown(len(self._ids))
        measured = self._sync_read(self._ids, STATE)
        condition = self._sync_read([servo for servo in self._ids if servo in measured], CONDITION)
        self._silent = set(self._ids) - set(measured)
        columns = (
            (state.position, Name.PRESENT_POSITION),
            (state.velocity, Name.PRESENT_VELOCITY),
            (state.current, Name.PRESENT_CURRENT),
            (state.pwm, Name.PRESENT_PWM),
            (state.voltage, Name.PRESENT_INPUT_VOLTAGE),
            (state.temperature, Name.PRESENT_TEMPERATURE),
        )
        for index, (servo, model) in enumerate(zip(self._ids, self._models, strict=True)):
            if servo in measured:
                for column, name in columns:
                    register = model.registers.get(name)
                    if register is not None:
                        column[index] = _field(measured[servo], register, STATE[0]) * register.scale
            if servo in condition:
                state.torque[index] = _field(condition[servo], model[Name.TORQUE_ENABLE], CONDITION[0])
                state.hardware_error[index] = _field(condition[servo], model[Name.HARDWARE_ERROR_STATUS], CONDITION[0])
        return state

    def write_goals(self, angle: NDArray[np.float64]) -> None:
        """Send goal positions.

        Args:
            angle: Servo angles, shape (n,) [rad], inside one turn.

        Raises:
            SafetyError: An angle is not finite or outside the turn that position mode has; nothing was sent.
            BusError: The port is gone.
        """
        counts: dict[int, int] = {}
        for servo, value in zip(self._ids, angle, strict=True):
            count = round(float(value) / RAD_PER_COUNT) if math.isfinite(value) else -1
            if not 0 <= count < COUNTS_PER_TURN:
                raise SafetyError(
                    f"goal {float(value):g} rad of {self._bus.label(servo)} is not inside its turn (0 to 6.282 rad)",
                    self._bus.name,
                )
            counts[servo] = count
        self._bus.sync_write(self._models[0][Name.GOAL_POSITION], counts)

    def value(self, index: int, name: Name) -> float:
        """Return one register of one servo in SI units.

        Raises:
            BusError: It does not answer, refuses, or the port is gone.
        """
        register = self._models[index][name]
        return self._bus.read(self._ids[index], register) * register.scale

    def torque_on(self, p_gain: Sequence[int], watchdog: float) -> None:
        """Turn torque on: profile off, P gain set, goal := present, then torque, checked, each with its Bus Watchdog.

        A watchdog left tripped by an earlier run is cleared first: while it is tripped, goals are refused.

        Args:
            p_gain: Position P Gain(84) of each servo, as written.
            watchdog: Silence on the bus after which each servo stops by itself [s]; 0: never.

        Raises:
            BusError: A servo does not answer, refuses, or stays without torque.
        """
        settings = (Name.BUS_WATCHDOG, Name.PROFILE_ACCELERATION, Name.PROFILE_VELOCITY)
        for servo, model, gain in zip(self._ids, self._models, p_gain, strict=True):
            for name in settings:
                self._bus.write(servo, model[name], 0)
            self._bus.write(servo, model[Name.POSITION_P_GAIN], gain)
        for servo, model in zip(self._ids, self._models, strict=True):
            present = self._bus.read(servo, model[Name.PRESENT_POSITION])
            self._bus.write(servo, model[Name.GOAL_POSITION], present)
            self._bus.write(servo, model[Name.TORQUE_ENABLE], 1)
            if self._bus.read(servo, model[Name.TORQUE_ENABLE]) != 1:
                raise BusError(
                    f"{self._bus.label(servo)} took Torque Enable 1 and stays without torque; "
                    "power it off and on, and check its supply",
                    self._bus.name,
                )
            self._bus.write(servo, model[Name.BUS_WATCHDOG], round(watchdog / WATCHDOG_UNIT))

    def torque_off(self) -> tuple[int, ...]:
        """Turn each servo's torque off on its own, then its watchdog; never raises.

        Returns:
            Indices of the servos that did not confirm it: they may still be on.
        """
        return tuple(index for index in range(len(self._ids)) if not self._off(index))

    def watchdog_tripped(self) -> tuple[int, ...]:
        """Return the indices of the servos whose Bus Watchdog has tripped (-1): they ignore goals.

        Raises:
            BusError: A servo does not answer, or the port is gone.
        """
        pairs = enumerate(zip(self._ids, self._models, strict=True))
        return tuple(i for i, (servo, model) in pairs if self._bus.read(servo, model[Name.BUS_WATCHDOG]) < 0)

    def _sync_read(self, ids: Sequence[int], block: tuple[int, int]) -> dict[int, Status]:
        if not ids:
            return {}
        found = self._bus.sync_read(ids, *block)
        again = [servo for servo in ids if servo not in found and servo not in self._silent]
        return found | self._bus.sync_read(again, *block) if again else found

    def _off(self, index: int) -> bool:
        servo, model = self._ids[index], self._models[index]
        for _ in range(TORQUE_OFF_ATTEMPTS):
            try:
                self._bus.write(servo, model[Name.TORQUE_ENABLE], 0)
                self._bus.write(servo, model[Name.BUS_WATCHDOG], 0)
            except BusError:
                continue
            return True
        return False


def _field(status: Status, register: Register, base: int) -> int:
    start = register.address - base
    return int.from_bytes(status.data[start : start + register.size], "little", signed=register.signed)
