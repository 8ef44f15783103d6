"""Fault scripts: what they may say, what they do to packets and servos, and that they repeat."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from contract.backends import LAMP

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.injector import Injector
from robolamp.emulator.faults.script import DAMAGES, Event, Faults, Rates, load_faults
from robolamp.emulator.line.line import Line, Reply
from robolamp.emulator.reality.file import Reality
from robolamp.errors import FileError
from robolamp.foot.protocol import Decoder, Frame

from .parts import Bench, Status, instruction, read, u16, write

IDS = (1, 2, 3)


class Faulty(Bench):
    """Servos on a line on which things go wrong."""

    def __init__(self, rates: dict[str, Rates] | None = None, events: tuple[Event, ...] = (), seed: int = 0) -> None:
        super().__init__(ids=IDS)
        self.injector = Injector(Faults("x", seed, rates or {}, events), IDS, lambda *_: None)
        self.line = Line(self.servos, self.baud, self.advanced.append, injector=self.injector)

    def raw(self, data: bytes) -> list[Reply]:
        self.time += 0.01
        return self.line.feed(data, self.time)


def test_a_packet_dropped_on_its_way_is_not_obeyed() -> None:
    bench = Faulty(events=(Event("dropped", packet=2, packets=2),))
    assert bench.ask(write(1, 65, 1, 1)).error == 0
    assert bench.raw(write(1, 65, 0, 1)) == bench.raw(write(1, 65, 0, 1)) == []
    assert bench.value(65, 1) == 1
    assert [(entry.what, entry.where) for entry in bench.injector.injections] == [
        ("dropped", "instruction 2"),
        ("dropped", "instruction 3"),
    ]


def test_an_answer_dropped_was_obeyed_all_the_same() -> None:
    bench = Faulty(events=(Event("dropped", stream="status", at=0.015),))
    bench.ask(instruction(1, 1))
    assert bench.raw(write(1, 65, 1, 1)) == []
    assert bench.value(65, 1) == 1


def test_the_turn_of_a_dropped_answer_passes() -> None:
    request = instruction(0xFE, 0x82, u16(132) + u16(4) + bytes(IDS))
    due = [reply.due for reply in Faulty().raw(request)]
    dropped = Faulty(events=(Event("dropped", stream="status", packet=2),)).raw(request)
    assert [Status.of(reply.data).id for reply in dropped] == [1, 3]
    assert [reply.due for reply in dropped] == pytest.approx([due[0], due[2]])


def test_a_late_answer_holds_up_what_is_behind_it() -> None:
    request = instruction(0xFE, 0x82, u16(132) + u16(4) + bytes(IDS))
    due = [reply.due for reply in Faulty().raw(request)]
    late = Faulty(events=(Event("late", stream="status", packet=2, lasts=0.004),)).raw(request)
    assert [reply.due for reply in late] == pytest.approx([due[0], due[1] + 0.004, due[2] + 0.004])


def test_a_late_instruction_is_obeyed_late() -> None:
    bench = Faulty(events=(Event("late", packet=1, lasts=0.003),))
    (reply,) = bench.raw(instruction(1, 1))
    assert reply.due == pytest.approx(bench.time + 0.003 + 24e-5)


def test_a_doubled_instruction_is_answered_twice() -> None:
    assert len(Faulty(events=(Event("duplicated", packet=1),)).raw(instruction(1, 1))) == 2


def test_a_truncated_answer_is_the_beginning_of_the_whole() -> None:
    whole = Faulty().raw(read(1, 132, 4))[0].data
    (reply,) = Faulty(events=(Event("truncated", stream="status", packet=1),)).raw(read(1, 132, 4))
    assert 0 < len(reply.data) < len(whole)
    assert whole.startswith(reply.data)


def test_a_truncated_instruction_does_not_swallow_the_next() -> None:
    bench = Faulty(events=(Event("truncated", packet=1),))
    assert bench.raw(write(1, 65, 1, 1)) == []
    assert bench.value(65, 1) == 0


@pytest.mark.parametrize("seed", range(40))
def test_a_corrupted_write_never_sets_anything(seed: int) -> None:
    bench = Faulty(events=(Event("corrupted", packet=1),), seed=seed)
    for reply in bench.raw(write(1, 65, 1, 1)):
        assert Status.of(reply.data).error == 3
    assert [bench.value(65, 1, id=id) for id in IDS] == [0, 0, 0]


def test_rates_are_chances_and_faults_follow_from_seed_and_number_alone() -> None:
    rates = {"instruction": Rates(dropped=0.1, duplicated=0.05, late=0.02)}

    def injected(seed: int, pause: float) -> list[tuple[str, str]]:
        bench = Faulty(rates, seed=seed)
        for _ in range(2000):
            bench.time += pause
            bench.raw(instruction(1, 1))
        return [(entry.what, entry.where) for entry in bench.injector.injections]

    first = injected(1, 0.0)
    assert injected(1, 0.003) == first
    assert injected(2, 0.0) != first
    count = Counter(what for what, _ in first)
    assert 150 < count["dropped"] < 250
    assert 65 < count["duplicated"] < 140
    assert 15 < count["late"] < 70
    assert set(count) == {"dropped", "duplicated", "late"}


def test_a_silent_servo_leaves_the_others_alone() -> None:
    bench = Faulty(events=(Event("silent", at=0.015, servo=2, lasts=0.02),))
    ping = instruction(0xFE, 1)
    heard = [[status.id for status in bench.send(ping)] for _ in range(4)]
    assert heard == [[1, 2, 3], [1, 3], [1, 3], [1, 2, 3]]
    assert [(entry.time, entry.what) for entry in bench.injector.injections] == [
        (0.015, "silent"),
        (0.035, "silent over"),
    ]


def lamp(*events: Event) -> EmulatedLamp:
    assets = Assets()
    return EmulatedLamp(LAMP, load_calibration(assets), assets, Reality.none(LAMP), faults=Faults("x", 0, {}, events))


def ask(world: EmulatedLamp, data: bytes, time: float) -> list[Status]:
    world.advance_to(time)
    return [Status.of(reply.data) for reply in world.receive(data, time)]


def test_a_servo_reboots_into_silence_and_forgets_its_ram() -> None:
    world = lamp(Event("reboot", at=0.5, servo=2))
    assert ask(world, write(2, 65, 1, 1), 0.4)[0].error == 0
    assert ask(world, read(2, 65, 1), 0.51) == []
    assert ask(world, read(2, 65, 1), 1.5)[0].data == b"\x00"


def test_a_servo_that_loses_its_id_answers_with_another() -> None:
    world = lamp(Event("id_lost", at=0.5, servo=3, id=9))
    assert [status.id for status in ask(world, instruction(0xFE, 1), 0.4)] == [1, 2, 3]
    assert [status.id for status in ask(world, instruction(0xFE, 1), 0.6)] == [1, 2, 9]


def test_a_servo_that_gets_anothers_id_is_heard_together_with_it() -> None:
    world = lamp(Event("id_lost", at=0.5, servo=3, id=1))
    world.receive(write(1, 24, 5, 4), 0.4)
    assert [status.id for status in ask(world, instruction(0xFE, 1), 0.6)] == [1, 2]  # the very same answer
    world.advance_to(0.7)
    (garbled,) = world.receive(read(1, 24, 4), 0.7)
    with pytest.raises(AssertionError):
        Status.of(garbled.data)


def test_an_overload_takes_the_torque_and_raises_the_alert() -> None:
    world = lamp(Event("overload", at=0.5, servo=2))
    assert ask(world, write(2, 64, 1, 1), 0.4)[0].error == 0
    answer = ask(world, read(2, 64, 7), 0.6)[0]
    assert answer.error == 0x80
    assert (answer.data[0], answer.data[6]) == (0, 0x20)
    assert ask(world, read(1, 64, 7), 0.6)[0].error == 0


def test_a_sag_is_seen_in_the_voltage_and_felt_in_the_motor() -> None:
    world = lamp(Event("sag", at=0.5, volts=1.0, lasts=0.5))
    volts = [ask(world, read(1, 144, 2), time)[0].data[0] for time in (0.4, 0.7, 1.2)]
    assert volts[1] == volts[0] - 10
    assert volts[2] == volts[0]


def foot(*events: Event, until: float = 1.0) -> tuple[list[Frame], Decoder]:
    world, decoder = lamp(*events), Decoder()
    world.advance_to(until)
    return decoder.feed(world.frames(until)), decoder


def test_a_silent_foot_misses_frames() -> None:
    frames, decoder = foot(Event("foot_silent", at=0.4, lasts=0.2))
    assert decoder.lost == pytest.approx(100, abs=2)
    gap = max(later.time - earlier.time for earlier, later in pairwise(frames))
    assert gap == pytest.approx(200_000, abs=5_000)


def test_a_stuck_foot_repeats_itself_in_fresh_frames() -> None:
    noisy = replace(Reality.none(LAMP), foot_noise=0.05)
    assets = Assets()
    faults = Faults("x", 0, {}, (Event("foot_stuck", at=0.4, lasts=0.2),))
    world, decoder = EmulatedLamp(LAMP, load_calibration(assets), assets, noisy, faults=faults), Decoder()
    world.advance_to(1.0)
    frames = decoder.feed(world.frames(1.0))
    during = {frame.force for frame in frames if 402_000 <= frame.time < 598_000}
    assert len(during) == 1
    assert len({frame.force for frame in frames if frame.time < 398_000}) > 50
    assert decoder.lost == 0


def test_a_rubbish_foot_sends_nothing_that_is_a_frame() -> None:
    frames, decoder = foot(Event("foot_rubbish", at=0.4, lasts=0.2))
    assert decoder.lost == pytest.approx(100, abs=2)
    assert decoder.discarded >= 1500
    assert all(0.0 <= frame.force < 20.0 for frame in frames)


FULL = """
name = "full"
seed = 3
[instruction]
dropped = 0.1
late = 0.2
late_by = 0.002
[foot]
corrupted = 0.5
[[event]]
what = "silent"
at = 1
lasts = 0.5
servo = 2
[[event]]
what = "dropped"
packet = 7
packets = 3
stream = "status"
[[event]]
what = "unplugged"
at = 2.0
lasts = 1.0
port = "foot"
"""


def load(tmp_path: Path, text: str, *, foot: bool = True) -> Faults:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load_faults(path, IDS, foot=foot)


def test_a_script_is_read(tmp_path: Path) -> None:
    faults = load(tmp_path, FULL)
    assert faults.rates["instruction"] == Rates(dropped=0.1, late=0.2, late_by=0.002)
    assert faults.rates["foot"].corrupted == 0.5
    assert faults.events == (
        Event("silent", at=1.0, lasts=0.5, servo=2),
        Event("dropped", packet=7, packets=3, stream="status"),
        Event("unplugged", at=2.0, lasts=1.0, port="foot"),
    )
    assert faults.unplugs
    assert not load(tmp_path, 'name = "quiet"\n').unplugs
    assert not any(getattr(Rates(), damage) for damage in DAMAGES)


EVENT = 'name = "x"\n[[event]]\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("seed = 1\n", "name: missing"),
        ('name = "x"\nspeed = 1\n', "speed: unknown"),
        ('name = "x"\n[status]\ndropped = 1.5\n', "status.dropped: 1.5 is not a number from 0 to 1"),
        ('name = "x"\n[status]\ndropped = 0.6\nlate = 0.6\n', "all chances together are 1.2"),
        ('name = "x"\n[status]\nlost = 0.6\n', "status.lost: unknown"),
        (EVENT + 'what = "melts"\nat = 1\n', "event[0].what: 'melts' is not one of dropped"),
        (EVENT + 'what = "silent"\nat = 1\nlasts = 1\nservo = 9\n', "event[0].servo: 9 is not one of 1, 2, 3"),
        (EVENT + 'what = "silent"\nat = 1\nservo = 1\n', "event[0].lasts: missing"),
        (EVENT + 'what = "dropped"\n', "event[0].at: missing"),
        (EVENT + 'what = "dropped"\nat = 1\npacket = 2\n', "event[0].at: unknown"),
        (EVENT + 'what = "unplugged"\nat = 1\nlasts = 1\nport = "usb"\n', "'usb' is not one of servo, foot"),
        ('name = "x"\nevent = 3\n', "event: expected one or more tables"),
    ],
)
def test_a_bad_script_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(FileError, match=r"mine\.toml") as failure:
        load(tmp_path, text)
    assert says in str(failure.value)
    assert "\n" not in str(failure.value)


def test_without_a_lamp_there_is_no_foot_to_fail(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="names the foot sensor"):
        load(tmp_path, FULL, foot=False)
    with pytest.raises(FileError, match="names the foot sensor"):
        load(tmp_path, EVENT + 'what = "foot_stuck"\nat = 1\nlasts = 1\n', foot=False)
