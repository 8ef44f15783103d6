"""Several servos as arrays in SI units: their whole state in one transaction, their goals in one sync write."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.health_block import LENGTHS, data_address, map_block, places_in_block
from robolamp.dynamixel.registers import COUNTS_PER_TURN, FULL_PWM, RAD_PER_COUNT, WATCHDOG_UNIT, Model, Name, Register
from robolamp.dynamixel.servo_state import COLUMNS, VOLTAGE, Answer, Layout, Scales, ServoState
from robolamp.dynamixel.status_packet import Status
from robolamp.dynamixel.wire_time import CONDITION, STATE, Transport
from robolamp.errors import BusError, SafetyError

_ALIKE = {  # counts that two readings of one servo, a few ms apart and at rest, may differ by
    Name.PRESENT_POSITION: 64,
    Name.PRESENT_INPUT_VOLTAGE: 5,
    Name.PRESENT_TEMPERATURE: 2,
    Name.TORQUE_ENABLE: 0,
    Name.HARDWARE_ERROR_STATUS: 0,
}

AT_TORQUE_ON: Mapping[Name, int] = MappingProxyType(
    {
        Name.BUS_WATCHDOG: 0,  # first: while it is tripped, goals are refused
        Name.PROFILE_ACCELERATION: 0,
        Name.PROFILE_VELOCITY: 0,
        Name.POSITION_D_GAIN: 0,
        Name.POSITION_I_GAIN: 0,
        Name.FEEDFORWARD_2ND_GAIN: 0,
        Name.FEEDFORWARD_1ST_GAIN: 0,
    }
)
"""What is written whenever torque goes on, besides P gain, Goal PWM, the goal and the Bus Watchdog: goals are followed
at once, by proportional control alone, as the twin does it."""
SETTINGS = ((10, 53), (80, 36))
"""Addresses and lengths of what changes how a servo goes to its goals, the same in every model: Drive Mode to PWM
Slope, Position D Gain to Profile Velocity."""

TORQUE_OFF_ATTEMPTS = 3
"""How often each servo is told to turn its torque off, on top of the bus's own attempts."""


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
        self._scales = Scales(models)
        self._block_layout = {servo: Layout(_block_rows(model)) for servo, model in self._by_id.items()}
        self._direct_layouts = {servo: _direct_layouts(model) for servo, model in self._by_id.items()}
        self._silent: set[int] = set()  # ids that did not answer last time
        self._lost: set[int] = set()  # ids whose health block is gone
        self._again: set[int] = set()  # ids that were asked twice in this reading
        self._sent = [math.nan] * len(self._ids)  # goals that the servos should have [counts]
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
        self._again = set()
        # Whoever was silent comes last: in a chain of answers it holds up nobody then.
        ids = sorted(self._ids, key=self._silent.__contains__)
        if self.transport is Transport.DIRECT:
            found = self._direct(ids)
        else:
            found = self._mapped([servo for servo in ids if servo not in self._lost])
            gone = {servo for servo, answer in found.items() if answer.values[VOLTAGE] == 0}
            self._lost |= gone  # a servo that answers has a supply: it rebooted, and its block reads 0 throughout
            if self._lost:
                found = {i: answer for i, answer in found.items() if i not in gone}
                found |= self._direct([servo for servo in ids if servo in self._lost])
        self._silent = set(self._ids) - set(found)
        return self._scales.state(
            [found.get(servo) for servo in self._ids],
            [servo in self._again for servo in self._ids],
            self._sent,
        )

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
        self._sent = [*counts.values()]
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

    def settings(self) -> list[dict[Name, int]]:
        """Return what each servo is set to, in counts: all registers of SETTINGS, in one sync read for each range.

        Returns:
            One mapping a servo; empty for one that does not answer, or where the port is gone.
        """
        found: list[dict[Name, int]] = [{} for _ in self._ids]
        with contextlib.suppress(BusError):
            for first, length in SETTINGS:
                answers = self._bus.sync_read(self._ids, first, length)
                for index, (servo, model) in enumerate(zip(self._ids, self._models, strict=True)):
                    if servo in answers:
                        found[index] |= _registers(model, first, answers[servo].data)
        return found

    def torque_on(self, p_gain: Sequence[int], watchdog: float, duty: float = 1.0) -> None:
        """Turn torque on: profile and other gains off, P gain set, goal := present, then torque, checked, and watchdog.

        A watchdog left tripped by an earlier run is cleared first: while it is tripped, goals are refused.

        Args:
            p_gain: Position P Gain(84) of each servo, as written.
            watchdog: Silence on the bus after which each servo stops by itself [s]; 0: never.
            duty: Goal PWM(100) of each, 0 to 1: the most of the supply that its motor gets.

        Raises:
            BusError: A servo does not answer, refuses, or stays without torque.
        """
        for servo, model, gain in zip(self._ids, self._models, p_gain, strict=True):
            for name, value in AT_TORQUE_ON.items():
                self._bus.write(servo, model[name], value)
            self._bus.write(servo, model[Name.POSITION_P_GAIN], gain)
            self._bus.write(servo, model[Name.GOAL_PWM], round(duty * FULL_PWM))
        for index, (servo, model) in enumerate(zip(self._ids, self._models, strict=True)):
            present = self._bus.read(servo, model[Name.PRESENT_POSITION])
            self._bus.write(servo, model[Name.GOAL_POSITION], present)
            self._sent[index] = present
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
        return tuple(index for index in left if not self._off_aloud(index))

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

    def _mapped(self, ids: Sequence[int]) -> dict[int, Answer]:
        """Read health blocks; those that are missing once more, each servo in its own packet."""
        fast = self.transport is Transport.FAST
        found = self._block_read(ids, fast)
        again = [servo for servo in ids if servo not in found and servo not in self._silent]
        late = self._block_read(again, False)
        self._again |= set(again[:1] if fast else again) & set(late)  # one that fails takes those behind it along
        return found | late

    def _block_read(self, ids: Sequence[int], fast: bool) -> dict[int, Answer]:
        if not ids:
            return {}
        self._turn += 1
        length = LENGTHS[self._turn % len(LENGTHS)]
        read = self._bus.fast_sync_read if fast else self._bus.sync_read
        found: dict[int, Answer] = {}
        for servo, status in read(ids, self._block, length).items():
            found[servo] = Answer(status.error, self._block_layout[servo].values(status.data))
        return found

    def _direct(self, ids: Sequence[int]) -> dict[int, Answer]:
        """Read the registers themselves, in two sync reads."""
        self._turn += 1
        longer = self._turn % 2 == 0  # by one byte, as the lengths of the block
        measured = self._sync_read(ids, STATE[0], STATE[1] + longer)
        condition = self._sync_read([servo for servo in ids if servo in measured], *CONDITION)
        found: dict[int, Answer] = {}
        for servo, status in measured.items():
            whole, alone = self._direct_layouts[servo]
            half = status.data[: STATE[1]]
            known = whole.values(half + condition[servo].data) if servo in condition else alone.values(half)
            found[servo] = Answer(status.error, known)
        return found

    def _sync_read(self, ids: Sequence[int], address: int, length: int) -> dict[int, Status]:
        if not ids:
            return {}
        found = self._bus.sync_read(ids, address, length)
        again = [servo for servo in ids if servo not in found and servo not in self._silent]
        late = self._bus.sync_read(again, address, length) if again else {}
        self._again |= set(late)
        return found | late

    def _off_aloud(self, index: int) -> bool:
        """Turn a servo's torque off that another client may have told to confirm nothing."""
        level = self._models[index][Name.STATUS_RETURN_LEVEL]
        try:
            self._bus.write(self._ids[index], level, level.initial or 0)
        except BusError:
            return False
        return self._off(index)

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


def _block_rows(model: Model) -> list[tuple[Register, int, int]]:
    """Return what is read of a health block, each with its first byte and size; what the model lacks is left out."""
    places = [(model[name], *place) for name, place in places_in_block().items() if name in model.registers]
    return [row for row in places if row[0].name in COLUMNS]


def _direct_layouts(model: Model) -> tuple[Layout, Layout]:
    """Return the layouts of STATE followed by CONDITION, and of STATE alone."""
    rows = [model[name] for name in COLUMNS if name in model.registers]
    state, condition = (
        [(row, row.address - start + before, row.size) for row in rows if start <= row.address < start + length]
        for (start, length), before in ((STATE, 0), (CONDITION, STATE[1]))
    )
    return Layout(state + condition), Layout(state)


def _alike(block: Answer, direct: Answer) -> bool:
    """Whether a health block says the same as the registers themselves; what is unknown is not alike."""
    found, wanted = (dict[Name, float](zip(COLUMNS, one.values, strict=True)) for one in (block, direct))
    return all(abs(found[name] - wanted[name]) <= most for name, most in _ALIKE.items())


def _registers(model: Model, first: int, data: bytes) -> dict[Name, int]:
    """Return the registers whose bytes lie in a stretch of a servo's memory, in counts."""
    return {
        name: int.from_bytes(data[row.address - first : row.address - first + row.size], "little", signed=row.signed)
        for name, row in model.registers.items()
        if first <= row.address and row.address + row.size <= first + len(data)
    }
