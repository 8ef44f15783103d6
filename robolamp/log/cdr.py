"""ROS 2 messages as bytes (CDR, little-endian): one message encoded at a time, a whole topic decoded at once.

The layout follows the OMG's Common Data Representation as ROS 2 uses it (DDS-XTypes 1.3, 7.4.3, PLAIN_CDR): four bytes
of encapsulation, then the fields in order, each number aligned to its own size counted from the end of those four; a
string is its length with the closing NUL (uint32) and its bytes, a sequence its length (uint32) and its elements.
`mcap_ros2`, which decodes message by message, is the tests' oracle; here the messages that share a layout are decoded
together, as columns of a matrix of bytes.
"""

from __future__ import annotations

import functools
import itertools
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_HEADER = b"\x00\x01\x00\x00"  # little-endian, no options
_CODES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_LENGTH = struct.Struct("<I")
_MOST_LINES = 1000  # of a definition: chosen; nested types can name each other so that their number doubles with each
_MOST_VALUES = 50_000_000  # of a sequence over all messages, each as wide as the widest [1]: 400 MB; chosen
_LINE = re.compile(r"(?P<type>[A-Za-z][\w/]*)(?P<sequence>\[\])? +(?P<name>[a-z]\w*)")


class LayoutError(ValueError):
    """A definition that is not understood, or bytes that do not fit theirs."""


@dataclass(frozen=True)
class Field:
    """A field of a message; those of nested messages have their path as the name ("header.stamp.sec").

    Attributes:
        name: Its name.
        code: The `struct` code of a number; "s" for a string.
        sequence: Whether it holds any number of them.
    """

    name: str
    code: str
    sequence: bool


@functools.cache
def fields_of(definition: str) -> tuple[Field, ...]:
    """Return the fields of a message definition: numbers, strings, sequences of both, nested messages.

    Args:
        definition: As MCAP stores it: the message's own lines, then those of nested ones after "====" and "MSG: type".

    Raises:
        LayoutError: It has something else (fixed or bounded arrays, constants, defaults, sequences of messages).
    """
    first, *others = re.split(r"^=+\n", definition, flags=re.MULTILINE)
    nested = {}
    for other in others:
        head, _, body = other.partition("\n")
        nested[head.removeprefix("MSG:").strip().rpartition("/")[2]] = body
    return tuple(_fields(first, nested, "", itertools.count(1)))


def _fields(text: str, nested: Mapping[str, str], prefix: str, lines: Iterator[int]) -> Iterator[Field]:
    for raw in text.splitlines():
        line = raw.partition("#")[0].strip()
        if not line:
            continue
        if next(lines) > _MOST_LINES:
            raise LayoutError(f"message definition: has more than {_MOST_LINES} lines, those of nested types each time")
        match = _LINE.fullmatch(line)
        kind = match["type"].rpartition("/")[2] if match else ""
        code = "s" if kind == "string" else _CODES.get(kind)
        if match and code:
            yield Field(prefix + match["name"], code, bool(match["sequence"]))
        elif match and kind in nested and not match["sequence"] and len(prefix) < 100:
            yield from _fields(nested[kind], nested, f"{prefix}{match['name']}.", lines)
        else:
            raise LayoutError(f"message definition: {line!r} is not understood")


class Encoder:
    """Turns messages of one type into bytes.

    Args:
        definition: The message definition.
    """

    def __init__(self, definition: str) -> None:
        # Neighbouring numbers are packed together.
        self._parts: list[tuple[str, list[list[str]]]] = []
        for field in fields_of(definition):
            path = field.name.split(".")
            single = field.code != "s" and not field.sequence
            if single and self._parts and not self._parts[-1][0].endswith(("s", "[]")):
                codes, paths = self._parts[-1]
                self._parts[-1] = (codes + field.code, [*paths, path])
            else:
                self._parts.append((field.code + ("[]" if field.sequence else ""), [path]))

    def encode(self, message: Mapping[str, Any]) -> bytes:
        """Return a message's bytes.

        Args:
            message: Its fields by name; a nested message is a mapping of its own.

        Raises:
            KeyError: A field is missing.
            struct.error: A number is out of its type's range.
        """
        out = bytearray(_HEADER)
        for codes, paths in self._parts:
            values = [_value(message, path) for path in paths]
            if not codes.endswith(("s", "[]")):
                out += _packer(codes, (len(out) - 4) % 8).pack(*values)
                continue
            [value] = values
            if codes == "s":
                _put_string(out, value)
                continue
            _pad(out, 4)
            out += _LENGTH.pack(len(value))
            if codes == "s[]":
                for text in value:
                    _put_string(out, text)
            elif len(value):
                _pad(out, struct.calcsize(codes[0]))
                out += struct.pack(f"<{len(value)}{codes[0]}", *value)
        return bytes(out)


def _value(message: Any, path: list[str]) -> Any:
    for key in path:
        message = message[key]
    return message


@functools.cache
def _packer(codes: str, offset: int) -> struct.Struct:
    """Return the packer of numbers that begin at an offset (modulo 8) after the encapsulation."""
    text = "<"
    for code in codes:
        size = struct.calcsize(code)
        padding = -offset % size
        text += "x" * padding + code
        offset += padding + size
    return struct.Struct(text)


def _pad(out: bytearray, size: int) -> None:
    out += bytes(-(len(out) - 4) % size)


def _put_string(out: bytearray, text: str) -> None:
    _pad(out, 4)
    data = text.encode(errors="replace")
    out += _LENGTH.pack(len(data) + 1) + data + b"\x00"


@dataclass(frozen=True)
class Rows:
    """A sequence of numbers in each of N messages.

    Attributes:
        lengths: How many each message holds, shape (N,).
        values: Shape (N, longest); 0 beyond a message's own length.
    """

    lengths: NDArray[np.int64]
    values: NDArray[Any]


Column = NDArray[Any] | list[str] | list[tuple[str, ...]] | Rows


def decode(definition: str, messages: Sequence[bytes], wanted: Sequence[str]) -> dict[str, Any]:
    """Decode many messages of one type.

    Args:
        definition: The message definition.
        messages: Their bytes, N messages.
        wanted: Names of the fields to return.

    Returns:
        By name: numbers as an array of shape (N,), strings as a list, sequences of numbers as `Rows`, sequences of
        strings as a list of tuples.

    Raises:
        LayoutError: The definition is not understood, lacks a field that is wanted, or the bytes do not fit it.
    """
    fields = fields_of(definition)
    missing = [name for name in wanted if name not in {field.name for field in fields}]
    if missing:
        raise LayoutError(f"message definition: has no field {', '.join(missing)}")
    reader = _Reader(fields, frozenset(wanted), len(messages))
    groups: dict[int, list[int]] = {}
    for row, message in enumerate(messages):
        groups.setdefault(len(message), []).append(row)
    for length, rows in groups.items():
        data = b"".join([messages[row] for row in rows])
        reader.read(np.array(rows), np.frombuffer(data, np.uint8).reshape(len(rows), length))
    return {name: reader.column(name) for name in wanted}


class _Reader:
    """Reads matrices of bytes, a message a row, field by field; rows whose layouts part are split and read on apart."""

    def __init__(self, fields: tuple[Field, ...], wanted: frozenset[str], count: int) -> None:
        self._fields, self._wanted, self._count = fields, wanted, count
        self._numbers: dict[str, NDArray[Any]] = {}
        self._texts: dict[str, list[Any]] = {}
        self._pieces: dict[str, list[tuple[NDArray[np.int64], NDArray[Any]]]] = {}
        for field in fields:
            if field.code == "s":
                self._texts[field.name] = [()] * count if field.sequence else [""] * count
            elif field.sequence:
                self._pieces[field.name] = []
            else:
                self._numbers[field.name] = np.zeros(count, np.dtype(field.code))

    def read(self, rows: NDArray[np.int64], data: NDArray[np.uint8]) -> None:
        if data.shape[1] < 4 or (data[:, :2] != (0, 1)).any():
            raise LayoutError("a message is not little-endian CDR")
        waiting = [(rows, data, 0, 4)]
        while waiting:
            rows, data, first, at = waiting.pop()
            for index in range(first, len(self._fields)):
                field = self._fields[index]
                if field.code != "s" and not field.sequence:
                    at, values = _numbers(data, at, field.code, 1)
                    self._numbers[field.name][rows] = values[:, 0]
                    continue
                begin = at
                at, lengths = _numbers(data, at, "I", 1)
                if (lengths != lengths[0]).any():
                    for length in np.unique(lengths):
                        same = lengths[:, 0] == length
                        waiting.append((rows[same], data[same], index, begin))
                    break
                length = int(lengths[0, 0])
                if field.code == "s" and field.sequence:
                    parted = self._strings(field.name, rows, data, at, length)
                    if isinstance(parted, np.ndarray):
                        waiting += [(rows[parted == k], data[parted == k], index, begin) for k in np.unique(parted)]
                        break
                    at = parted
                elif field.code == "s":
                    at, texts = self._string(field.name, data, at, length)
                    self._keep(field.name, rows, texts)
                else:
                    at, values = _numbers(data, at, field.code, length) if length else (at, np.empty((len(rows), 0)))
                    if field.name in self._wanted:
                        self._pieces[field.name].append((rows, values))

    def _keep(self, name: str, rows: NDArray[np.int64], values: Sequence[Any]) -> None:
        if name in self._wanted:
            into = self._texts[name]
            for row, value in zip(rows.tolist(), values, strict=True):
                into[row] = value

    def _string(self, name: str, data: NDArray[np.uint8], at: int, length: int) -> tuple[int, list[str]]:
        end = at + length
        if length == 0 or end > data.shape[1]:
            raise LayoutError(f"{name}: a message ends in the middle of it")
        if name not in self._wanted:
            return end, []
        raw = data[:, at : end - 1].tobytes()
        size = length - 1
        try:
            return end, [raw[row * size : (row + 1) * size].decode() for row in range(len(data))]
        except UnicodeDecodeError:
            raise LayoutError(f"{name}: is not UTF-8") from None

    def _strings(
        self, name: str, rows: NDArray[np.int64], data: NDArray[np.uint8], at: int, count: int
    ) -> int | NDArray[np.uint32]:
        """Read as many strings in every row; returns where they end, or lengths by which the rows must be parted."""
        found = []
        for _ in range(count):
            at, lengths = _numbers(data, at, "I", 1)
            if (lengths != lengths[0]).any():
                return lengths[:, 0]
            at, texts = self._string(name, data, at, int(lengths[0, 0]))
            found.append(texts)
        self._keep(name, rows, list(zip(*found, strict=True)) if name in self._wanted and found else [()] * len(rows))
        return at

    def column(self, name: str) -> Column:
        if name in self._numbers:
            return self._numbers[name]
        if name in self._texts:
            return self._texts[name]
        pieces = self._pieces[name]
        longest = max((values.shape[1] for _, values in pieces), default=0)
        if longest * self._count > _MOST_VALUES:
            raise LayoutError(f"{name}: {self._count} messages of up to {longest} values are too many")
        lengths = np.zeros(self._count, np.int64)
        table = np.zeros((self._count, longest), pieces[0][1].dtype if pieces else np.float64)
        for rows, values in pieces:
            lengths[rows] = values.shape[1]
            table[rows, : values.shape[1]] = values
        return Rows(lengths, table)


def _numbers(data: NDArray[np.uint8], at: int, code: str, count: int) -> tuple[int, NDArray[Any]]:
    kind = np.dtype(code).newbyteorder("<")
    at += -(at - 4) % kind.itemsize
    end = at + count * kind.itemsize
    if end > data.shape[1]:
        raise LayoutError("a message is shorter than its definition says")
    return end, np.ascontiguousarray(data[:, at:end]).view(kind)
