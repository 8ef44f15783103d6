"""Reads the undamaged records of an MCAP file: after kill -9, and on request past damage.

A few bytes can stand for gigabytes, so a chunk is unpacked piece by piece, up to the largest size of a log.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema

from robolamp.errors import FileError
from robolamp.files import MOST_LOG, read_bytes
from robolamp.log.cdr import LayoutError, decode

_MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
# A chunk's record as far as the name of its compression: opcode, length, two times, size and checksum stand before.
_CHUNK = re.compile(rb"\x06.{36}(?:\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4)", re.DOTALL)
_MOST_CHUNK = 64 << 20  # unpacked [bytes]: chosen; writers close a chunk at 1 to 8 MiB
_MOST_KEPT = 512 << 20  # of all messages together [bytes]: chosen; a run of 600 s has some 50 MB
_MESSAGE_COST = 200  # of a message beside its data, as Python keeps it [bytes]
_PIECE = 1 << 20  # unpacked at once [bytes]
_LATEST = (1 << 63) - 1  # of what numpy counts nanoseconds with; MCAP's own has a bit more [ns since the epoch]


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
        kept: Memory that the messages take [bytes].
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
    kept: int = 0
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
            damage = f" ({self.damage[0]})" if self.damage else ""
            raise FileError(f"holds no {name} messages; it has {topics}{damage}", str(self.path))
        times, data = [], []
        for number in channels:
            if self._kind(number) != kind:
                raise FileError(f"{name} holds {self._kind(number)}, expected {kind}", str(self.path))
            times += self.times[number]
            data += self.data[number]
        if (latest := max(times)) > _LATEST:
            raise FileError(
                f"{name}: a message of {latest} ns since the epoch; expected {_LATEST} at most", str(self.path)
            )
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
        FileError: The file cannot be read, is not MCAP, or holds more than a log may.
    """
    data = read_bytes(path, MOST_LOG)
    if not data.startswith(_MAGIC):
        raise FileError("is not an MCAP log (it does not begin with the MCAP magic)", str(path))
    contents = Contents(path, len(data))
    position, finished = len(_MAGIC), False
    while not (finished and position == len(data) - len(_MAGIC) and data.endswith(_MAGIC)):
        try:
            following, finished = _take(data, position, contents)
            position = following
        except Exception as error:  # whatever damaged bytes make the decoders raise: what came before is whole
            if isinstance(error, _BombError) and not salvage:
                raise FileError(f"byte {position}: {error}", str(path)) from None
            contents.truncated = True
            contents.damage.append(f"byte {position}: {_said(error)}")
            found = _CHUNK.search(data, position + 1) if salvage else None
            if found is None:
                break
            position, finished = found.start(), False
    return contents


class _CutError(Exception):
    """A record that the file does not hold in whole."""


class _BombError(_CutError):
    """More than a log may hold."""


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
    chunk = Chunk.read(ReadDataStream(io.BytesIO(data)))
    inner = _unpacked(chunk)
    length = len(inner)
    if chunk.uncompressed_crc not in (0, zlib.crc32(inner)):
        raise _CutError("a damaged chunk (its checksum is wrong)")
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
    for message in found:
        _keep(contents, *message)


_OPENERS: dict[str, Callable[[bytes], Any]] = {
    "zstd": lambda data: zstandard.ZstdDecompressor().stream_reader(data),
    "lz4": lambda data: lz4.frame.LZ4FrameFile(io.BytesIO(data)),
}
"""What unpacks each compression piece by piece."""


def _unpacked(chunk: Chunk) -> bytes:
    """Return what a chunk holds, unpacked as far as it may be large."""
    if not chunk.compression:
        return chunk.data
    if chunk.compression not in _OPENERS:
        raise _CutError(f"a chunk compressed by {chunk.compression[:20]!r}; expected zstd, lz4 or none")
    pieces, size = [], 0
    if chunk.compression == "zstd":  # a frame that says so itself need not be tried
        size = zstandard.frame_content_size(chunk.data)
    if size <= _MOST_CHUNK:
        size, stream = 0, _OPENERS[chunk.compression](chunk.data)
        while size <= _MOST_CHUNK and (piece := stream.read(_PIECE)):
            pieces.append(piece)
            size += len(piece)
    if size > _MOST_CHUNK:
        raise _BombError(f"a chunk unpacks to more than {_MOST_CHUNK / 1e6:.0f} MB; expected less, as writers make it")
    if size != chunk.uncompressed_size:
        raise _CutError(f"a damaged chunk ({size} bytes unpacked, expected {chunk.uncompressed_size})")
    return b"".join(pieces)


def _keep(contents: Contents, number: int, log_time: int, data: bytes) -> None:
    contents.kept += len(data) + _MESSAGE_COST
    if contents.kept > _MOST_KEPT:
        raise _BombError(f"its messages take more than {_MOST_KEPT / 1e6:.0f} MB; expected the log of one run")
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
