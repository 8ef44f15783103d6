"""Makes a whole MCAP file from one that was cut off or damaged: it keeps every undamaged chunk, wherever it lies."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

from mcap.writer import Writer

from robolamp.errors import FileError
from robolamp.files import write_atomic
from robolamp.log.mcap_stream import Contents, read_contents


@dataclass(frozen=True)
class Recovery:
    """The result of a recovery.

    Attributes:
        file: The file that was written.
        messages: How many messages are in it, by topic.
        unknown: Messages that were left out: what they mean was lost with the chunk that said so.
        damage: What was wrong with the log, one line a place; empty for a whole one.
    """

    file: Path
    messages: dict[str, int]
    unknown: int
    damage: tuple[str, ...]


def recover(log: Path | str, out: Path | str) -> Recovery:
    """Write a whole, indexed MCAP file of what a log still holds; messages and metadata stay as they are.

    Args:
        log: The log.
        out: The file to write.

    Raises:
        FileError: The log cannot be read, is not MCAP or holds no message; the file cannot be written or is the log.
    """
    source, target = Path(log), Path(out)
    if target.exists() and source.exists() and target.samefile(source):
        raise FileError("is the log itself; choose another -o", str(target))
    contents = read_contents(source, salvage=True)
    known = sum(contents.topics.values())
    if not known:
        damage = f" ({contents.damage[0]})" if contents.damage else ""
        raise FileError(f"holds no message that can be recovered{damage}", str(source))
    write_atomic(target, _written(contents))
    return Recovery(target, contents.topics, len(contents.order) - known, tuple(contents.damage))


def _written(contents: Contents) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start("ros2", "robolamp")
    for name, metadata in contents.metadata.items():
        writer.add_metadata(name, metadata)
    schemas = {0: 0} | {
        number: writer.register_schema(schema.name, schema.encoding, schema.data)
        for number, schema in contents.schemas.items()
    }
    channels = {
        number: writer.register_channel(
            channel.topic, channel.message_encoding, schemas.get(channel.schema_id, 0), channel.metadata
        )
        for number, channel in contents.channels.items()
    }
    messages = {number: zip(contents.times[number], contents.data[number], strict=True) for number in contents.data}
    for number in contents.order:
        if number in channels:
            log_time, data = next(messages[number])
            writer.add_message(channels[number], log_time, data, log_time)
    writer.finish()
    return stream.getvalue()
