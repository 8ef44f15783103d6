"""The servo bus: Protocol 2.0 packets through dynamixel-sdk, with the status of every servo kept apart.

The SDK frames and checks packets. Its GroupSyncRead is not used: it drops the ERR byte, stops at the first servo that
does not answer, waits 34 ms for it, and its getData() then returns 0. Here each status packet is received on its own
with a timeout of `patience` after the bytes before it: a silent servo costs that once, and only its own data.
Packets: https://emanual.robotis.com/docs/en/dxl/protocol2/.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, PortHandler, Protocol2PacketHandler

from robolamp.dynamixel.registers import BAUD_CODES, Register
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

_BROADCAST = 0xFE
_PING, _READ, _WRITE, _SYNC_READ, _SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
_ALERT = 0x80
_WRONG_CRC = 3
_STATUS_BYTES = 11  # a status packet without data: header 4, id, length 2, instruction, ERR, CRC 2
_MOST_BYTES = 1024  # more than all answers to one instruction: a line that babbles must not hold the loop
_WRITE_TIMEOUT = 0.05  # s: a port that takes no bytes any more
_PORT_ERRORS = (OSError, termios.error)  # SerialException is an OSError; tcflush on a port that went away is not

_REFUSALS = {
    1: "it failed to process the instruction",
    2: "it does not know the instruction",
    3: "it received a wrong CRC",
    4: "the value is out of the register's range",
    5: "the data has the wrong length",
    6: "the value is outside the servo's own limits",
    7: "access is denied (EEPROM while torque is on, or a read-only register)",
}
"""ERR codes of a status packet (e-manual, protocol 2.0, "Error")."""


class Port(Protocol):
    """What the SDK's packet handler needs of a port: the SDK's own PortHandler, or an emulated line."""

    is_using: bool

    def openPort(self) -> bool:
        """Open it."""
        ...

    def closePort(self) -> None:
        """Close it."""
        ...

    def clearPort(self) -> None:
        """Throw away what was received and not read."""
        ...

    def readPort(self, length: int) -> bytes:
        """Return at most that many received bytes."""
        ...

    def writePort(self, packet: Sequence[int]) -> int:
        """Send bytes; return how many."""
        ...

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start waiting for an answer [ms]."""
        ...

    def isPacketTimeout(self) -> bool:
        """Whether that time is over."""
        ...


class SerialPort(PortHandler):
    """The SDK's serial port, on our clock, sleeping while it waits instead of polling.

    Args:
        path: Device path.
        baud: Baud rate [1/s].
        clock: Measures timeouts; the SDK's own use of the wall clock breaks when that is set.
    """

    ser: Any  # serial.Serial once open

    def __init__(self, path: str, baud: int, clock: Clock) -> None:
        super().__init__(path)
        self.baudrate = baud
        self._clock = clock
        self._received = 0

    def setupPort(self, cflag_baud: int) -> Literal[True]:
        """Open the device for this program alone, with the shortest latency its driver has."""
        super().setupPort(cflag_baud)
        try:
            self.ser.exclusive = True
            self.ser.write_timeout = _WRITE_TIMEOUT
        except Exception:
            self.closePort()
            raise
        with contextlib.suppress(Exception):  # FTDI: latency timer 16 ms -> 1 ms; other drivers do not know it
            self.ser.set_low_latency_mode(True)
        return True

    def getCurrentTime(self) -> float:
        """Return the time [ms]."""
        return self._clock.now() * 1000.0

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start waiting for an answer [ms]."""
        self._received = 0
        super().setPacketTimeoutMillis(msec)

    def readPort(self, length: int) -> bytes:
        """Return received bytes, sleeping until there are some or the packet timeout is over."""
        if self._received >= _MOST_BYTES:
            return b""
        device = self.ser.fileno()
        left = (self.packet_timeout - self.getTimeSinceStart()) / 1000.0
        if not select.select([device], [], [], max(left, 0.0))[0]:
            return b""
        data = os.read(device, length)
        if not data:
            raise OSError(errno.EIO, os.strerror(errno.EIO))  # readable and empty: the device went away
        self._received += len(data)
        return data


@dataclass(frozen=True)
class Status:
    """A status packet.

    Attributes:
        error: Its ERR byte.
        data: Its parameters.
    """

    error: int
    data: bytes

    @property
    def alert(self) -> bool:
        """Whether the servo reports a hardware error (bit 7): the data is good all the same."""
        return bool(self.error & _ALERT)

    @property
    def refusal(self) -> str:
        """Why the instruction was refused, in words; empty if it was not."""
        code = self.error & ~_ALERT
        return _REFUSALS.get(code, f"error {code}") if code else ""


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
        self._port: Any = SerialPort(port, baud, clock) if isinstance(port, str) else port
        self._baud = baud
        self._packets = Protocol2PacketHandler()
        self._labels = dict(labels or {})
        self._patience = patience
        self._open = False
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
        self._open = True

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

    def label(self, servo: int) -> str:
        """Return what a servo is called in messages, as "knee (id 2)"."""
        return f"{self._labels[servo]} (id {servo})" if servo in self._labels else f"servo {servo}"

    def ping(self, servo: int) -> Identity | None:
        """Return what a servo is, or None if it does not answer.

        Raises:
            BusError: The servo refuses, or the port is gone.
        """
        status = self._ask(servo, _PING, b"", 3)
        if status is None:
            return None
        if status.refusal:
            raise BusError(f"{self.label(servo)} refuses the ping: {status.refusal}", self.name)
        return Identity(int.from_bytes(status.data[:2], "little"), status.data[2])

    def read(self, servo: int, register: Register) -> int:
        """Return a register's value, in counts.

        Raises:
            BusError: The servo does not answer or refuses, or the port is gone.
        """
        parameters = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        status = self._answer(servo, _READ, parameters, register.size, f"the read of {_named(register)}")
        return int.from_bytes(status.data, "little", signed=register.signed)

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

    def sync_write(self, register: Register, values: Mapping[int, int]) -> None:
        """Write one register of several servos, in counts, with one instruction that nobody answers.

        Raises:
            BusError: The port is gone.
        """
        head = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        body = b"".join(bytes([servo]) + _encoded(register, value) for servo, value in values.items())
        with self._line():
            self._send(_BROADCAST, _SYNC_WRITE, head + body)

    def _answer(self, servo: int, instruction: int, parameters: bytes, length: int, what: str) -> Status:
        status = self._ask(servo, instruction, parameters, length)
        if status is None:
            raise BusError(f"{self.label(servo)} does not answer to {what}", self.name)
        if status.refusal:
            raise BusError(f"{self.label(servo)} refuses {what}: {status.refusal}", self.name)
        return status

    def _ask(self, servo: int, instruction: int, parameters: bytes, length: int) -> Status | None:
        """Return the answer to an instruction (with data of that length, or a refusal); None after ATTEMPTS.

        An instruction that reached the servo damaged (ERR 3) was not carried out, and is sent again.
        """
        damaged: Status | None = None
        with self._line():
            for _ in range(ATTEMPTS):
                self._send(servo, instruction, parameters)
                self._wait(_STATUS_BYTES + length, max(self._patience, SETTING_PATIENCE))
                while (received := self._receive()) is not None:
                    answered, status = received
                    if answered == servo and status.error & ~_ALERT == _WRONG_CRC:
                        damaged = status
                        break
                    if answered == servo and (len(status.data) == length or status.refusal):
                        return status
        return damaged

    def _send(self, servo: int, instruction: int, parameters: bytes) -> None:
        if b"\xff\xff\xfd" in parameters:
            # SDK 4.1.0: addStuffing() stuffs a copy that txPacket() never sends, and the servos would drop the packet.
            raise BusError("bytes FF FF FD cannot be sent: dynamixel-sdk does not stuff them", self.name)
        packet = [0, 0, 0, 0, servo, *(len(parameters) + 3).to_bytes(2, "little"), instruction, *parameters, 0, 0]
        self._port.is_using = False
        result = self._packets.txPacket(self._port, packet)
        self._port.is_using = False
        if result != COMM_SUCCESS:
            raise BusError(f"cannot send: {self._packets.getTxRxResult(result)}", self.name)
        self._sent = len(packet)

    def _wait(self, length: int, patience: float) -> None:
        wire = (self._sent + length) * 10.0 / self._baud
        self._port.setPacketTimeoutMillis((patience + wire) * 1000.0)

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
            raise BusError(f"the port is gone ({said_by(error)})", self.name) from None


def _named(register: Register) -> str:
    return f"{register.name}({register.address})"


def _encoded(register: Register, value: int) -> bytes:
    return value.to_bytes(register.size, "little", signed=register.signed)
