"""Scripted servos on a real pseudo-terminal: a second, independent reading of the protocol, that can misbehave."""

from __future__ import annotations

import os
import select
import threading
import tty
from types import TracebackType

from robolamp.dynamixel.registers import MODELS, Name


def crc(data: bytes) -> int:
    """CRC-16, polynomial 0x8005, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x8005 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def packet(servo: int, body: bytes) -> bytes:
    """A packet of INST and parameters, stuffed."""
    stuffed = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    raw = b"\xff\xff\xfd\x00" + bytes([servo]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return raw + crc(raw).to_bytes(2, "little")


class Servo:
    """A register file, and how it misbehaves."""

    def __init__(self, model: str) -> None:
        self.model = MODELS[model]
        self.memory = bytearray(700)
        self.silent = False  # answers nothing
        self.deaf_to: set[int] = set()  # instructions it does not answer
        self.deaf_blocks: set[int] = set()  # addresses of reads it does not answer
        self.garbled = 0  # instructions that reach it with a wrong CRC
        self.error = 0  # ERR of every answer
        self.damage = 0  # xor of a byte in every answer
        self.refuse: dict[int, int] = {}  # ERR of a write to an address
        self.stuck: set[int] = set()  # addresses that take a write and keep their value
        for register in self.model.registers.values():
            self[register.name] = register.initial or 0
        self.indirect = True  # whether it has indirect registers
        self.late: bytes | None = None  # data of an answer that comes first: one that was given up
        self.boot()
        self[Name.MODEL_NUMBER] = self.model.number
        self[Name.FIRMWARE_VERSION] = 52
        self[Name.RETURN_DELAY_TIME] = 0
        self[Name.PRESENT_POSITION] = 2048
        self[Name.PRESENT_INPUT_VOLTAGE] = 50
        self[Name.PRESENT_TEMPERATURE] = 31

    def boot(self) -> None:
        """What a reboot does to RAM that matters here: torque off, indirect addresses and data as from the factory."""
        self[Name.TORQUE_ENABLE] = 0
        for block in self.model.indirect:
            for index in range(block.count):
                at = block.address + 2 * index
                self.memory[at : at + 2] = (block.data + index).to_bytes(2, "little")
                self.memory[block.data + index] = 0

    def read(self, address: int, length: int) -> bytes:
        return bytes(self._byte(at) for at in range(address, address + length))

    def _byte(self, address: int) -> int:
        for block in self.model.indirect if self.indirect else ():
            if block.data <= address < block.data + block.count:
                at = block.address + 2 * (address - block.data)
                return self.memory[int.from_bytes(self.memory[at : at + 2], "little")]
        return self.memory[address]

    def __setitem__(self, name: Name, value: int) -> None:
        register = self.model[name]
        end = register.address + register.size
        self.memory[register.address : end] = value.to_bytes(register.size, "little", signed=register.signed)

    def __getitem__(self, name: Name) -> int:
        register = self.model[name]
        raw = self.memory[register.address : register.address + register.size]
        return int.from_bytes(raw, "little", signed=register.signed)


class Responder:
    """Answers on a pseudo-terminal in a thread, until the `with` ends.

    Attributes:
        servos: By id.
        name: The port to open.
        heard: Every good instruction packet: (id, instruction, parameters).
        noise: Bytes sent before every answer.
    """

    def __init__(self, ids: tuple[int, ...] = (1, 2, 3), model: str = "XL330-M288-T") -> None:
        self.servos = {servo: Servo(model) for servo in ids}
        self.heard: list[tuple[int, int, bytes]] = []
        self.noise = b""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._serve)
        self._closed = False

    def __enter__(self) -> Responder:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()

    def unplug(self) -> None:
        """Close the port under the client's feet."""
        if self._closed:
            return
        self._closed = True
        os.write(self._waker, b"x")
        self._thread.join()
        for descriptor in (self._master, self._slave, self._wake, self._waker):
            os.close(descriptor)

    def _serve(self) -> None:
        buffer = b""
        while True:
            ready, _, _ = select.select([self._master, self._wake], [], [])
            if self._wake in ready:
                return
            buffer += os.read(self._master, 4096)
            while len(buffer) >= 7 and len(buffer) >= (size := 7 + int.from_bytes(buffer[5:7], "little")):
                raw, buffer = buffer[:size], buffer[size:]
                assert raw[:4] == b"\xff\xff\xfd\x00"
                assert crc(raw[:-2]) == int.from_bytes(raw[-2:], "little")
                self.heard.append((raw[4], raw[7], raw[8:-2]))
                servo = self.servos.get(raw[4])
                if servo and servo.garbled:
                    servo.garbled -= 1
                    self._reply(raw[4], raw[7], 3, b"")
                else:
                    self._obey(raw[4], raw[7], raw[8:-2])

    def _obey(self, target: int, instruction: int, parameters: bytes) -> None:
        address, length = (int.from_bytes(parameters[i : i + 2], "little") for i in (0, 2))
        if instruction == 0x83:
            for start in range(4, len(parameters), 1 + length):
                servo = self.servos.get(parameters[start])
                if servo:
                    self._write(servo, address, parameters[start + 1 : start + 1 + length])
        elif instruction == 0x82:
            for servo in parameters[4:]:
                self._answer(servo, instruction, 0, address, length)
        elif instruction == 0x8A:
            self._fast(parameters[4:], address, length)
        elif instruction == 0x08 and target in self.servos:
            self._reply(target, instruction, 0, b"")
            self.servos[target].boot()
        elif instruction == 0x01:
            memory = self.servos[target].memory if target in self.servos else b""
            self._reply(target, instruction, 0, bytes(memory[0:2]) + bytes(memory[6:7]))
        elif instruction == 0x02:
            self._answer(target, instruction, 0, address, length)
        elif instruction == 0x03 and target in self.servos:
            error = self._write(self.servos[target], address, parameters[2:])
            self._reply(target, instruction, error, b"")

    def _write(self, servo: Servo, address: int, data: bytes) -> int:
        if not servo.refuse.get(address) and address not in servo.stuck and not servo.silent:
            servo.memory[address : address + len(data)] = data
        return servo.refuse.get(address, 0)

    def _answer(self, servo: int, instruction: int, error: int, address: int, length: int) -> None:
        if servo in self.servos and not self.servos[servo].deaf_blocks & {*range(address, address + length)}:
            self._reply(servo, instruction, error, self.servos[servo].read(address, length))

    def _fast(self, ids: bytes, address: int, length: int) -> None:
        """One packet of all servos, up to the first that is silent or does not know the instruction."""
        raw = b"\xff\xff\xfd\x00\xfe" + (1 + len(ids) * (4 + length)).to_bytes(2, "little") + b"\x55"
        for servo in ids:
            state = self.servos.get(servo)
            if state is None or state.silent or 0x8A in state.deaf_to:
                break
            raw += bytes([state.error, servo]) + state.read(address, length)
            raw += crc(raw).to_bytes(2, "little")
            if state.damage:
                raw = raw[:-4] + bytes([raw[-4] ^ state.damage]) + raw[-3:]
        if len(raw) > 8:
            os.write(self._master, self.noise + raw)

    def _reply(self, servo: int, instruction: int, error: int, data: bytes) -> None:
        state = self.servos.get(servo)
        if state is None or state.silent or instruction in state.deaf_to:
            return
        if state.late is not None and instruction == 0x82:
            os.write(self._master, packet(servo, bytes([0x55, 0]) + state.late))
            state.late = None
        raw = bytearray(packet(servo, bytes([0x55, error | state.error]) + data))
        raw[-3] ^= state.damage
        os.write(self._master, self.noise + bytes(raw))
