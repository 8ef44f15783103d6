"""Instructions of protocol 2.0 that the servos take together, or one after another."""

from __future__ import annotations

import pytest
from dynamixel_sdk import COMM_SUCCESS, Protocol2PacketHandler
from hypothesis import example, given
from hypothesis import strategies as st

from robolamp.dynamixel.registers import MODELS, Name
from robolamp.emulator.packet import crc16, fast_status

from .bench import MotorBench
from .parts import Bench, Status, instruction, read, sdk_crc, u16, write

RESULT, INSTRUCTION, RANGE, LENGTH, LIMIT, ACCESS = 1, 2, 4, 5, 6, 7
BYTE = 1e-5


class Received:
    """A port of the SDK's kind on which bytes have already arrived."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.is_using = False

    def readPort(self, length: int) -> bytes:
        taken, self.data = self.data[:length], self.data[length:]
        return taken

    def isPacketTimeout(self) -> bool:
        return not self.data


class TestRegWrite:
    def test_it_waits_for_action(self) -> None:
        bench = Bench(ids=(1, 2))
        before = bench.value(116, 4)
        for id in (1, 2):
            assert bench.ask(instruction(id, 0x04, u16(116) + (1234).to_bytes(4, "little"))).error == 0
        assert (bench.value(69, 1), bench.value(116, 4)) == (1, before)
        assert bench.send(instruction(0xFE, 0x05)) == []
        assert [(bench.value(69, 1, id), bench.value(116, 4, id)) for id in (1, 2)] == [(0, 1234), (0, 1234)]

    def test_action_without_it_is_an_instruction_error(self) -> None:
        assert Bench().ask(instruction(1, 0x05)).error == INSTRUCTION

    def test_what_cannot_be_written_is_not_registered(self) -> None:
        bench = Bench()
        assert bench.ask(instruction(1, 0x04, u16(116) + (9999).to_bytes(4, "little"))).error == LIMIT
        assert bench.ask(instruction(1, 0x04, b"\x01")).error == LENGTH
        assert bench.value(69, 1) == 0
        assert bench.ask(instruction(1, 0x05)).error == INSTRUCTION

    def test_what_has_become_illegal_is_refused_at_the_action(self) -> None:
        bench = Bench()
        bench.ask(instruction(1, 0x04, u16(9) + b"\x05"))
        bench.ask(write(1, 64, 1, 1))
        assert bench.ask(instruction(1, 0x05)).error == ACCESS
        assert bench.value(9, 1) == 0

    def test_a_reboot_forgets_it(self) -> None:
        bench = Bench()
        bench.ask(instruction(1, 0x04, u16(65) + b"\x01"))
        bench.ask(instruction(1, 0x08))
        bench.time += 0.5
        assert bench.ask(instruction(1, 0x05)).error == INSTRUCTION


class TestFactoryReset:
    def reset(self, option: bytes, to: int = 9) -> Bench:
        bench = Bench(ids=(9,))
        bench.ask(write(9, 52, 77, 4))
        bench.send(instruction(to, 0x06, option))
        bench.time += 0.5
        return bench

    @pytest.mark.parametrize(("option", "id", "baud"), [(0xFF, 1, 57600), (0x01, 9, 57600), (0x02, 9, 1_000_000)])
    def test_what_each_option_keeps(self, option: int, id: int, baud: int) -> None:
        bench = self.reset(bytes([option]))
        bench.line.baud = baud
        assert bench.value(52, 4, id) == 0
        assert bench.value(9, 1, id) == -6  # 250
        assert bench.value(6, 1, id) == 52

    def test_not_all_servos_at_once_to_the_same_id(self) -> None:
        assert self.reset(b"\xff", to=0xFE).value(52, 4, 9) == 77

    def test_all_servos_at_once_but_for_the_id(self) -> None:
        assert self.reset(b"\x02", to=0xFE).value(52, 4, 9) == 0

    @pytest.mark.parametrize(("parameters", "error"), [(b"", LENGTH), (b"\xff\xff", LENGTH), (b"\x03", RANGE)])
    def test_refused(self, parameters: bytes, error: int) -> None:
        assert Bench().ask(instruction(1, 0x06, parameters)).error == error


class TestBulk:
    def test_each_servo_answers_its_own_read_in_turn(self) -> None:
        bench = Bench(ids=(1, 2))
        asked = b"\x02" + u16(144) + u16(2) + b"\x01" + u16(146) + u16(1)
        assert bench.send(instruction(0xFE, 0x92, asked)) == [Status(2, 0, b"\x32\x00"), Status(1, 0, b"\x1e")]

    def test_an_absent_servo_is_waited_for(self) -> None:
        bench = Bench(ids=(1,))
        request = instruction(0xFE, 0x92, b"\x07" + u16(132) + u16(4) + b"\x01" + u16(146) + u16(1))
        (reply,) = bench.line.feed(request, 0.0)
        assert reply.due == pytest.approx((len(request) + 15 + 12) * BYTE)

    def test_each_servo_takes_its_own_write(self) -> None:
        bench = Bench(ids=(1, 2))
        blocks = b"\x01" + u16(116) + u16(4) + (1500).to_bytes(4, "little") + b"\x02" + u16(65) + u16(1) + b"\x01"
        assert bench.send(instruction(0xFE, 0x93, blocks)) == []
        assert (bench.value(116, 4, 1), bench.value(65, 1, 2), bench.value(65, 1, 1)) == (1500, 1, 0)

    @pytest.mark.parametrize("cut", range(1, 10))
    def test_a_malformed_bulk_write_changes_nothing(self, cut: int) -> None:
        bench = Bench()
        block = b"\x01" + u16(65) + u16(1) + b"\x01"
        assert bench.send(instruction(0xFE, 0x93, (block + b"\x01" + u16(116) + u16(4) + b"abcd")[:-cut])) == []
        assert bench.value(65, 1) == (1 if cut == 9 else 0)

    @pytest.mark.parametrize("parameters", [b"", b"\x01", b"\x01\x84\x00\x04"])
    @pytest.mark.parametrize("code", [0x92, 0x9A, 0x82, 0x8A])
    def test_a_malformed_read_gets_no_answer(self, code: int, parameters: bytes) -> None:
        assert Bench().send(instruction(0xFE, code, parameters)) == []


class TestFastRead:
    @staticmethod
    def sync(*ids: int) -> bytes:
        return instruction(0xFE, 0x8A, u16(132) + u16(4) + bytes(ids))

    def test_one_packet_for_all_with_running_crcs(self) -> None:
        bench = Bench(ids=(3, 7, 4))
        request = self.sync(3, 7, 4)
        (reply,) = bench.line.feed(request, 0.0)
        raw = reply.data
        assert raw[:8] == bytes.fromhex("FF FF FD 00 FE 19 00 55")
        assert len(raw) == 7 + 0x19
        assert reply.due == pytest.approx((len(request) + len(raw)) * BYTE)
        position = round(3.0 / (2 * 3.14159265 / 4096)).to_bytes(4, "little")
        for index, id in enumerate((3, 7, 4)):
            block = raw[8 + 8 * index : 16 + 8 * index]
            assert block[:6] == bytes([0, id]) + position
            assert block[6:] == sdk_crc(raw[: 14 + 8 * index])

    def test_the_makers_code_reads_it(self) -> None:
        bench = Bench(ids=(1, 2))
        (reply,) = bench.line.feed(self.sync(1, 2), 0.0)
        data, result, error = Protocol2PacketHandler().fastSyncReadRx(Received(reply.data), 0xFE, 2 * (4 + 4))
        assert (result, error) == (COMM_SUCCESS, 0)
        assert [data[1], data[9]] == [1, 2]

    def test_the_makers_code_reads_a_bulk_one(self) -> None:
        bench = Bench(ids=(1, 2))
        asked = [2, 144, 0, 2, 0, 1, 146, 0, 1, 0]
        (reply,) = bench.line.feed(instruction(0xFE, 0x9A, bytes(asked)), 0.0)
        data, result = Protocol2PacketHandler().fastBulkReadRx(Received(reply.data), asked)
        assert result == COMM_SUCCESS
        assert {id: bytes(values) for id, values in data.items()} == {2: b"\x32\x00", 1: b"\x1e"}

    def test_an_absent_servo_breaks_the_chain(self) -> None:
        bench = Bench(ids=(1, 3))
        (reply,) = bench.line.feed(self.sync(1, 2, 3), 0.0)
        assert len(reply.data) == 8 + 8
        assert reply.data[5] == 0x19  # the length of all three was promised
        assert bench.line.feed(self.sync(2, 1), 1.0) == []

    def test_a_servo_that_may_not_answer_breaks_it_too(self) -> None:
        bench = Bench(ids=(1, 2))
        bench.ask(write(2, 68, 0, 1))
        (reply,) = bench.line.feed(self.sync(1, 2), 1.0)
        assert len(reply.data) == 16

    def test_a_refused_block_keeps_its_length(self) -> None:
        bench = Bench()
        (reply,) = bench.line.feed(instruction(0xFE, 0x8A, u16(300) + u16(4) + b"\x01"), 0.0)
        assert reply.data[8:14] == bytes([ACCESS, 1, 0, 0, 0, 0])

    @given(
        st.lists(st.tuples(st.integers(0, 252), st.integers(0, 255), st.binary(max_size=20)), min_size=1, max_size=5)
    )
    def test_every_block_can_be_checked_alone(self, blocks: list[tuple[int, int, bytes]]) -> None:
        raw = fast_status([len(data) for _, _, data in blocks], blocks)
        assert int.from_bytes(raw[5:7], "little") == len(raw) - 7
        at = 8
        for id, error, data in blocks:
            assert raw[at : at + 2 + len(data)] == bytes([error, id]) + data
            at += 2 + len(data)
            assert raw[at : at + 2] == crc16(raw[:at]).to_bytes(2, "little") == sdk_crc(raw[:at])
            at += 2


class TestIndirect:
    def map(self, bench: Bench, address: int, places: list[int]) -> None:
        for index, place in enumerate(places):
            assert bench.ask(write(1, address + 2 * index, place, 2)).error == 0

    @pytest.mark.parametrize(
        ("model", "address", "data"),
        [
            ("XL330-M288-T", 168, 208),
            ("XL330-M077-T", 168, 208),
            ("XL430-W250-T", 168, 224),
            ("XL430-W250-T", 578, 634),
        ],
    )
    def test_scattered_registers_are_read_at_once(self, model: str, address: int, data: int) -> None:
        bench = Bench(model=model)
        assert bench.value(address, 2) == data
        self.map(bench, address, [132, 133, 134, 135, 144, 145, 146, 70])
        (answer,) = bench.send(read(1, data, 8))
        assert answer.data == bench.ask(read(1, 132, 4)).data + b"\x32\x00" + b"\x1e" + b"\x00"

    def test_it_writes_what_it_is_mapped_to(self) -> None:
        bench = Bench()
        self.map(bench, 168, [65, 116, 117, 118, 119])
        assert bench.ask(instruction(1, 0x03, u16(208) + b"\x01" + (1700).to_bytes(4, "little"))).error == 0
        assert (bench.value(65, 1), bench.value(116, 4)) == (1, 1700)

    def test_the_rules_of_the_register_hold(self) -> None:
        bench = Bench()
        self.map(bench, 168, [116, 117, 118, 119, 132, 84])
        assert bench.ask(write(1, 208, 5000, 4)).error == LIMIT
        assert bench.ask(write(1, 208, 0, 2)).error == LENGTH
        assert bench.ask(write(1, 212, 0, 1)).error == ACCESS
        assert bench.ask(write(1, 213, 0, 1)).error == LENGTH

    @pytest.mark.parametrize(("place", "error"), [(63, RANGE), (228, RANGE), (64, 0), (227, 0)])
    def test_only_ram_can_be_mapped(self, place: int, error: int) -> None:
        assert Bench().ask(write(1, 168, place, 2)).error == error

    def test_half_an_address_is_refused(self) -> None:
        bench = Bench()
        assert bench.ask(write(1, 168, 65, 1)).error == LENGTH
        assert bench.ask(write(1, 169, 65, 2)).error == ACCESS

    def test_unmapped_it_is_memory(self) -> None:
        bench = Bench()
        assert bench.ask(instruction(1, 0x03, u16(210) + b"abc")).error == 0
        assert bench.ask(read(1, 209, 5)).data == b"\0abc\0"

    def test_a_reboot_forgets_the_map(self) -> None:
        bench = Bench()
        self.map(bench, 168, [65])
        bench.ask(instruction(1, 0x08))
        bench.time += 0.5
        assert bench.value(168, 2) == 208

    def test_nothing_is_written_where_one_register_is_refused(self) -> None:
        bench = Bench()
        self.map(bench, 168, [65, 132])
        assert bench.ask(instruction(1, 0x03, u16(208) + b"\x01\x01")).error == ACCESS
        assert bench.value(65, 1) == 0


def test_no_bytes_move_a_goal_that_they_did_not_ask_for() -> None:
    """Damaged copies of a write: each is refused, ignored, or is the write itself."""
    whole = write(1, 116, 3000, 4)
    for at in range(len(whole)):
        for bit in range(8):
            bench = MotorBench()
            bench.set(torque_enable=1)
            before = bench.get(Name.GOAL_POSITION)
            damaged = bytearray(whole)
            damaged[at] ^= 1 << bit
            bench.line.feed(bytes(damaged), bench.time)
            bench.time += 1.0
            assert bench.get(Name.GOAL_POSITION) == before


INSTRUCTIONS = st.builds(
    instruction,
    st.sampled_from([1, 2, 0xFE]),
    st.sampled_from([1, 2, 3, 4, 5, 6, 8, 16, 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A, 0x20, 0x55]),
    st.one_of(
        st.binary(max_size=30),
        st.builds(lambda address, data: u16(address) + data, st.integers(0, 240), st.binary(max_size=12)),
        st.builds(
            lambda id, address, data: bytes([id]) + u16(address) + u16(len(data)) + data,
            st.integers(0, 3),
            st.integers(0, 240),
            st.binary(max_size=12),
        ),
    ),
)


@pytest.mark.parametrize("model", MODELS)
@given(st.lists(st.one_of(INSTRUCTIONS, st.binary(max_size=40)), max_size=12))
@example([instruction(254, 138, b"\x00\x00\x00\x56\x01\x00\x00")])  # a fast read of more than a packet holds
def test_no_packets_break_a_servo(model: str, chunks: list[bytes]) -> None:
    bench = MotorBench(model)
    for chunk in chunks:
        for reply in bench.line.feed(chunk, bench.time):
            assert reply.data[:4] == b"\xff\xff\xfd\x00"
        bench.run(0.003)
        bench.time += 0.3
        drive = bench.servo.drive()
        assert drive.duty is None or -1.0 <= drive.duty <= 1.0
        assert abs(bench.motor.velocity) < 100
    for register in bench.model.registers.values():  # whatever was written is inside what may be written
        value = bench.servo.register(register.name)
        if register.writable and register.low is not None and register.high is not None:
            assert register.low <= value <= register.high or (register.name, value) == (Name.BUS_WATCHDOG, -1)
