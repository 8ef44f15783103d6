"""Fuzzing: random and mutated bytes at the emulator, the driver and the foot reader, seeded.

Each target has its time. A crash is any exception but those its documentation names; a lie is a value that was taken
from an answer of which one bit was turned over (the CRC finds every single one). The exit code is 1 if there was any.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Sequence

import numpy as np

from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.registers import MODELS, RAD_PER_COUNT, Name
from robolamp.dynamixel.servos import Servos
from robolamp.emulator.bare_servos import BareServos
from robolamp.emulator.bare_servos_file import BareServo
from robolamp.emulator.packet import fast_status, packet, status
from robolamp.emulator.ports.lockstep import LockstepClock
from robolamp.errors import BusError
from robolamp.foot.protocol import Frame, encode
from robolamp.foot.sensor import FootSensor

IDS = (1, 2, 3)
MODEL = "XL330-M288-T"
BAUD = 1_000_000
LIVES = 100  # cases that one emulated line lives: a reboot or a new id silences its servos
INSTRUCTIONS = (1, 2, 3, 4, 5, 6, 8, 0x10, 0x20, 0x55, 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A)

Random = np.random.Generator


def servo(id: int) -> BareServo:
    """Return a servo for the emulated line."""
    return BareServo(MODEL, id, BAUD, return_delay=0.0, position=3.14, voltage=5.0, load=1e-5)


def noise(random: Random, most: int = 60) -> bytes:
    """Return random bytes, of which many begin like a packet."""
    data = random.bytes(int(random.integers(0, most)))
    return b"\xff\xff\xfd\x00" + data if random.random() < 0.5 else data


def mutated(data: bytes, random: Random) -> bytes:
    """Return bytes with a few changes: bits turned over, pieces cut out, doubled, or put in."""
    changed = bytearray(data)
    for _ in range(int(random.integers(1, 5))):
        at = int(random.integers(0, len(changed) + 1))
        end = min(len(changed), at + int(random.integers(1, 8)))
        match int(random.integers(0, 4)):
            case 0 if at < len(changed):
                changed[at] ^= 1 << int(random.integers(0, 8))
            case 1:
                del changed[at:end]
            case 2:
                changed[at:at] = changed[at:end]
            case _:
                changed[at:at] = noise(random, 8)
    return bytes(changed)


def instruction(random: Random) -> bytes:
    """Return a well-formed instruction packet with random contents."""
    id = int(random.choice([*IDS, 0xFE, int(random.integers(0, 256))]))
    body = bytes([int(random.choice(INSTRUCTIONS))]) + random.bytes(int(random.integers(0, 24)))
    return packet(id, body)


class Line:
    """Emulated servos that hear anything."""

    def __init__(self) -> None:
        self.cases = 0

    def case(self, random: Random) -> None:
        """Let them hear one more."""
        if self.cases % LIVES == 0:
            self.world = BareServos([servo(id) for id in IDS])
            self.now = 0.0
        self.cases += 1
        data = instruction(random)
        choice = int(random.integers(0, 3))
        sent = noise(random) if choice == 0 else mutated(data, random) if choice == 1 else data
        self.now += float(random.exponential(0.002))
        self.world.receive(sent, self.now)


class Babbling:
    """A port behind which somebody answers anything, in a time that passes as it is waited for."""

    def __init__(self, random: Random, position: int) -> None:
        self.is_using = False
        self.random = random
        self.now_ = 0.0
        self.end = 0.0
        self.flips_only = False
        self._position = position
        self._waiting: deque[int] = deque()

    def now(self) -> float:
        return self.now_

    def sleep_until(self, time: float) -> None:
        self.now_ = max(self.now_, time)

    def openPort(self) -> bool:
        return True

    def closePort(self) -> None:
        pass

    def getBytesAvailable(self) -> int:
        return len(self._waiting)

    def clearPort(self) -> None:
        self._waiting.clear()

    def writePort(self, packet: Sequence[int]) -> int:
        sent = bytes(packet)
        answer = b"".join(self._answers(sent))
        if not self.flips_only and self.random.random() < 0.3:
            answer = noise(self.random, 120)
        elif not self.flips_only:
            answer = mutated(answer, self.random) if answer else answer
        elif answer:
            flipped = bytearray(answer)
            flipped[int(self.random.integers(len(answer)))] ^= 1 << int(self.random.integers(8))
            answer = bytes(flipped)
        self._waiting.extend(answer)
        return len(sent)

    def readPort(self, length: int) -> bytes:
        if not self._waiting:
            self.now_ = self.end
        return bytes(self._waiting.popleft() for _ in range(min(length, len(self._waiting))))

    def setPacketTimeoutMillis(self, msec: float) -> None:
        self.end = self.now_ + msec / 1000.0

    def isPacketTimeout(self) -> bool:
        return self.now_ >= self.end

    def _answers(self, sent: bytes) -> list[bytes]:
        code, parameters = sent[7], sent[8:-2]
        length = int.from_bytes(parameters[2:4], "little") if len(parameters) >= 4 else 0
        data = (self._position.to_bytes(2, "little") * (length // 2 + 1))[:length]
        match code:
            case 0x01:
                return [status(sent[4], 0, (1200).to_bytes(2, "little") + b"\x34")]
            case 0x02:
                return [status(sent[4], 0, data)]
            case 0x03:
                return [status(sent[4], 0)]
            case 0x82:
                return [status(id, 0, data) for id in parameters[4:]]
            case 0x8A:
                return [fast_status([length] * len(parameters[4:]), [(id, 0, data) for id in parameters[4:]])]
        return []


class Driver:
    """The bus and the servos' reader on a port that babbles."""

    def __init__(self) -> None:
        self.cases = 0
        self.lies = 0

    def case(self, random: Random) -> None:
        """Read once, one way or another."""
        self.cases += 1
        position = int(random.integers(0, 4096))
        port = Babbling(random, position)
        port.flips_only = bool(random.random() < 0.5)
        bus = Bus(port, BAUD, port)
        bus.open()
        model = MODELS[MODEL]
        try:
            match int(random.integers(0, 4)):
                case 0:
                    bus.ping(1)
                case 1:
                    value = bus.read(2, model[Name.PRESENT_INPUT_VOLTAGE])
                    self.lies += port.flips_only and value != position
                case 2:
                    answers = bus.fast_sync_read(IDS, 208, 18)
                    right = (position.to_bytes(2, "little") * 9)[:18]
                    self.lies += port.flips_only and any(answer.data != right for answer in answers.values())
                case _:
                    state = Servos(bus, IDS, [model] * 3).read()
                    found = state.position[np.isfinite(state.position)] / RAD_PER_COUNT
                    seen = np.round(found).astype(np.int64) & 0xFFFF
                    self.lies += port.flips_only and bool((seen != position).any())
        except BusError:
            pass


class Foot:
    """The foot reader, and what comes to it."""

    def __init__(self) -> None:
        self.cases = 0
        self.clock = LockstepClock(BareServos([servo(1)]))
        self.data = b""
        self.sensor = FootSensor(self, 115_200, self.clock)

    def read(self, size: int) -> bytes:
        data, self.data = self.data[:size], self.data[size:]
        return data

    def close(self) -> None:
        pass

    def case(self, random: Random) -> None:
        """Let some bytes come."""
        self.cases += 1
        good = b"".join(
            encode(Frame(int(random.integers(0, 65_536)), int(random.integers(0, 2**32)), float(random.normal())))
            for _ in range(int(random.integers(1, 5)))
        )
        self.data += noise(random) if random.random() < 0.3 else mutated(good, random)
        for frame in self.sensor.poll():
            if not abs(frame.force) < 2**31:
                raise ValueError(f"force {frame.force}")
        if not self.sensor.age >= 0.0:
            raise ValueError(f"age {self.sensor.age}")


def fuzz(case: Callable[[Random], None], seed: int, seconds: float, most: int) -> tuple[int, Counter[str]]:
    """Try cases until the time is over or there are enough; return how many, and the crashes."""
    crashes: Counter[str] = Counter()
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end and count < most:
        try:
            case(np.random.default_rng([seed, count]))
        except Exception:
            crashes[traceback.format_exc(limit=-2).strip()] += 1
        count += 1
    return count, crashes


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=40.0, help="for each of the three (40)")
    parser.add_argument("--cases", type=int, default=sys.maxsize, help="at most so many for each")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    bad = 0
    driver = Driver()
    for name, target in (("emulator", Line()), ("driver", driver), ("foot reader", Foot())):
        began = time.monotonic()
        count, crashes = fuzz(target.case, options.seed, options.seconds, options.cases)
        lies = driver.lies if target is driver else 0
        took = time.monotonic() - began
        print(f"{name:<12}{count:9} cases in {took:5.1f} s   crashes {crashes.total()}   lies {lies}", flush=True)
        for text, times in crashes.items():
            print(f"{times} times:\n{text}", file=sys.stderr)
        bad += crashes.total() + lies
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
