"""Messages as bytes, held against mcap_ros2's own codec, which works message by message."""

from __future__ import annotations

import contextlib
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer

from robolamp.log.cdr import Encoder, LayoutError, Rows, decode, fields_of
from robolamp.log.schemas import DEFINITIONS

ALL = """bool a
string s
uint8 b
float64[] many
int16 c
int32[] few
string[] texts
float32 d
Inner inner
uint64 e
byte[] bytes
int64 f
================================================================================
MSG: my_msgs/Inner
uint8 g
float64 h  # a comment
string k
"""
NAMES = ("a", "s", "b", "many", "c", "few", "texts", "d", "inner.g", "inner.h", "inner.k", "e", "bytes", "f")

texts = st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=6)
messages = st.fixed_dictionaries(
    {
        "a": st.booleans(),
        "s": texts,
        "b": st.integers(0, 255),
        "many": st.lists(st.floats(allow_nan=False), max_size=3),
        "c": st.integers(-(2**15), 2**15 - 1),
        "few": st.lists(st.integers(-(2**31), 2**31 - 1), max_size=2),
        "texts": st.lists(texts, max_size=3),
        "d": st.floats(allow_nan=False, width=32),
        "inner": st.fixed_dictionaries({"g": st.integers(0, 255), "h": st.floats(allow_nan=False), "k": texts}),
        "e": st.integers(0, 2**64 - 1),
        "bytes": st.lists(st.integers(0, 255), max_size=5),
        "f": st.integers(-(2**63), 2**63 - 1),
    }
)


WRITER = Writer(io.BytesIO())
SCHEMA = WRITER.register_msgdef("my_msgs/msg/All", ALL)
KEPT: list[bytes] = []
WRITER._writer.add_message = lambda **fields: KEPT.append(fields["data"])
DECODER = DecoderFactory().decoder_for("cdr", Schema(1, ALL.encode(), "ros2msg", "my_msgs/msg/All"))


def oracle_bytes(message: dict) -> bytes:
    """As mcap_ros2 writes it."""
    WRITER.write_message("/x", SCHEMA, message, 1)
    return KEPT.pop()


def oracle_fields(data: bytes) -> dict:
    """As mcap_ros2 reads it."""
    assert DECODER is not None
    found = DECODER(data)
    return {
        name: getattr(found.inner, name[6:]) if name.startswith("inner.") else getattr(found, name) for name in NAMES
    }


@settings(max_examples=50, deadline=None)
@given(messages)
def test_bytes_are_those_of_the_generic_encoder(message: dict) -> None:
    assert Encoder(ALL).encode(message) == oracle_bytes(message)


@settings(max_examples=50, deadline=None)
@given(st.lists(messages, max_size=4))
def test_a_topic_decoded_at_once_is_what_the_generic_decoder_reads(rows: list[dict]) -> None:
    data = [Encoder(ALL).encode(row) for row in rows]
    columns = decode(ALL, data, NAMES)
    for index, one in enumerate(data):
        for name, wanted in oracle_fields(one).items():
            column = columns[name]
            found = column.values[index, : column.lengths[index]] if isinstance(column, Rows) else column[index]
            assert list(found) == list(wanted) if isinstance(wanted, list | bytes) else found == wanted, name


@settings(max_examples=50, deadline=None)
@given(st.lists(messages, min_size=1, max_size=3), st.data())
def test_damaged_bytes_give_columns_or_one_error(rows: list[dict], data: st.DataObject) -> None:
    broken = []
    for row in rows:
        raw = bytearray(Encoder(ALL).encode(row))
        raw[data.draw(st.integers(0, len(raw) - 1))] ^= data.draw(st.integers(1, 255))
        broken.append(bytes(raw[: data.draw(st.integers(0, len(raw)))]))
    with contextlib.suppress(LayoutError):
        assert len(decode(ALL, broken, NAMES)["f"]) == len(broken)


def test_definitions_that_are_written_are_understood() -> None:
    for name, definition in DEFINITIONS.items():
        assert fields_of(definition), name
    joint_state = [field.name for field in fields_of(DEFINITIONS["sensor_msgs/msg/JointState"])]
    assert joint_state[:3] == ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id"]


@pytest.mark.parametrize(
    "line", ["float64[3] fixed", "int32 X=3", "Unknown thing", "float64[<=2] bounded", "float64 X"]
)
def test_what_is_not_understood_is_named(line: str) -> None:
    with pytest.raises(LayoutError, match=f"'{line}'".replace("[", r"\[").replace("]", r"\]")):
        fields_of(f"float64 a\n{line}\n")


def test_a_definition_that_nests_itself_is_refused() -> None:
    with pytest.raises(LayoutError, match="not understood"):
        fields_of("A a\n====\nMSG: x/A\nA a\n")


def test_a_field_that_is_missing_is_named() -> None:
    with pytest.raises(LayoutError, match="has no field nothing"):
        decode("float64 a\n", [], ["a", "nothing"])
    with pytest.raises(LayoutError, match="not little-endian"):
        decode("float64 a\n", [b"\x00\x00\x00\x00" + bytes(8)], ["a"])


def test_numbers_keep_their_type() -> None:
    columns = decode("bool a\nuint32 b\n", [Encoder("bool a\nuint32 b\n").encode({"a": True, "b": 7})], ["a", "b"])
    assert (columns["a"].dtype, columns["b"].dtype) == (np.bool_, np.uint32)
