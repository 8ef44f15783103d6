"""Killed writers, full disks, damaged files, files that are something else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from sleeper import eventually

from robolamp.errors import FileError
from robolamp.log import writer as writer_module
from robolamp.log.mcap_stream import read_contents
from robolamp.log.reader import read_run, read_truth
from robolamp.log.writer import LogWriter

from .ticks import JOINTS, make_tick

HERE = Path(__file__).parent

CHILD = """
import sys, time
from pathlib import Path
sys.path.insert(0, {here!r})
from robolamp.log.writer import LogWriter
from ticks import JOINTS, make_tick
log = LogWriter(Path({path!r}), context={{"goal_m": "0.3", "control_period": "0.02"}}, joints=JOINTS, now=100.0)
begin = time.monotonic()
for index in range(10_000):
    log.tick(make_tick(index))
    print(index, flush=True)
    time.sleep(max(0.0, begin + (index + 1) * 0.02 - time.monotonic()))
"""


@pytest.mark.parametrize("seconds", [0.75, 1.9])
def test_kill_9_loses_at_most_a_second(tmp_path, seconds):
    kill_after(seconds, tmp_path)


@pytest.mark.slow
def test_kill_9_at_fifty_random_moments(tmp_path):
    for index, seconds in enumerate(np.random.default_rng(9).uniform(0.0, 3.0, 50)):
        folder = tmp_path / str(index)
        folder.mkdir()
        kill_after(seconds, folder)


def kill_after(seconds: float, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    code = CHILD.format(here=str(HERE), path=str(path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "0\n"
        time.sleep(seconds)
        os.kill(child.pid, signal.SIGKILL)
        last = int(["0", *child.stdout.read().split()][-1])
    if last < 50:  # killed within the first second: the ticks may all be lost, the context is not
        contents = read_contents(path)
        assert contents.metadata["robolamp"]["goal_m"] == "0.3"
        if not contents.topics:
            return
    run = read_run(path)
    assert run.truncated
    assert run.context["goal_m"] == "0.3"
    assert run.index.tolist() == list(range(run.index.size))
    assert last + 1 - run.index.size <= 50
    np.testing.assert_array_equal(run.goal[-1], make_tick(int(run.index[-1])).goal)


def many_chunks(path: Path, count: int) -> Path:
    period = writer_module.FLUSH_PERIOD
    try:
        writer_module.FLUSH_PERIOD = 0.001  # many small chunks
        with LogWriter(path, context={"goal_m": "0.3"}, joints=JOINTS, now=100.0) as log:
            for index in range(count):
                before = path.stat().st_size
                log.tick(make_tick(index))
                assert eventually(lambda size=before: path.stat().st_size > size)  # a chunk a tick, however busy
    finally:
        writer_module.FLUSH_PERIOD = period
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return many_chunks(tmp_path_factory.mktemp("log") / "run.mcap", 40)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.1, 1.0))
def test_a_cut_anywhere_gives_the_ticks_before_it(tmp_path, whole, share):
    data = whole.read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: int(share * (len(data) - 1))])
    run = read_run(path)
    assert run.truncated
    assert run.index.tolist() == list(range(run.index.size))
    assert run.index.size >= min(40, int(40 * share) - 4)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0.0, 1.0), flip=st.integers(1, 255))
def test_a_damaged_byte_gives_true_ticks_or_one_line(tmp_path, whole, place, flip):
    damaged = bytearray(whole.read_bytes())
    damaged[int(place * (len(damaged) - 1))] ^= flip
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    try:
        run = read_run(path)
    except FileError as error:
        line = str(error)
    else:
        line = str(path)
        for row, index in enumerate(run.index):
            np.testing.assert_array_equal(run.goal[row], make_tick(int(index)).goal)
    assert line.startswith(str(path))
    assert "\n" not in line


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=300), st.booleans())
def test_any_bytes_are_refused_in_one_line(tmp_path, garbage, magic):
    path = tmp_path / "garbage.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + garbage if magic else garbage)
    with pytest.raises(FileError) as caught:
        read_run(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_missing_file_and_a_folder(tmp_path):
    with pytest.raises(FileError, match="No such file"):
        read_run(tmp_path / "none.mcap")
    with pytest.raises(FileError, match="directory"):
        read_run(tmp_path)


def test_a_log_without_ticks_says_what_it_has(tmp_path):
    with LogWriter(tmp_path / "run.mcap", context={}, joints=JOINTS) as log:
        log.event("info", "nothing happened")
    with pytest.raises(FileError, match=r"no /lamp/tick messages; it has /lamp/events"):
        read_run(tmp_path / "run.mcap")
    with pytest.raises(FileError, match=r"no /truth/base messages"):
        read_truth(tmp_path / "run.mcap")


def test_a_strangers_topic_of_the_same_name(tmp_path):
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("other_msgs/msg/Tick", "float64 x\n")
        writer.write_message("/lamp/tick", schema, {"x": 1.0}, 1)
        writer.finish()
    with pytest.raises(FileError, match="other_msgs/msg/Tick, expected robolamp_msgs/msg/Tick"):
        read_run(path)


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be written"):
        LogWriter(tmp_path / "file" / "run.mcap", context={})
    with pytest.raises(FileError, match="cannot be written"):
        LogWriter(tmp_path, context={})


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_at_the_start():
    with pytest.raises(FileError, match="No space left"):
        LogWriter("/dev/full", context={"a": "b"})


@pytest.mark.parametrize("room", [4000, 9000, 40_000])
def test_a_disk_that_fills_up_stops_the_log_and_not_the_run(tmp_path, room):
    path = tmp_path / "run.mcap"
    code = f"""
import resource, signal, sys, threading, time
sys.path.insert(0, {str(HERE)!r})
from robolamp.log import writer
from ticks import JOINTS, make_tick
writer.FLUSH_PERIOD = 0.005
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({room}, {room}))
log = writer.LogWriter({str(path)!r}, context={{}}, joints=JOINTS, now=100.0, lossless=True)
for index in range(10_000):
    log.tick(make_tick(index))
log.close()
print(log.error, "|", index, "|", threading.active_count())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == ""
    assert done.stdout == "File too large | 9999 | 1\n"
    assert path.stat().st_size <= room
    contents = read_contents(path)
    assert not contents.truncated  # it was closed in order, and says why
    with path.open("rb") as stream:
        [event] = [
            decoded
            for _, channel, _, decoded in make_reader(
                stream, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
            if channel.topic == "/lamp/events"
        ]
    assert (event.level, event.text) == ("error", "logging stopped: File too large")
    if room == 40_000:
        run = read_run(path)
        assert run.events[-1][1:] == ("error", "logging stopped: File too large")
        assert run.index.tolist() == list(range(run.index.size))
        assert run.index.size > 50


def test_a_disk_that_is_full_only_when_the_log_is_closed_holds_up_nobody(tmp_path):
    path = tmp_path / "run.mcap"
    code = f"""
import os, resource, sys
sys.path.insert(0, {str(HERE)!r})
from pathlib import Path
from robolamp.log import writer
from ticks import JOINTS, make_tick
writer.FLUSH_PERIOD = 60.0  # one chunk each time, so nearly the same length
def write(count=3):
    log = writer.LogWriter({str(path)!r}, context={{}}, joints=JOINTS, now=100.0, lossless=True)
    for index in range(count):
        log.tick(make_tick(index))
    log.close()
    return log.error
write()
whole = Path({str(path)!r}).stat().st_size
for missing in (50, 200, 1000):  # time stamps are packed to a few bytes more or less
    resource.setrlimit(resource.RLIMIT_FSIZE, (whole - missing, resource.RLIM_INFINITY))
    print(write())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.stderr, done.stdout) == ("", "File too large\n" * 3)


def test_a_disk_that_stalls_holds_up_no_tick_and_is_told_of(tmp_path, monkeypatch):
    monkeypatch.setattr(writer_module, "QUEUE_LENGTH", 20)
    monkeypatch.setattr(writer_module, "FLUSH_PERIOD", 0.01)
    log = LogWriter(tmp_path / "run.mcap", context={}, joints=JOINTS, now=100.0)
    go_on, flush = threading.Event(), log._writer.flush
    monkeypatch.setattr(log._writer, "flush", lambda: (go_on.wait(30.0), flush()))
    count = 0
    while log.dropped < 30:
        log.tick(make_tick(count))
        count += 1
        time.sleep(0.0005)
    dropped = log.dropped
    go_on.set()
    while log._queue.qsize():
        time.sleep(0.001)
    for _ in range(3):
        log.tick(make_tick(count))
        count += 1
    log.close()
    run = read_run(tmp_path / "run.mcap")
    assert log.dropped == dropped == count - run.index.size
    assert run.index[-3:].tolist() == [count - 3, count - 2, count - 1]
    [(_, level, text)] = run.events
    assert (level, text) == ("warning", f"{dropped} log entries dropped: the disk did not keep up")


def test_closing_twice_and_writing_after_leaves_nothing_open(tmp_path):
    threads, files = threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))
    log = LogWriter(tmp_path / "run.mcap", context={}, joints=JOINTS, now=100.0)
    log.tick(make_tick(0))
    log.close()
    log.close()
    log.tick(make_tick(1))
    assert threading.active_count() == threads
    assert len(list(Path("/proc/self/fd").iterdir())) == files
    assert read_run(tmp_path / "run.mcap").index.tolist() == [0]
