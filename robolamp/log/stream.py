"""Reads the records of an MCAP file as far as they are whole: after kill -9, and past damage where one asks for it."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream

from robolamp.errors import FileError
from robolamp.log.cdr import LayoutError, decode

_MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
# How a chunk's compression reads, and how far from its record's begin: opcode, length, two times, size and checksum.
_MARKS, _MARK_OFFSET = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4"), 9 + 8 + 8 + 8 + 4


@dataclass
class Contents:
    """What a file holds.

    Attributes:
        path: The file.
        size: Its length [bytes].
        metadata: Metadata records by name.
        schemas: Schemas by id.
        channels: Channels by id.
        times: Log times of each channel's messages [ns since the epoch], by its id.
        data: Their bytes, by the channel's id.
        order: The channel of every message, in file order.
        chunks: How many chunks were whole.
        truncated: Whether the file ends early or is damaged.
        damage: What is wrong with it, one line a place: where [byte] and what.
    """

    path: Path
    size: int = 0
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    times: dict[int, list[int]] = field(default_factory=dict)
    data: dict[int, list[bytes]] = field(default_factory=dict)
    order: list[int] = field(default_factory=list)
    chunks: int = 0
    truncated: bool = False
    damage: list[str] = field(default_factory=list)

    @property
    def topics(self) -> dict[str, int]:
        """How many messages each topic has."""
        counts: dict[str, int] = {}
        for number, channel in self.channels.items():
            if self.data.get(number):
                counts[channel.topic] = counts.get(channel.topic, 0) + len(self.data[number])
        return counts

    def has(self, topic: str, kind: str) -> bool:
        """Whether there are messages of a type on a topic.

        Args:
            topic: The topic.
            kind: The message type.
        """
        return any(self.data.get(number) and self._kind(number) == kind for number in self._channels_of(topic))

    def _channels_of(self, topic: str) -> list[int]:
        return [number for number, channel in self.channels.items() if channel.topic == topic]

    def _kind(self, channel: int) -> str:
        schema = self.schemas.get(self.channels[channel].schema_id)
        return schema.name if schema else "no type"

    def topic(self, name: str, kind: str, *wanted: str, first: Sequence[str] = ()) -> tuple[list[int], dict[str, Any]]:
        """Return a topic's messages, decoded.

        Args:
            name: The topic.
            kind: The message type it must have.
            wanted: Names of the fields to return.
            first: Names of those of which the first message's is enough.

        Returns:
            Log times [ns since the epoch], and the fields as columns (see `robolamp.log.cdr.decode`).

        Raises:
            FileError: The topic is missing, holds messages of another type, or cannot be decoded.
        """
        channels = [number for number in self._channels_of(name) if self.data.get(number)]
        if not channels:
            topics = ", ".join(sorted(self.topics)) or "no topics at all"
            raise FileError(f"holds no {name} messages; it has {topics}", str(self.path))
        times, data = [], []
        for number in channels:
            if self._kind(number) != kind:
                raise FileError(f"{name} holds {self._kind(number)}, expected {kind}", str(self.path))
            times += self.times[number]
            data += self.data[number]
        definition = self.schemas[self.channels[channels[0]].schema_id].data.decode(errors="replace")
        try:
            columns = decode(definition, data, wanted)
            columns |= decode(definition, data[:1], first)
        except LayoutError as error:
            raise FileError(f"{name}: {error}", str(self.path)) from None
        return times, columns


def read_contents(path: Path, *, salvage: bool = False) -> Contents:
    """Read every whole record of a log.

    Args:
        path: The log.
        salvage: Go on after a damaged place with the next whole chunk; otherwise what is returned came before it.

    Raises:
        FileError: The file cannot be read, or is not MCAP.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror or error}", str(path)) from None
    if not data.startswith(_MAGIC):
        raise FileError("is not an MCAP log (it does not begin with the MCAP magic)", str(path))
    contents = Contents(path, len(data))
    position, finished = len(_MAGIC), False
    while not (finished and position == len(data) - len(_MAGIC) and data.endswith(_MAGIC)):
        try:
            following, finished = _take(data, position, contents)
            position = following
        except Exception as error:  # whatever damaged bytes make the decoders raise: what came before is whole
            contents.truncated = True
            contents.damage.append(f"byte {position}: {_said(error)}")
            found = _next_chunk(data, position + 1) if salvage else -1
            if found < 0:
                break
            position, finished = found, False
    return contents


class _CutError(Exception):
    """A record that the file does not hold in whole."""


def _said(error: Exception) -> str:
    return str(error) if isinstance(error, _CutError) else f"a damaged record ({type(error).__name__})"


def _take(data: bytes, position: int, contents: Contents) -> tuple[int, bool]:
    """Take in the record at a position; returns where the next one begins, and whether this was the last."""
    begin = position + _RECORD.size
    if begin > len(data):
        raise _CutError("the file ends early")
    opcode, length = _RECORD.unpack_from(data, position)
    following = begin + length
    if following > len(data):
        raise _CutError("the file ends early, in the middle of a record")
    if not Opcode.HEADER <= opcode < 0x80:  # from 0x80 on they are anybody's
        raise _CutError("no record begins here")
    read = _READERS.get(opcode)
    if read is not None:
        read(data[begin:following], contents)
    return following, opcode == Opcode.FOOTER


def _chunk(data: bytes, contents: Contents) -> None:
    stream, length = get_chunk_data_stream(Chunk.read(ReadDataStream(io.BytesIO(data))), validate_crc=True)
    inner = stream.read(length)
    schemas, channels, found = {}, {}, []
    position = 0
    while position < length:
        opcode, size = _RECORD.unpack_from(inner, position)
        position += _RECORD.size
        end = position + size
        if opcode == Opcode.MESSAGE:
            number, _, log_time, _ = _MESSAGE.unpack_from(inner, position)
            found.append((number, log_time, inner[position + _MESSAGE.size : end]))
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(io.BytesIO(inner[position:end])))
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(io.BytesIO(inner[position:end])))
            channels[channel.id] = channel
        position = end
    contents.schemas |= schemas
    contents.channels |= channels
    contents.chunks += 1
    for message in found:
        _keep(contents, *message)


def _keep(contents: Contents, number: int, log_time: int, data: bytes) -> None:
    contents.order.append(number)
    if number not in contents.times:
        contents.times[number], contents.data[number] = [], []
    contents.times[number].append(log_time)
    contents.data[number].append(data)


def _schema(data: bytes, contents: Contents) -> None:
    schema = Schema.read(ReadDataStream(io.BytesIO(data)))
    contents.schemas.setdefault(schema.id, schema)


def _channel(data: bytes, contents: Contents) -> None:
    channel = Channel.read(ReadDataStream(io.BytesIO(data)))
    contents.channels.setdefault(channel.id, channel)


def _message(data: bytes, contents: Contents) -> None:
    number, _, log_time, _ = _MESSAGE.unpack_from(data)
    _keep(contents, number, log_time, data[_MESSAGE.size :])


def _metadata(data: bytes, contents: Contents) -> None:
    metadata = Metadata.read(ReadDataStream(io.BytesIO(data)))
    contents.metadata.setdefault(metadata.name, {}).update(metadata.metadata)  # some is known later than the rest


_READERS: dict[int, Callable[[bytes, Contents], None]] = {
    Opcode.CHUNK: _chunk,
    Opcode.SCHEMA: _schema,
    Opcode.CHANNEL: _channel,
    Opcode.MESSAGE: _message,
    Opcode.METADATA: _metadata,
}


def _next_chunk(data: bytes, start: int) -> int:
    """Return where the next chunk might begin; -1: nowhere."""
    places = []
    for mark in _MARKS:
        at = data.find(mark, start + _MARK_OFFSET)
        while at >= 0 and data[at - _MARK_OFFSET] != Opcode.CHUNK:
            at = data.find(mark, at + 1)
        if at >= 0:
            places.append(at - _MARK_OFFSET)
    return min(places, default=-1)
