"""Reads the records of an MCAP file from front to back, as far as they are whole: also after kill -9."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory

from robolamp.errors import FileError

_MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length of what follows


@dataclass
class Contents:
    """What a file holds.

    Attributes:
        path: The file.
        metadata: Metadata records by name.
        messages: By topic: log times [ns since the epoch] and decoded messages, in file order.
        types: Message type by topic.
        truncated: Whether the file ends early or is damaged; what is here came before that.
    """

    path: Path
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    messages: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)
    truncated: bool = True

    def topic(self, name: str, kind: str) -> list[tuple[int, Any]]:
        """Return a topic's messages.

        Args:
            name: The topic.
            kind: The message type it must have.

        Raises:
            FileError: The topic is missing or holds messages of another type.
        """
        found = self.messages.get(name)
        if not found:
            topics = ", ".join(sorted(self.messages)) or "no topics at all"
            raise FileError(f"holds no {name} messages; it has {topics}", str(self.path))
        if self.types[name] != kind:
            raise FileError(f"{name} holds {self.types[name]}, expected {kind}", str(self.path))
        return found


def read_contents(path: Path) -> Contents:
    """Read every whole record of a log.

    Raises:
        FileError: The file cannot be read, or is not MCAP.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror or error}", str(path)) from None
    if not data.startswith(_MAGIC):
        raise FileError("is not an MCAP log (it does not begin with the MCAP magic)", str(path))
    contents = Contents(path)
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, Callable[[bytes], Any] | None]] = {}
    decoders = DecoderFactory()
    try:
        for record in StreamReader(io.BytesIO(data[: _whole(data)]), validate_crcs=True).records:
            _take(record, contents, schemas, channels, decoders)
    except Exception:  # EndOfFile, or whatever damaged bytes make the decoders raise: what came before is whole
        return contents
    contents.truncated = False
    return contents


def _whole(data: bytes) -> int:
    """Return where the last whole record ends: the library returns a cut one as if it were whole."""
    position = len(_MAGIC)
    while position + _RECORD.size <= len(data):
        following = position + _RECORD.size + _RECORD.unpack_from(data, position)[1]
        if following > len(data):
            return position
        if data[following:] == _MAGIC:
            return len(data)
        position = following
    return position


def _take(
    record: McapRecord,
    contents: Contents,
    schemas: dict[int, Schema],
    channels: dict[int, tuple[str, Callable[[bytes], Any] | None]],
    decoders: DecoderFactory,
) -> None:
    if isinstance(record, Schema):
        schemas[record.id] = record
    elif isinstance(record, Channel):
        schema = schemas.get(record.schema_id)
        channels[record.id] = (record.topic, decoders.decoder_for(record.message_encoding, schema))
        contents.types[record.topic] = schema.name if schema else ""
    elif isinstance(record, Message):
        topic, decode = channels[record.channel_id]
        if decode is not None:
            contents.messages.setdefault(topic, []).append((record.log_time, decode(record.data)))
    elif isinstance(record, Metadata):
        contents.metadata[record.name] = record.metadata
