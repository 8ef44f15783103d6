"""Logs as other recorders and other clocks leave them: a log's messages, changed one by one, as a file of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import Writer

from robolamp.log.cdr import Encoder, decode
from robolamp.log.schemas import DEFINITIONS, JOINT_STATE


def rewritten(
    source: Path,
    target: Path,
    *,
    order: Callable[[str, int], list[int] | None] = lambda topic, number: None,
    clock: Callable[[str, int, int], int] = lambda topic, number, log_time: log_time,
    context: bool = True,
) -> Path:
    """Write a log's messages anew.

    Args:
        source: The log.
        target: The new one.
        order: Of a topic and the number of a JointState message in it: the order of its joints; None: as they are.
        clock: Of a topic, the message's number and its log time: the new log time.
        context: Whether the metadata come along.
    """
    with source.open("rb") as stream, target.open("wb") as out:
        reader = make_reader(stream)
        writer = Writer(out)
        writer.start("ros2", "test")
        for record in reader.iter_metadata() if context else ():
            writer.add_metadata(record.name, record.metadata)
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        counts: dict[str, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            topic = channel.topic
            if schema.name not in schemas:
                schemas[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, channel.message_encoding, schemas[schema.name])
            number = counts[topic] = counts.get(topic, -1) + 1
            data, wanted = message.data, order(topic, number) if schema.name == JOINT_STATE else None
            if wanted is not None:
                data = _reordered(data, wanted)
            at = clock(topic, number, message.log_time)
            writer.add_message(channels[topic], at, data, at)
        writer.finish()
    return target


def _reordered(data: bytes, order: list[int]) -> bytes:
    fields = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id", "name", "position", "velocity", "effort")
    found: dict[str, Any] = decode(DEFINITIONS[JOINT_STATE], [data], fields)
    stamp = {"sec": int(found["header.stamp.sec"][0]), "nanosec": int(found["header.stamp.nanosec"][0])}
    message: dict[str, Any] = {
        "header": {"stamp": stamp, "frame_id": found["header.frame_id"][0]},
        "name": [found["name"][0][index] for index in order],
    }
    for name in ("position", "velocity", "effort"):
        values = found[name].values[0].tolist()
        message[name] = [values[index] for index in order] if values else []
    return Encoder(DEFINITIONS[JOINT_STATE]).encode(message)
