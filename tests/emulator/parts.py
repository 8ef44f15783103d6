"""What the tests of the emulator share: instruction packets of their own making, and a servo with a shaft to turn."""

from __future__ import annotations

from dataclasses import dataclass, field

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_RX_TIMEOUT, COMM_SUCCESS, PortHandler, Protocol2PacketHandler

from robolamp.dynamixel.registers import MODELS, Name
from robolamp.emulator.line.line import Line
from robolamp.emulator.servo.servo import Sensed, Servo

HEADER = b"\xff\xff\xfd\x00"


def sdk_crc(data: bytes) -> bytes:
    """The CRC by the servo maker's own code."""
    return Protocol2PacketHandler().updateCRC(0, data, len(data)).to_bytes(2, "little")


def instruction(id: int, code: int, parameters: bytes = b"") -> bytes:
    body = bytes([code]) + parameters
    stuffed = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    data = HEADER + bytes([id]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return data + sdk_crc(data)


class PatientHandler(Protocol2PacketHandler):
    """The SDK's, which asks again where it gave an answer up: a busy machine may be slow."""

    def txRxPacket(self, port: PortHandler, packet: list[int]) -> tuple[list[int], int, int]:
        for _ in range(30):
            answer = super().txRxPacket(port, list(packet))
            if answer[1] not in (COMM_RX_TIMEOUT, COMM_RX_CORRUPT):
                break
        return answer

    def broadcastPing(self, port: PortHandler) -> tuple[dict[int, list[int]], int]:
        for _ in range(30):
            found, result = super().broadcastPing(port)
            if result == COMM_SUCCESS:
                break
        return found, result


def u16(value: int) -> bytes:
    return value.to_bytes(2, "little")


def read(id: int, address: int, size: int) -> bytes:
    return instruction(id, 0x02, u16(address) + u16(size))


def write(id: int, address: int, value: int, size: int) -> bytes:
    return instruction(id, 0x03, u16(address) + value.to_bytes(size, "little", signed=value < 0))


@dataclass
class Status:
    id: int
    error: int
    data: bytes

    @classmethod
    def of(cls, raw: bytes) -> Status:
        assert raw[:4] == HEADER
        assert raw[5] | raw[6] << 8 == len(raw) - 7
        assert raw[7] == 0x55
        assert raw[-2:] == sdk_crc(raw[:-2])
        body = raw[8:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        return cls(raw[4], body[0], body[1:])


@dataclass
class Bench:
    """Servos on a line, each with a shaft that the test turns."""

    ids: tuple[int, ...] = (1,)
    model: str = "XL330-M288-T"
    baud: int = 1_000_000
    eeprom: dict[Name, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.shaft = Sensed(angle=3.0, velocity=0.0, current=0.0, duty=0.0, voltage=5.0, temperature=30.0)
        start = {Name.BAUD_RATE: 3, Name.RETURN_DELAY_TIME: 0, **self.eeprom}
        self.servos = [Servo(MODELS[self.model], {**start, Name.ID: id}, lambda _: self.shaft) for id in self.ids]
        self.advanced: list[float] = []
        self.line = Line(self.servos, self.baud, self.advanced.append)
        self.time = 0.0

    def send(self, data: bytes) -> list[Status]:
        self.time += 0.01
        return [Status.of(reply.data) for reply in self.line.feed(data, self.time)]

    def ask(self, data: bytes) -> Status:
        (answer,) = self.send(data)
        return answer

    def value(self, address: int, size: int, id: int = 1) -> int:
        answer = self.ask(read(id, address, size))
        assert answer.error == 0
        return int.from_bytes(answer.data, "little", signed=True)
