"""The servo bus: Protocol 2.0 packets through dynamixel-sdk, with the status of every servo kept apart.

The SDK checks what comes in and computes CRCs. Its txPacket is not used: it does not send the bytes that it stuffs
(4.1.0: addStuffing returns a copy that is dropped). Nor is its GroupSyncRead: it drops the ERR byte, stops at the first
servo that does not answer, waits 34 ms for it, and its getData() then returns 0. Here each status packet is received on
its own with a timeout of `patience` after the bytes before it: a silent servo costs that once, and only its own data.
Packets: https://emanual.robotis.com/docs/en/dxl/protocol2/.
"""

from __future__ import annotations

import contextlib
import termios
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, Protocol2PacketHandler

from robolamp.dynamixel.fast_sync_read import FastReply
from robolamp.dynamixel.port import Port, SerialPort, line_time
from robolamp.dynamixel.registers import BAUD_CODES, Register
from robolamp.dynamixel.status_packet import ALERT, Status
from robolamp.errors import BusError
from robolamp.ports import open_error, said_by
from robolamp.signals import Clock

PATIENCE = 0.002
"""How long to wait for an answer beyond its time on the wire [s]: a USB frame of 1 ms, and as much again."""

SETTING_PATIENCE = 0.02
"""The same for single reads, writes and pings [s]: outside the tick there is time, and an answer that comes after its
instruction was given up would pass for the next one's."""

ATTEMPTS = 3
"""How often a single read, write or ping is tried; a sync read inside a tick is not repeated."""

_TABLE = 147  # bytes: from Model Number to Present Temperature, nearly all that two servos may differ in
_SURE = 2  # clean answers after which a servo is alone with its id
_SUSPECT = 6  # answers garbled or doubled before that: one in five, as on a very bad line, comes to 1 in 2,000
_QUIET = 0.005  # s: after an answer no other follows any more (Return Delay Time is 0.5 ms at most)
_MOST_HEARD = 1024  # bytes: a line that babbles must not hold up what asks
_SILENCE = 3  # questions in a row that nobody answers
_BETWEEN_PINGS = 0.003  # s an id, as dynamixel-sdk waits for a broadcast ping
_APART = 3  # single reads in a row that ask for different numbers of bytes
_HEADER = b"\xff\xff\xfd\x00"
_BROADCAST = 0xFE
_PING, _READ, _WRITE, _REBOOT, _SYNC_READ, _SYNC_WRITE, _FAST_SYNC_READ = 0x01, 0x02, 0x03, 0x08, 0x82, 0x83, 0x8A
_STATUS = 0x55
_WRONG_CRC = 3
_STATUS_BYTES = 11  # a status packet without data: header 4, id, length 2, instruction, ERR, CRC 2
_updated = Protocol2PacketHandler().updateCRC
_PORT_ERRORS = (OSError, termios.error)  # SerialException is an OSError; tcflush on a port that went away is not


@dataclass(frozen=True)
class Identity:
    """What a servo answers to a ping.

    Attributes:
        model_number: Its model.
        firmware: Its firmware version.
    """

    model_number: int
    firmware: int


class Bus:
    """Several servos on one half-duplex line.

    Args:
        port: Device path, or an SDK-like port object.
        baud: Baud rate of the line [1/s].
        clock: Measures timeouts.
        labels: What to call the servos in messages, by id.
        patience: How long to wait for an answer beyond its time on the wire [s].

    Attributes:
        name: The port's path.
        stray: Bytes received that answered nothing, so far: duplicates, and answers that came too late.
        gone: Whether the port went away since it was opened.
    """

    def __init__(
        self,
        port: str | Port,
        baud: int,
        clock: Clock,
        *,
        labels: Mapping[int, str] | None = None,
        patience: float = PATIENCE,
    ) -> None:
        self.name = port if isinstance(port, str) else type(port).__name__
        self.stray = 0
        self.gone = False
        self._port: Any = SerialPort(port, baud, clock) if isinstance(port, str) else port
        self._baud = baud
        self._packets = Protocol2PacketHandler()
        self._labels = dict(labels or {})
        self._patience = patience
        self._open = False
        self._asked: deque[int] = deque(maxlen=_APART)  # bytes that the last reads asked for
        self._sent = 0  # bytes of the last instruction

    def open(self) -> None:
        """Open the port.

        Raises:
            BusError: It does not exist, may not be used, or has no such baud rate.
        """
        try:
            opened = self._port.openPort()
        except (*_PORT_ERRORS, ValueError) as error:
            if isinstance(error, ValueError) and "baud" in str(error):  # pyserial: the driver refused the rate
                raise self._rate_error() from None
            raise open_error(self.name, error, "--port, or bus.port in hardware/lamp.toml") from None
        if not opened:  # the SDK does not know the rate
            raise self._rate_error()
        self._open, self.gone = True, False

    def close(self) -> None:
        """Close the port; may be called twice."""
        if self._open:
            self._open = False
            with contextlib.suppress(*_PORT_ERRORS):
                self._port.closePort()

    def _rate_error(self) -> BusError:
        if self._baud in BAUD_CODES:
            return BusError(f"this port cannot do {self._baud} baud; set bus.baud and the servos to another", self.name)
        choices = ", ".join(map(str, BAUD_CODES))
        return BusError(f"{self._baud} is not a baud rate of the servos ({choices})", self.name)

    @property
    def low_latency(self) -> bool:
        """Whether the port's driver hands over bytes at once; a port that is no serial device does."""
        return not isinstance(self._port, SerialPort) or self._port.low_latency

    def label(self, servo: int) -> str:
        """Return what a servo is called in messages, as "knee (id 2)"."""
        return f"{self._labels[servo]} (id {servo})" if servo in self._labels else f"servo {servo}"

    def patient(self, patience: float = SETTING_PATIENCE) -> contextlib.AbstractContextManager[None]:
        """Wait longer for every answer inside the `with`, to sync reads too: for what is asked outside a tick.

        Args:
            patience: How long beyond its time on the wire [s]; where more is in force already, that.
        """
        return self._waiting(max(self._patience, patience))

    def hasty(self, patience: float) -> contextlib.AbstractContextManager[None]:
        """Wait no longer for any answer inside the `with`: for questions asked in many ways, one after another.

        Args:
            patience: How long beyond its time on the wire [s]; where less is in force already, that.
        """
        return self._waiting(min(self._patience, patience))

    @contextlib.contextmanager
    def _waiting(self, patience: float) -> Iterator[None]:
        before, self._patience = self._patience, patience
        try:
            yield
        finally:
            self._patience = before

    @contextlib.contextmanager
    def at_rate(self, baud: int) -> Iterator[bool]:
        """Use another baud rate inside the `with`; yields whether the port has it.

        Args:
            baud: The rate [1/s].

        Raises:
            BusError: The port is gone.
        """
        before = self._baud
        try:
            yield self._set_rate(baud)
        finally:
            if not self._set_rate(before):
                raise BusError(f"the port does not go back to {before} baud", self.name)

    def ping(self, servo: int, *, attempts: int = ATTEMPTS) -> Identity | None:
        """Return what a servo is, or None if it does not answer.

        Args:
            servo: Its id.
            attempts: How often to ask.

        Raises:
            BusError: The servo refuses, or the port is gone.
        """
        status = self._ask(servo, _PING, b"", 3, attempts)
        if status is None:
            return None
        if status.refusal:
            raise BusError(f"{self.label(servo)} refuses the ping: {status.refusal}", self.name)
        return Identity(int.from_bytes(status.data[:2], "little"), status.data[2])

    def stirs(self, servo: int) -> bool:
        """Return whether anything comes after a ping, garbled or not.

        Args:
            servo: The id.

        Raises:
            BusError: The port is gone.
        """
        return bool(self._hear(servo, _PING, b"", 3))

    def present(self) -> list[int]:
        """Return the ids that answer a ping to all, in ascending order.

        Raises:
            BusError: The port is gone.
        """
        with self._line():
            self._send(_BROADCAST, _PING, b"")
            self._wait(_BROADCAST * (_STATUS_BYTES + 3), self._patience + _BROADCAST * _BETWEEN_PINGS)
            data = b""
            while not self._port.isPacketTimeout():
                data += self._port.readPort(1)
        return sorted(set(_senders(data)))

    def doubled(self, servo: int) -> bool:
        """Return whether several servos answer to an id; nothing is written.

        Their answers overlap, and what is heard of them is garbled unless they say the very same at the same time; or
        they follow each other, as with different Return Delay Times. Nearly the whole control table is asked for: two
        servos differ somewhere in it (position, voltage, time since power-on). Where nobody answers a read, as at
        Status Return Level 0, pings must do.

        Args:
            servo: The id.

        Raises:
            BusError: The port is gone.
        """
        whole = (0).to_bytes(2, "little") + _TABLE.to_bytes(2, "little")
        for instruction, parameters, length in ((_READ, whole, _TABLE), (_PING, b"", 3)):
            clean = bad = silent = 0
            while clean < _SURE and bad < _SUSPECT and silent < _SILENCE:
                data = self._hear(servo, instruction, parameters, length)
                answers = _senders(data).count(servo)
                clean += answers == 1
                bad += answers > 1 or (answers == 0 and len(data) > 0)
                silent = 0 if data else silent + 1
            if clean >= _SURE or bad >= _SUSPECT:
                return bad >= _SUSPECT
        return False

    def read(self, servo: int, register: Register) -> int:
        """Return a register's value, in counts.

        Raises:
            BusError: The servo does not answer or refuses, or the port is gone.
        """
        data = self._read(servo, register.address, register.size, f"the read of {_named(register)}")
        return int.from_bytes(data, "little", signed=register.signed)

    def write(self, servo: int, register: Register, value: int) -> None:
        """Write a register, in counts, and check that the servo took it.

        Raises:
            BusError: The servo does not answer or refuses, or the port is gone.
        """
        parameters = register.address.to_bytes(2, "little") + _encoded(register, value)
        self._answer(servo, _WRITE, parameters, 0, f"{value} for {_named(register)}")

    def sync_read(self, servos: Sequence[int], address: int, length: int) -> dict[int, Status]:
        """Read the same bytes of several servos with one instruction.

        Args:
            servos: Their ids, in the order in which they answer.
            address: Of the first byte.
            length: Bytes a servo.

        Returns:
            The status packets of those that answered; one that is missing did not (or its bytes were damaged).

        Raises:
            BusError: The port is gone.
        """
        missing = set(servos)
        found: dict[int, Status] = {}
        with self._line():
            head = address.to_bytes(2, "little") + length.to_bytes(2, "little")
            self._send(_BROADCAST, _SYNC_READ, head + bytes(servos))
            self._wait(_STATUS_BYTES + length, self._patience)
            while missing:
                received = self._receive()
                if received is None:
                    break
                servo, status = received
                if servo in missing and len(status.data) == length:  # not a late answer to something else
                    missing.discard(servo)
                    found[servo] = status
                    self._wait(_STATUS_BYTES + length, self._patience)
        return found

    def fast_sync_read(self, servos: Sequence[int], address: int, length: int) -> dict[int, Status]:
        """Read the same bytes of several servos with one instruction that they answer with one packet together.

        Each servo adds its block when it has heard the one before it: from the first that is silent on, all are
        missing. Only firmware of `Model.fast_sync_read` and later knows it.

        Args:
            servos: Their ids, in the order of the blocks.
            address: Of the first byte.
            length: Bytes a servo.

        Returns:
            The blocks that came undamaged.

        Raises:
            BusError: The port is gone.
        """
        reply = FastReply(servos, length, _updated)
        with self._line():
            head = address.to_bytes(2, "little") + length.to_bytes(2, "little")
            self._send(_BROADCAST, _FAST_SYNC_READ, head + bytes(servos))
            self._wait(reply.expected, self._patience)
            while not reply.complete:
                data = self._port.readPort(reply.expected)
                if data:
                    reply.feed(data)
                elif self._port.isPacketTimeout():
                    break
        return reply.found

    def read_bytes(self, servo: int, address: int, length: int) -> bytes:
        """Return bytes of a servo's control table.

        Raises:
            BusError: The servo does not answer or refuses, or the port is gone.
        """
        return self._read(servo, address, length, f"the read of {length} bytes at {address}")

    def write_bytes(self, servo: int, address: int, data: bytes) -> None:
        """Write bytes of a servo's control table, and check that the servo took them.

        Raises:
            BusError: The servo does not answer or refuses, or the port is gone.
        """
        parameters = address.to_bytes(2, "little") + data
        self._answer(servo, _WRITE, parameters, 0, f"{len(data)} bytes at {address}")

    def reboot(self, servo: int) -> None:
        """Restart a servo: torque off, hardware error gone, everything but EEPROM forgotten.

        Raises:
            BusError: The servo does not answer or refuses, or the port is gone.
        """
        self._answer(servo, _REBOOT, b"", 0, "the reboot")

    def write_all(self, register: Register, value: int) -> None:
        """Write a register of every servo on the line, in counts, whatever its id; nobody answers.

        Raises:
            BusError: The port is gone.
        """
        with self._line():
            self._tell(_BROADCAST, _WRITE, register.address.to_bytes(2, "little") + _encoded(register, value))

    def tell(self, servo: int, register: Register, value: int) -> None:
        """Write a register of a servo that may not answer writes, in counts; nothing is waited for.

        Raises:
            BusError: The port is gone.
        """
        with self._line():
            self._tell(servo, _WRITE, register.address.to_bytes(2, "little") + _encoded(register, value))

    def sync_write(self, register: Register, values: Mapping[int, int]) -> None:
        """Write one register of several servos, in counts, with one instruction that nobody answers.

        Raises:
            BusError: The port is gone.
        """
        head = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        body = b"".join(bytes([servo]) + _encoded(register, value) for servo, value in values.items())
        with self._line():
            self._tell(_BROADCAST, _SYNC_WRITE, head + body)

    def _read(self, servo: int, address: int, length: int, what: str) -> bytes:
        """Return bytes of a control table.

        It asks for a byte or more beyond them where an earlier read asked for as many: an answer does not say what it
        answers, and one that comes twice, or too late, would pass for that of a later read.
        """
        asked = next(count for count in range(length, length + _APART + 1) if count not in self._asked)
        self._asked.append(asked)
        parameters = address.to_bytes(2, "little") + asked.to_bytes(2, "little")
        return self._answer(servo, _READ, parameters, asked, what).data[:length]

    def _answer(self, servo: int, instruction: int, parameters: bytes, length: int, what: str) -> Status:
        status = self._ask(servo, instruction, parameters, length)
        if status is None:
            raise BusError(f"{self.label(servo)} does not answer to {what}", self.name)
        if status.refusal:
            raise BusError(f"{self.label(servo)} refuses {what}: {status.refusal}", self.name)
        return status

    def _ask(
        self, servo: int, instruction: int, parameters: bytes, length: int, attempts: int = ATTEMPTS
    ) -> Status | None:
        """Return the answer to an instruction (with data of that length, or a refusal); None after ATTEMPTS.

        An instruction that reached the servo damaged (ERR 3) was not carried out, and is sent again.
        """
        damaged: Status | None = None
        with self._line():
            for _ in range(attempts):
                self._send(servo, instruction, parameters)
                self._wait(_STATUS_BYTES + length, max(self._patience, SETTING_PATIENCE))
                while (received := self._receive()) is not None:
                    answered, status = received
                    if answered == servo and status.error & ~ALERT == _WRONG_CRC:
                        damaged = status
                        break
                    if answered == servo and (len(status.data) == length or status.refusal):
                        return status
        return damaged

    def _hear(self, servo: int, instruction: int, parameters: bytes, length: int) -> bytes:
        """Return every byte that comes after an instruction, until its answer is over."""
        size = _STATUS_BYTES + length
        data = b""
        with self._line():
            self._send(servo, instruction, parameters)
            self._wait(size, max(self._patience, SETTING_PATIENCE))
            while len(data) < _MOST_HEARD and not self._port.isPacketTimeout():
                piece = self._port.readPort(1)
                data += piece
                if piece and len(data) >= size:
                    self._wait(size, _QUIET)
        return data

    def _set_rate(self, baud: int) -> bool:
        with self._line():
            try:
                done = self._port.setBaudRate(baud)
            except ValueError:  # pyserial: the driver refused the rate
                return False
        if done:
            self._baud = baud
        return done

    def _send(self, servo: int, instruction: int, parameters: bytes) -> None:
        """Send an instruction that is answered."""
        self._port.is_using = False  # rxPacket leaves it so, except where it raised
        self.stray += self._port.getBytesAvailable()
        self._port.clearPort()  # an answer that came too late must not pass for this instruction's
        self._tell(servo, instruction, parameters)

    def _tell(self, servo: int, instruction: int, parameters: bytes) -> None:
        """Send an instruction."""
        packet = _packet(servo, instruction, parameters)
        written = self._port.writePort(packet)
        if written != len(packet):
            raise BusError(f"the port took {written} of {len(packet)} bytes", self.name)
        self._sent = len(packet)

    def _wait(self, length: int, patience: float) -> None:
        self._port.setPacketTimeoutMillis((patience + line_time(self._sent + length, self._baud)) * 1000.0)

    def _receive(self) -> tuple[int, Status] | None:
        """Return the next good status packet with its sender; None when the time is over."""
        while True:
            packet, result = self._packets.rxPacket(self._port, False)
            if result == COMM_SUCCESS:
                length = packet[5] | packet[6] << 8
                if length >= 4:  # the SDK shortens LEN, not the list, when it removes stuffing
                    return packet[4], Status(packet[8], bytes(packet[9 : length + 5]))
            elif result == COMM_RX_TIMEOUT or self._port.isPacketTimeout():
                return None

    @contextlib.contextmanager
    def _line(self) -> Iterator[None]:
        if not self._open:
            raise BusError("the port is not open", self.name)
        try:
            yield
        except _PORT_ERRORS as error:
            self.gone = True
            raise BusError(f"the port is gone ({said_by(error)})", self.name) from None


@lru_cache(maxsize=64)  # a tick asks the same questions again and again
def _packet(servo: int, instruction: int, parameters: bytes) -> bytes:
    body = bytes([instruction]) + parameters
    stuffed = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    packet = _HEADER + bytes([servo]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return packet + _updated(0, packet, len(packet)).to_bytes(2, "little")


def _senders(data: bytes) -> list[int]:
    """Return the ids of the undamaged status packets in some bytes."""
    found: list[int] = []
    at = data.find(_HEADER)
    while at >= 0:
        end = at + 7 + int.from_bytes(data[at + 5 : at + 7], "little")
        packet = data[at:end]
        good = len(packet) == end - at >= _STATUS_BYTES and packet[7] == _STATUS
        if good and _updated(0, packet[:-2], len(packet) - 2) == int.from_bytes(packet[-2:], "little"):
            found.append(packet[4])
            at = data.find(_HEADER, end)
        else:
            at = data.find(_HEADER, at + 1)
    return found


def _named(register: Register) -> str:
    return f"{register.name}({register.address})"


def _encoded(register: Register, value: int) -> bytes:
    return value.to_bytes(register.size, "little", signed=register.signed)
