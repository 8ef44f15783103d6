"""Several servos as arrays in SI units: their whole state in one transaction, their goals in one sync write."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.block import LENGTHS, data_address, map_block, places_in_block
from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.registers import COUNTS_PER_TURN, FULL_PWM, RAD_PER_COUNT, WATCHDOG_UNIT, Model, Name, Register
from robolamp.dynamixel.status import Status
from robolamp.errors import BusError, SafetyError

STATE = (124, 23)
"""Address and length of Present PWM ... Present Temperature, the same in every model."""

CONDITION = (64, 7)
"""Address and length of Torque Enable ... Hardware Error Status, the same in every model."""

_ALIKE = {  # counts that two readings of one servo, a few ms apart and at rest, may differ by
    Name.PRESENT_POSITION: 64,
    Name.PRESENT_INPUT_VOLTAGE: 5,
    Name.PRESENT_TEMPERATURE: 2,
    Name.TORQUE_ENABLE: 0,
    Name.HARDWARE_ERROR_STATUS: 0,
}

TORQUE_OFF_ATTEMPTS = 3
"""How often each servo is told to turn its torque off, on top of the bus's own attempts."""


class Transport(StrEnum):
    """How a reading is made."""

    FAST = "fast sync read of the health block"
    BLOCK = "sync read of the health block"
    DIRECT = "two sync reads"


def tick_wire_time(n: int, baud: int) -> float:
    """Return how long a tick's packets are on the line at most [s]: two sync reads and a sync write, without pauses.

    With the health block a tick takes less; a servo that has lost its block is read like this again.

    Instruction packets have 10 bytes around their parameters, status packets 11 around their data
    (https://emanual.robotis.com/docs/en/dxl/protocol2/, "Instruction Packet", "Sync Read", "Sync Write"); a byte is 10
    bits on the line (8 data, start, stop). Bytes stuffed are not counted.

    Args:
        n: How many servos.
        baud: Of the line [1/s].
    """
    reads = sum(10 + 4 + n + n * (11 + length) for _, length in (STATE, CONDITION))
    return reads * 10.0 / baud + goals_wire_time(n, baud)


def goals_wire_time(n: int, baud: int) -> float:
    """Return how long the sync write of goals is on the line [s]; servos take their goals when it has ended.

    Args:
        n: How many servos it is for.
        baud: Of the line [1/s].
    """
    return (10 + 4 + n * (1 + 4)) * 10.0 / baud  # Goal Position(116) has 4 bytes; as in `tick_wire_time`


def request_wire_time(n: int, baud: int) -> float:
    """Return how long a tick's first question is on the line [s]: when it ends, the servos look at their encoders.

    Args:
        n: How many servos it asks.
        baud: Of the line [1/s].
    """
    return (10 + 4 + n) * 10.0 / baud  # a Sync Read, as in `tick_wire_time`


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
        error: ERR byte of its answer, or -1: bit 7 is the hardware alert.
        asked_again: Whether it answered only when asked a second time.
        goal_lost: Whether its torque is on and its Goal Position is not what was sent last; only the health block
            tells.
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    current: NDArray[np.float64]
    pwm: NDArray[np.float64]
    voltage: NDArray[np.float64]
    temperature: NDArray[np.float64]
    torque: NDArray[np.int64]
    hardware_error: NDArray[np.int64]
    error: NDArray[np.int64]
    asked_again: NDArray[np.bool_]
    goal_lost: NDArray[np.bool_]

    @classmethod
    def unknown(cls, n: int) -> ServoState:
        """Return the state of n servos of which nothing is known."""
        gaps, flags, no = np.full((6, n), np.nan), np.full((3, n), -1), np.zeros((2, n), np.bool_)
        return cls(*gaps, *flags, *no)


@dataclass(frozen=True)
class _Answer:
    error: int
    values: dict[Name, int]


class Servos:
    """Servos on a bus, in a fixed order.

    Args:
        bus: An open bus.
        ids: Their ids.
        models: Their models.

    Attributes:
        transport: How `read` reads; `prepare` finds a quicker way than two sync reads.
    """

    def __init__(self, bus: Bus, ids: Sequence[int], models: Sequence[Model]) -> None:
        self._bus = bus
        self._ids = tuple(ids)
        self._models = tuple(models)
        self._by_id = dict(zip(self._ids, self._models, strict=True))
        self._fields = {servo: _block_fields(model) for servo, model in self._by_id.items()}
        self._silent: set[int] = set()  # ids that did not answer last time
        self._lost: set[int] = set()  # ids whose health block is gone
        self._again: set[int] = set()  # ids that were asked twice in this reading
        self._sent: dict[int, int] = {}  # goals that the servos should have [counts], by id
        self._block = 0  # address of the health block
        self._turn = 0  # which of the lengths is next
        self.transport = Transport.DIRECT

    def prepare(self, firmware: Sequence[int]) -> Transport:
        """Map the health blocks (RAM; nothing moves) and find the quickest way to read them that gives the truth.

        A way is taken only if it says the same as the registers themselves.

        Args:
            firmware: Firmware versions, in the order of the servos.

        Returns:
            The way that `read` takes from now on, which is also in `transport`.

        Raises:
            BusError: The port is gone.
        """
        with self._bus.patient():
            self.transport, self._lost = Transport.DIRECT, set()
            self.transport = self._quickest(firmware)
        return self.transport

    def read(self) -> ServoState:
        """Read position, velocity, current, PWM, voltage, temperature, torque and hardware error of all.

        A servo that does not answer is asked once more, unless it was silent last time already: a dead servo costs the
        bus's patience once a reading, not twice.

        Raises:
            BusError: The port is gone. A servo that does not answer is a gap, not an error.
        """
        state = ServoState.unknown(len(self._ids))
        self._again = set()
        # Whoever was silent comes last: in a chain of answers it holds up nobody then.
        ids = sorted(self._ids, key=self._silent.__contains__)
        if self.transport is Transport.DIRECT:
            found = self._direct(ids)
        else:
            found = self._mapped([servo for servo in ids if servo not in self._lost])
            gone = {servo for servo, answer in found.items() if answer.values[Name.PRESENT_INPUT_VOLTAGE] == 0}
            self._lost |= gone  # a servo that answers has a supply: it rebooted, and its block reads 0 throughout
            if self._lost:
                found = {i: answer for i, answer in found.items() if i not in gone}
                found |= self._direct([servo for servo in ids if servo in self._lost])
        self._silent = set(self._ids) - set(found)
        columns = (
            (state.position, Name.PRESENT_POSITION),
            (state.velocity, Name.PRESENT_VELOCITY),
            (state.current, Name.PRESENT_CURRENT),
            (state.pwm, Name.PRESENT_PWM),
            (state.voltage, Name.PRESENT_INPUT_VOLTAGE),
            (state.temperature, Name.PRESENT_TEMPERATURE),
            (state.torque, Name.TORQUE_ENABLE),
            (state.hardware_error, Name.HARDWARE_ERROR_STATUS),
        )
        for index, servo in enumerate(self._ids):
            if servo in found:
                state.error[index] = found[servo].error
                for column, name in columns:
                    if name in found[servo].values:
                        column[index] = found[servo].values[name] * self._by_id[servo][name].scale
                state.asked_again[index] = servo in self._again
                goal, sent = found[servo].values.get(Name.GOAL_POSITION), self._sent.get(servo)
                state.goal_lost[index] = state.torque[index] == 1 and goal != sent and None not in (goal, sent)
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
        self._sent |= counts
        self._bus.sync_write(self._models[0][Name.GOAL_POSITION], counts)

    def value(self, index: int, name: Name) -> float:
        """Return one register of one servo in SI units.

        Raises:
            BusError: It does not answer, refuses, or the port is gone.
        """
        register = self._models[index][name]
        return self._bus.read(self._ids[index], register) * register.scale

    def set(self, index: int, name: Name, value: int) -> None:
        """Write one register of one servo, in counts.

        Raises:
            BusError: It does not answer, refuses, or the port is gone.
        """
        self._bus.write(self._ids[index], self._models[index][name], value)

    def torque_on(self, p_gain: Sequence[int], watchdog: float, duty: float = 1.0) -> None:
        """Turn torque on: profile off, P gain set, goal := present, then torque, checked, each with its Bus Watchdog.

        A watchdog left tripped by an earlier run is cleared first: while it is tripped, goals are refused.

        Args:
            p_gain: Position P Gain(84) of each servo, as written.
            watchdog: Silence on the bus after which each servo stops by itself [s]; 0: never.
            duty: Goal PWM(100) of each, 0 to 1: the most of the supply that its motor gets.

        Raises:
            BusError: A servo does not answer, refuses, or stays without torque.
        """
        settings = (Name.BUS_WATCHDOG, Name.PROFILE_ACCELERATION, Name.PROFILE_VELOCITY)
        for servo, model, gain in zip(self._ids, self._models, p_gain, strict=True):
            for name in settings:
                self._bus.write(servo, model[name], 0)
            self._bus.write(servo, model[Name.POSITION_P_GAIN], gain)
            self._bus.write(servo, model[Name.GOAL_PWM], round(duty * FULL_PWM))
        for servo, model in zip(self._ids, self._models, strict=True):
            present = self._bus.read(servo, model[Name.PRESENT_POSITION])
            self._bus.write(servo, model[Name.GOAL_POSITION], present)
            self._sent[servo] = present
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

        Where one does not confirm it, all on the line are told at once: it may have lost its id.

        Returns:
            Indices of the servos that did not confirm it: they may still be on.
        """
        left = tuple(index for index in range(len(self._ids)) if not self._off(index))
        if left:
            with contextlib.suppress(BusError):
                for _ in range(TORQUE_OFF_ATTEMPTS):
                    self._bus.write_all(self._models[left[0]][Name.TORQUE_ENABLE], 0)
        return left

    def hardware_errors(self) -> tuple[int, ...]:
        """Return Hardware Error Status(70) of each servo; -1 where it does not answer."""
        found: list[int] = []
        for servo, model in zip(self._ids, self._models, strict=True):
            try:
                found.append(self._bus.read(servo, model[Name.HARDWARE_ERROR_STATUS]))
            except BusError:
                found.append(-1)
        return tuple(found)

    def watchdog_tripped(self) -> tuple[int, ...]:
        """Return the indices of the servos whose Bus Watchdog has tripped (-1): they ignore goals.

        Raises:
            BusError: A servo does not answer, or the port is gone.
        """
        pairs = enumerate(zip(self._ids, self._models, strict=True))
        return tuple(i for i, (servo, model) in pairs if self._bus.read(servo, model[Name.BUS_WATCHDOG]) < 0)

    def _quickest(self, firmware: Sequence[int]) -> Transport:
        """Map the health blocks and return the quickest way of reading that says what the registers say."""
        blocks = {data_address(model, version) for model, version in zip(self._models, firmware, strict=True)}
        if len(blocks) != 1:
            return Transport.DIRECT
        self._block = blocks.pop()
        measured = self._direct(self._ids)
        try:
            for servo, model in self._by_id.items():
                map_block(self._bus, servo, model)
        except BusError:
            return Transport.DIRECT
        fast = all(version >= model.fast_sync_read for model, version in zip(self._models, firmware, strict=True))
        for way in [Transport.FAST] * 2 * fast + [Transport.BLOCK] * 2:  # each twice: one failure may be noise
            found = self._block_read(self._ids, way is Transport.FAST)
            if all(i in found and i in measured and _alike(found[i], measured[i]) for i in self._ids):
                return way
        return Transport.DIRECT

    def _mapped(self, ids: Sequence[int]) -> dict[int, _Answer]:
        """Read health blocks; those that are missing once more, each servo in its own packet."""
        fast = self.transport is Transport.FAST
        found = self._block_read(ids, fast)
        again = [servo for servo in ids if servo not in found and servo not in self._silent]
        late = self._block_read(again, False)
        self._again |= set(again[:1] if fast else again) & set(late)  # one that fails takes those behind it along
        return found | late

    def _block_read(self, ids: Sequence[int], fast: bool) -> dict[int, _Answer]:
        if not ids:
            return {}
        self._turn += 1
        length = LENGTHS[self._turn % len(LENGTHS)]
        read = self._bus.fast_sync_read if fast else self._bus.sync_read
        found: dict[int, _Answer] = {}
        for servo, status in read(ids, self._block, length).items():
            values = {row.name: _field(status, row, at, size) for row, at, size in self._fields[servo]}
            found[servo] = _Answer(status.error, values)
        return found

    def _direct(self, ids: Sequence[int]) -> dict[int, _Answer]:
        """Read the registers themselves, in two sync reads."""
        self._turn += 1
        longer = self._turn % 2 == 0  # by one byte, as the lengths of the block
        measured = self._sync_read(ids, STATE[0], STATE[1] + longer)
        condition = self._sync_read([servo for servo in ids if servo in measured], *CONDITION)
        found: dict[int, _Answer] = {}
        for servo, status in measured.items():
            answer = _Answer(status.error, {})
            for row, _, _ in self._fields[servo]:
                for start, length, source in ((*STATE, status), (*CONDITION, condition.get(servo))):
                    if source and start <= row.address < start + length:
                        answer.values[row.name] = _field(source, row, row.address - start, row.size)
            found[servo] = answer
        return found

    def _sync_read(self, ids: Sequence[int], address: int, length: int) -> dict[int, Status]:
        if not ids:
            return {}
        found = self._bus.sync_read(ids, address, length)
        again = [servo for servo in ids if servo not in found and servo not in self._silent]
        late = self._bus.sync_read(again, address, length) if again else {}
        self._again |= set(late)
        return found | late

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


def _field(status: Status, register: Register, start: int, size: int) -> int:
    return int.from_bytes(status.data[start : start + size], "little", signed=register.signed)


def _block_fields(model: Model) -> list[tuple[Register, int, int]]:
    """Return what is read of a health block, each with its first byte and size; what the model lacks is left out."""
    places = [(model[name], *place) for name, place in places_in_block().items() if name in model.registers]
    return [(row, at, size) for row, at, size in places if at + size <= LENGTHS[0]]


def _alike(block: _Answer, direct: _Answer) -> bool:
    """Whether a health block says the same as the registers themselves."""
    return all(
        name in direct.values and abs(block.values[name] - direct.values[name]) <= most for name, most in _ALIKE.items()
    )
