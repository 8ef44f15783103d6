from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robolamp.emulator.foot_sensor import FRAME_SIZE, FootSensor, crc16_ccitt, frame


def bitwise_crc(data: bytes) -> int:
    value = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            carry = (value >> 15) ^ (byte >> bit & 1)
            value = (value << 1 & 0xFFFF) ^ (0x1021 if carry else 0)
    return value


def test_the_specifications_check_value() -> None:
    assert crc16_ccitt(b"123456789") == 0x29B1


def test_the_specifications_example() -> None:
    raw = frame(1, 0.002, 2.06)
    assert raw[:14] == bytes.fromhex("AA 55 0B 01 00 D0 07 00 00 0C 08 00 00 00")
    assert len(raw) == FRAME_SIZE


@given(st.integers(0, 10**6), st.floats(0, 10**6), st.floats(-(10.0**7), 10.0**7))
def test_every_field_is_where_the_specification_says(sequence: int, time: float, force: float) -> None:
    raw = frame(sequence, time, force)
    assert raw[:3] == b"\xaa\x55\x0b"
    assert int.from_bytes(raw[3:5], "little") == sequence % 65536
    assert int.from_bytes(raw[5:9], "little") == round(time * 1e6) % 2**32
    millinewtons = int.from_bytes(raw[9:13], "little", signed=True)
    saturated = abs(round(force * 1000)) > 2**31 - 1
    assert raw[13] == saturated
    assert saturated or millinewtons == round(force * 1000)
    assert int.from_bytes(raw[14:16], "little") == bitwise_crc(raw[2:14])


def test_it_samples_at_500_hz_whatever_the_steps_are() -> None:
    sensor = FootSensor(gain=2.0, noise=lambda: 0.5)
    frames = [item for step in range(1, 101) for item in sensor.sample(1.0, step * 0.005)]
    assert len(frames) == 251
    assert [moment for moment, _ in frames[:3]] == [0.0, 0.002, 0.004]
    assert int.from_bytes(frames[-1][1][9:13], "little") == 2500
