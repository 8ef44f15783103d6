"""Writes a log while the lamp runs: the loop hands messages to a thread, which encodes and writes them."""

from __future__ import annotations

import contextlib
import io
import os
import queue
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, DataEnd, Footer, Message, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import MCAP0_MAGIC, Writer

from robolamp.errors import FileError
from robolamp.files import open_new
from robolamp.log.cdr import Encoder
from robolamp.log.schemas import DEFINITIONS, EVENT, JOINT_STATE, LAMP_PREFIX, METADATA, TICK, joint_state, tick_message
from robolamp.signals import Tick

FLUSH_PERIOD = 0.5
"""Longest time between two flushes to the operating system [s]: a killed process loses no more than this."""

QUEUE_LENGTH = 4096
"""Entries (a tick is one) that may wait for the disk: 80 s of ticks at 50 Hz."""


class _Message(NamedTuple):
    topic: str
    schema: str
    content: Mapping[str, Any]
    log_time: int


_PAIRS = 5


def _monotonic_offset() -> int:
    """Return nanoseconds since the epoch at `time.monotonic()` = 0: of several readings the least interrupted one."""
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(_PAIRS)]
    before, wall, after = min(readings, key=lambda reading: reading[2] - reading[0])
    return wall - (before + after) // 2


_CONTEXT = "context"  # in place of a schema: a metadata record
_END: tuple[_Message, ...] = (_Message("", "", {}, 0),)
_EVENTS = f"{LAMP_PREFIX}/events"
_LAST_ID = 0xFFFF  # of schema and channel of the event that closes a log on a full disk: out of the way of the others


class LogWriter:
    """An open log. Never raises once it is open: what goes wrong on the disk is in `error`, and the run goes on.

    Entries wait in a bounded queue; the thread that empties it encodes, compresses and writes them, so that the caller
    never waits for the disk. Where the disk stalls for so long that the queue is full, entries are dropped, and once
    it goes on an event says how many. Where writing fails (a full disk), the log is closed behind the last flush, with
    an event that says why, as a whole MCAP file.

    Args:
        path: The file; missing folders are made, a file or link that is there is replaced.
        context: The run's context, kept as the metadata record "robolamp" (see `robolamp.log.run_context`).
        joints: Joint names, n of them.
        now: The clock of the message times, read at this moment [s]: for a virtual clock. None: times are on
            `time.monotonic()`, the robot's clock, which is matched to the epoch to a few microseconds.
        epoch: Nanoseconds since the epoch at that clock's 0, in place of `now`: for logs that share a virtual clock.
        lossless: Wait for room in the queue instead of dropping messages: for a run in virtual time.

    Attributes:
        path: The file.
        error: Why logging stopped ("No space left on device"); empty while all is well.
        dropped: Entries (a tick is one) that found the queue full.

    Raises:
        FileError: The file cannot be made.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        context: Mapping[str, str],
        joints: Sequence[str] = (),
        now: float | None = None,
        epoch: int | None = None,
        lossless: bool = False,
    ) -> None:
        self.path = Path(path)
        self.error = ""
        self.dropped = 0
        self._joints = list(joints)
        if epoch is not None:
            self._offset = epoch
        else:
            self._offset = _monotonic_offset() if now is None else time.time_ns() - round(now * 1e9)
        self._lossless = lossless
        self._queue: queue.Queue[tuple[_Message, ...]] = queue.Queue(QUEUE_LENGTH)
        self._closed = False
        self._over = False  # whether the thread has met the end of the queue
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.fdopen(open_new(self.path), "wb", buffering=0)
            self._stream = io.BufferedWriter(self._file)
        except OSError as error:
            raise FileError(f"cannot be written: {error.strerror or error}", str(self.path)) from None
        try:
            self._writer = Writer(self._stream)
            self._writer.start("ros2", "robolamp")
            known = {key: value.encode(errors="replace").decode() for key, value in context.items()}  # file names
            self._writer.add_metadata(METADATA, {**known, "epoch_offset_ns": str(self._offset)})
            self._encoders: dict[str, tuple[int, Encoder]] = {}  # with the schema's id
            self._channels: dict[str, int] = {}
            self._told = 0  # of the dropped entries
            self._writer.flush()
            self._flushed = [self._stream.tell()]  # where the last flushes ended
        except OSError as error:
            with contextlib.suppress(OSError):
                self._stream.close()
            raise FileError(f"cannot be written: {error.strerror or error}", str(self.path)) from None
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def log_time(self, seconds: float) -> int:
        """Return a time of the run's clock as nanoseconds since the epoch.

        Args:
            seconds: Time on the clock that the log was opened with [s].
        """
        return self._offset + round(seconds * 1e9)

    def tick(self, tick: Tick, prefix: str = LAMP_PREFIX) -> None:
        """Log one tick: goals, measurements and the rest, three messages.

        Args:
            tick: What happened; copied before this returns.
            prefix: First part of the topics: "/lamp", or "/twin" for a replay.
        """
        seen = tick.observation
        sent, measured = self.log_time(tick.write_done), self.log_time(seen.time)
        goals = joint_state(self._joints, tick.goal.tolist(), log_time=sent)
        states = joint_state(
            self._joints, seen.angle.tolist(), seen.velocity.tolist(), seen.current.tolist(), log_time=measured
        )
        self._put(
            _Message(f"{prefix}/measured", JOINT_STATE, states, measured),
            _Message(f"{prefix}/goals", JOINT_STATE, goals, sent),
            _Message(f"{prefix}/tick", TICK, tick_message(tick), sent),
        )

    def event(self, level: str, text: str, at: float | None = None) -> None:
        """Log something that happened between ticks.

        Args:
            level: "info", "warning" or "error".
            text: One line.
            at: When, on the run's clock [s]; None: now.
        """
        moment = time.time_ns() if at is None else self.log_time(at)
        self._put(_Message(_EVENTS, EVENT, {"level": level, "text": text}, moment))

    def context(self, more: Mapping[str, str]) -> None:
        """Add to the run's context what was not known yet when the log was opened.

        Args:
            more: Texts by name; one that is there already is replaced.
        """
        if more:
            self._put(_Message(METADATA, _CONTEXT, more, 0))

    def message(self, topic: str, schema: str, content: Mapping[str, Any], at: float) -> None:
        """Log a message of any known type.

        Args:
            topic: The topic, as "/truth/base".
            schema: The message type, a key of `robolamp.log.schemas.DEFINITIONS`.
            content: The fields; must not be changed afterwards.
            at: When, on the clock that the log was opened with [s].
        """
        self._put(_Message(topic, schema, content, self.log_time(at)))

    def close(self) -> None:
        """Write what waits, finish the file and end the thread. May be called twice."""
        if self._closed:
            return
        self._closed = True
        self._queue.put(_END)
        self._thread.join()

    def _put(self, *entry: _Message) -> None:
        if self._closed or self.error:
            return
        try:
            self._queue.put(entry, block=self._lossless)
        except queue.Full:
            self.dropped += 1

    def _write(self) -> None:
        try:
            flushed = time.monotonic()
            while (entry := self._next(flushed + FLUSH_PERIOD)) is not _END:
                for message in entry:
                    self._encode(message)
                if self.dropped > self._told and self._queue.qsize() <= self._queue.maxsize // 2:
                    self._tell_dropped()
                if time.monotonic() - flushed >= FLUSH_PERIOD:
                    flushed = time.monotonic()
                    self._writer.flush()
                    self._flushed = [self._flushed[-1], self._stream.tell()]
            self._tell_dropped()
            self._writer.finish()
            self._stream.flush()  # by itself: a close that fails leaves no file to be sealed
            self._stream.close()
        except OSError as error:
            self._give_up(error.strerror or str(error))
        except Exception as error:  # a run must not end because its log cannot be encoded
            self._give_up(f"{type(error).__name__}: {error}")

    def _next(self, deadline: float) -> tuple[_Message, ...]:
        try:
            entry = self._queue.get(timeout=max(0.0, deadline - time.monotonic()))
        except queue.Empty:
            return ()
        self._over = entry is _END
        return entry

    def _encode(self, message: _Message) -> None:
        if message.schema == _CONTEXT:
            self._writer.add_metadata(message.topic, dict(message.content))
            return
        if message.schema not in self._encoders:
            definition = DEFINITIONS[message.schema]
            number = self._writer.register_schema(message.schema, SchemaEncoding.ROS2, definition.encode())
            self._encoders[message.schema] = number, Encoder(definition)
        schema, encoder = self._encoders[message.schema]
        data = encoder.encode(message.content)
        if message.topic not in self._channels:
            self._channels[message.topic] = self._writer.register_channel(message.topic, MessageEncoding.CDR, schema)
        self._writer.add_message(self._channels[message.topic], message.log_time, data, message.log_time)

    def _tell_dropped(self) -> None:
        lost, self._told = self.dropped - self._told, self.dropped
        if lost:
            text = f"{lost} log entries dropped: the disk did not keep up"
            self._encode(_Message(_EVENTS, EVENT, {"level": "warning", "text": text}, time.time_ns()))

    def _give_up(self, reason: str) -> None:
        self.error = reason
        with contextlib.suppress(OSError):
            self._seal(reason)
        with contextlib.suppress(OSError):
            self._file.close()  # past the buffer, whose bytes are part of what could not be written
        while not self._over:  # let nobody wait on a full queue
            self._next(time.monotonic() + FLUSH_PERIOD)

    def _seal(self, reason: str) -> None:
        """Close the file behind the last flush; what half a chunk took up makes room for it, else the last chunk."""
        event = {"level": "error", "text": f"logging stopped: {reason}"}
        ending = RecordBuilder()
        Schema(_LAST_ID, DEFINITIONS[EVENT].encode(), SchemaEncoding.ROS2, EVENT).write(ending)
        Channel(_LAST_ID, _EVENTS, MessageEncoding.CDR, {}, _LAST_ID).write(ending)
        now = time.time_ns()
        Message(_LAST_ID, now, Encoder(DEFINITIONS[EVENT]).encode(event), now, 0).write(ending)
        DataEnd(0).write(ending)
        Footer(0, 0, 0).write(ending)  # no summary
        data = ending.end() + MCAP0_MAGIC
        file = self._file.fileno()
        for place in reversed(self._flushed):
            os.ftruncate(file, place)
            with contextlib.suppress(OSError):
                if os.pwrite(file, data, place) == len(data):
                    return
        os.ftruncate(file, self._flushed[-1])
