"""More bytes at once than the line carries in a tick: a client has to wait for it, and it is never deaf for longer."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
import serial
from sleeper import bears, waited

from robolamp.emulator.packet import HEADER

from .parts import Bench, Status, instruction, read
from .test_process import emulator, frames

BAUD = 1_000_000
FLOOD = 300_000  # bytes: 3 s on the line
BYTE = 10 / BAUD
PATIENCE = 30.0  # s: an answer comes, on a busy machine late
PING = instruction(1, 0x01)
MUTE = instruction(99, 0x01)  # to a servo that is not there
NESTED = HEADER + bytes([1, 0x00, 0x10])  # each begins a packet of 4096 bytes


def floods() -> dict[str, bytes]:
    rubbish = np.random.default_rng(1).bytes(FLOOD)
    found = {
        "zeros": bytes(FLOOD),
        "ones": b"\xff" * FLOOD,
        "rubbish": rubbish,
        "headers": NESTED * (FLOOD // len(NESTED)),
        "nobody's packets": MUTE * (FLOOD // len(MUTE)),
    }
    return found


@dataclass(frozen=True)
class Emulator:
    """An emulated lamp in a process of its own."""

    pid: int
    servo_port: str
    foot_port: str

    @property
    def late(self) -> float:
        """How long it, and this process that asks it, have waited for a processor so far [s]."""
        return waited(self.pid) + waited(os.getpid())


def answers(port: serial.Serial) -> bool:
    """Whether a ping is answered at once."""
    port.timeout = 0.1
    port.reset_input_buffer()
    port.write(PING)
    answer = port.read(14)
    return len(answer) == 14 and answer.startswith(HEADER + bytes([1, 7, 0, 0x55, 0]))  # of servo 1, without error


@pytest.fixture(scope="module")
def lamp() -> Iterator[Emulator]:
    with emulator("--reality", "none") as (process, ready):
        yield Emulator(process.pid, str(ready["servo_port"]), str(ready["foot_port"]))


@pytest.mark.parametrize("kind", floods())
def test_a_flood_takes_its_time_on_the_line_and_no_longer(lamp: Emulator, kind: str) -> None:
    data = floods()[kind]
    heard = bytearray()
    with (
        serial.Serial(lamp.servo_port, BAUD, timeout=PATIENCE) as port,
        serial.Serial(lamp.foot_port, 115_200, timeout=0.05) as foot,
    ):
        foot.reset_input_buffer()
        listening = threading.Event()
        listening.set()

        def listen() -> None:
            while listening.is_set():
                heard.extend(foot.read(64))

        listener = threading.Thread(target=listen)
        listener.start()
        try:
            begun, late = time.monotonic(), lamp.late
            port.write(data)
            written = time.monotonic() - begun
            over = begun + max(written, len(data) * BYTE + 0.1)
            time.sleep(max(0.0, over - time.monotonic()))
            while not answers(port) and time.monotonic() < over + PATIENCE:
                pass
            deaf = time.monotonic() - over - (lamp.late - late)
        finally:
            listening.clear()
            listener.join()
    assert deaf < 0.1
    assert written > 0.6 * len(data) * BYTE  # the terminal's own buffers took what they hold
    assert len(frames(bytes(heard))) > 0.8 * written * 500  # and nothing else stood still


@bears(0.005)
def test_a_packet_after_a_silence_is_heard_though_another_was_begun(lamp: Emulator) -> None:
    """A client that tries again sooner than an unfinished packet is given up is not deaf to the answers."""
    with serial.Serial(lamp.servo_port, BAUD, timeout=1.0) as port:
        port.reset_input_buffer()
        late = lamp.late
        port.write(NESTED)
        time.sleep(0.01)
        asked = time.monotonic()
        port.write(PING)
        assert len(port.read(14)) == 14
        assert time.monotonic() - asked - (lamp.late - late) < 0.03


@bears(0.005)
def test_a_packet_written_in_two_halves_is_one(lamp: Emulator) -> None:
    with serial.Serial(lamp.servo_port, BAUD, timeout=1.0) as port:
        request = read(1, 132, 4)
        port.write(request[:6])
        time.sleep(0.01)
        port.write(request[6:])
        assert len(port.read(15)) == 15


@bears(0.005)  # a packet whose halves are read a silence apart is none
def test_packets_that_were_written_while_it_stood_still_are_all_answered(lamp: Emulator) -> None:
    with serial.Serial(lamp.servo_port, BAUD, timeout=5.0) as port:
        port.reset_input_buffer()
        port.write(PING * 200)
        assert len(port.read(14 * 200)) == 14 * 200


def test_a_stream_of_headers_costs_no_more_than_its_length() -> None:
    bench = Bench()
    begun = time.process_time()
    bench.line.feed(NESTED * 20_000, 0.0)
    assert time.process_time() - begun < 20_000 * len(NESTED) * BYTE  # as long as it is on the line
    assert [Status.of(reply.data).id for reply in bench.line.feed(PING, 10.0)] == [1]
