"""Files: what a user names is read here alone, checked and bounded; what is written is whole or not there.

Nothing but a regular file is opened: a named pipe would block, a device never ends. No kind of file is read beyond the
size that it may have.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import re
import secrets
import stat
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from robolamp.errors import FileError


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never half of either.

    A link in its place is replaced, not followed: a folder that came from somebody else writes to nothing outside it.

    Args:
        path: Where to; missing parent folders are made.
        data: Text (written as UTF-8; what is no text, as in some file names, as "?") or bytes.

    Raises:
        FileError: The folder or the file cannot be written.
    """
    raw = data.encode(errors="replace") if isinstance(data, str) else data
    with partial(path) as temporary:
        try:
            with os.fdopen(open_new(temporary), "wb") as stream:
                stream.write(raw)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise _unwritten(path, error) from None


@contextlib.contextmanager
def partial(path: Path, name: str = "") -> Iterator[Path]:
    """Give a name to write to, and make what is there the file; on every way out but a good one it is removed.

    Args:
        path: The file; missing parent folders are made.
        name: What it is called until then; unless given, as no other file is.

    Raises:
        FileError: The folder or the file cannot be written, or what is there is no file.
    """
    temporary = path.parent / (name or f".robolamp-{secrets.token_hex(6)}")
    try:
        if path.exists() and not path.is_file() and not path.is_dir():  # as /dev/stdout, which is a link
            raise FileError("cannot be written: is a device or a pipe; expected a file", str(path))
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritten(path, error) from None
    try:
        try:
            yield temporary
        except FileError as error:
            if error.where == str(temporary):  # a name that nobody gave, of a file that is about to go
                error.where = str(path)
            raise
        try:
            temporary.replace(path)
        except OSError as error:
            raise _unwritten(path, error) from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def _unwritten(path: Path, error: OSError) -> FileError:
    """Return (not raise) what is said of a file that could not be written."""
    return FileError(f"cannot be written: {error.strerror or error}", str(path))


def spare(out: Path, *sources: Path | None) -> None:
    """Refuse to write over a file that is read: it may be the only one of its kind.

    Args:
        out: What is to be written.
        *sources: What is read for it; None: nothing.

    Raises:
        FileError: They are the same file, by whatever name.
    """
    for source in sources:
        if source is not None and out.exists() and source.exists() and out.samefile(source):
            raise FileError(f"is {source} itself, which is read; choose another -o", str(out))


def open_new(path: Path) -> int:
    """Open a file for writing, in place of whatever file or link has its name, and return its descriptor.

    Nothing is ever written through a link: neither a symbolic one, nor into a file that has another name, too.

    Raises:
        OSError: It cannot be made.
    """
    flags = os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC
    with contextlib.suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISLNK(mode):
            descriptor = os.open(path, flags | os.O_NONBLOCK)  # a pipe that nobody reads would make us wait
            os.set_blocking(descriptor, True)
            return descriptor
        path.unlink()
    return os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o666)


MOST_TOML = 4 << 20
"""Largest TOML file [bytes]: chosen; a controller of 100,000 nodes a joint has 2.4 MB."""

MOST_TEXT = 64 << 20
"""Largest other text [bytes]: chosen; a servo's recording by Rhoban/bam has 45 kB a second."""

MOST_LOG = 256 << 20
"""Largest log [bytes]: chosen; a run of the longest duration, 600 s, has some 15 MB."""

_PIECE = 1 << 20  # read at once [bytes]
_PARTS = _DEEPEST = 16  # of a TOML key, and of brackets: nothing that robolamp reads has more than 4
_SHOWN = 80  # characters of a value in a message
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)
_MARKS = {  # the longer before the shorter that they begin with
    b"\xff\xfe\x00\x00": "UTF-32",
    b"\x00\x00\xfe\xff": "UTF-32",
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
}
# Strings and comments as wholes, so that what is counted stands outside of them.
_TOML = re.compile(
    r'"""(?:[^"\\]|\\.|"{1,2}(?!"))*+"""|"(?:[^"\\\n]|\\.)*+"'
    r"|'''(?:[^']|'{1,2}(?!'))*+'''|'[^'\n]*+'|(?P<comment>\#[^\n]*+)"
    r"|(?P<word>[A-Za-z0-9_ \t-]++)|(?P<dot>\.)|(?P<open>[\[{])|(?P<close>[\]}])|(?P<other>.)",
    re.DOTALL,
)


def kind_of(path: Path) -> str:
    """Return what a path is: "file", "a folder", "a named pipe", "a device", "a socket"; empty where nothing is.

    Raises:
        FileError: It cannot be looked at, as a name that is too long.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return ""
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise FileError(f"cannot be read: {getattr(error, 'strerror', None) or error}", str(path)) from None
    return next((words for check, words in _KINDS if check(mode)), "file")


def is_file(path: Path) -> bool:
    """Return whether there is a file; False: nothing is there.

    Raises:
        FileError: Something else is there, as a folder or a named pipe: it is refused, not passed over.
    """
    kind = kind_of(path)
    if kind not in ("file", ""):
        raise FileError(f"is {kind}; expected a file", str(path))
    return bool(kind)


def all_below(folder: Path) -> list[Path]:
    """Return everything in a folder and in those below it but folders, in the order of their paths.

    Raises:
        FileError: A folder cannot be looked into: what is in it would be left out in silence.
    """

    def refuse(error: OSError) -> None:
        raise FileError(f"cannot be read: {error.strerror or error}", str(error.filename or folder))

    found = (Path(base, name) for base, _, names in os.walk(folder, onerror=refuse) for name in names)
    return sorted(found)


def suffix_of(path: Path) -> str:
    """Return a name's ending in small letters, as ".csv" of "A.CSV"; empty where it has none."""
    return path.suffix.lower()


def shown(value: Any) -> str:
    """Return a value as a message shows it: `repr`, on one line, not longer than a line has room for."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # ValueError: a whole number of thousands of digits
        return "a value beyond all bounds"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def read_bytes(path: Path, most: int = MOST_TEXT) -> bytes:
    """Return a file's bytes.

    Args:
        path: The file.
        most: Largest size [bytes].

    Raises:
        FileError: It is missing, unreadable, not a regular file (which is never opened), or larger than `most`.
    """
    if kind_of(path) == "a folder":
        raise FileError("cannot be read: is a directory; expected a file", str(path))
    is_file(path)
    pieces: list[bytes] = []
    total = size = 0
    try:
        # Not blocking, should a pipe have taken the file's place by now.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            while size <= most and (piece := stream.read(_PIECE)):
                pieces.append(piece)
                total += len(piece)
                size = max(size, total)  # files of /proc say that they have none
    except OSError as error:
        raise FileError(f"cannot be read: {error.strerror or error}", str(path)) from None
    if size > most:
        raise FileError(f"is too large: {size / 1e6:,.0f} MB, expected {most / 1e6:,.0f} MB at most", str(path))
    return b"".join(pieces)


def read_text(path: Path, most: int = MOST_TEXT) -> str:
    """Return a text file's text, with or without a byte order mark, lines ending in a line feed.

    Args:
        path: The file.
        most: Largest size [bytes].

    Raises:
        FileError: The file is missing, unreadable, no regular file, too large, or not UTF-8.
    """
    data = read_bytes(path, most)
    for mark, name in _MARKS.items():
        if data.startswith(mark):
            raise FileError(f"is {name} text; expected UTF-8: save it as that", str(path))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"not UTF-8 text (byte {error.start})", str(path)) from None
    if "\0" in text:
        raise FileError(f"not text: a zero byte at character {text.index(chr(0))}", str(path))
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return a TOML text as a dictionary.

    Args:
        text: The text.
        where: What it came from, for messages.

    Raises:
        FileError: It is not TOML (with line and column), or nested deeper than anything that robolamp reads.
    """
    depth = dots = 0
    for found in _TOML.finditer(text):
        if found["dot"]:
            dots += 1
        elif found["open"] or found["close"]:
            depth, dots = max(depth + (1 if found["open"] else -1), 0), 0
        elif found["other"] or found["comment"]:
            dots = 0
        if dots >= _PARTS or depth > _DEEPEST:
            what = f"a key of more than {_PARTS} parts" if dots else f"nested more than {_DEEPEST} deep"
            raise FileError(f"not valid TOML: {what} (at line {text.count(chr(10), 0, found.start()) + 1})", where)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also an integer of thousands of digits
        raise FileError(f"not valid TOML: {error}", where) from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return a TOML file as a dictionary.

    Raises:
        FileError: The file cannot be read, or is not TOML (with line and column).
    """
    return parse_toml(read_text(path, MOST_TOML), str(path))


def parse_json(text: str, where: str) -> Any:
    """Return what a JSON text holds; of keys that stand twice in an object none is preferred: they are refused.

    Args:
        text: The text.
        where: What it came from, for messages.

    Raises:
        FileError: It is not JSON.
    """
    try:
        return json.loads(text, object_pairs_hook=_distinct)
    except (ValueError, RecursionError) as error:
        raise FileError(f"not valid JSON: {error}", where) from None


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key {shown(key)} stands twice in an object")
        found[key] = value
    return found


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal.

    Raises:
        FileError: The file cannot be read.
    """
    return hashlib.sha256(read_bytes(path, MOST_LOG)).hexdigest()


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep other processes from working in a folder, until this one is done or dies.

    Args:
        folder: The folder, made where it is missing; a file .lock stays in it.

    Raises:
        FileError: Another process is at work there, or the folder cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot be made: {error.strerror or error}", str(folder)) from None
    try:
        stream = os.fdopen(os.open(folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666))
    except OSError as error:
        raise FileError(f"cannot be written: {error.strerror or error}", str(folder)) from None
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise FileError("another robolamp is at work here", str(folder)) from None
        yield


class Table:
    """A TOML table read key by key, each with its type and range; unknown keys are refused.

    Args:
        data: The table's content.
        where: The file it came from, for messages.
        name: The table's dotted name inside the file; empty for the root.
    """

    def __init__(self, data: Mapping[str, Any], where: str, name: str = "") -> None:
        self._data = data
        self._where = where
        self._name = name
        self._read: set[str] = set()

    def _path(self, key: str) -> str:
        key = key if key.isprintable() and len(key) <= _SHOWN else shown(key)
        return f"{self._name}.{key}" if self._name else key

    def fail(self, key: str, message: str) -> FileError:
        """Return (not raise) an error that names this table's key and file."""
        return FileError(f"{self._path(key)}: {message}", self._where)

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def names(self) -> list[str]:
        """The keys present, in file order."""
        return list(self._data)

    def raw(self) -> dict[str, Any]:
        """Return the whole table unchecked: free-form content such as provenance."""
        self._read.update(self._data)
        return dict(self._data)

    def is_text(self, key: str) -> bool:
        """Return whether a key is present and holds a string: for one that may be of another type, too."""
        return isinstance(self._data.get(key), str)

    def _get(self, key: str, expected: str, default: Any) -> Any:
        self._read.add(key)
        if key in self._data:
            return self._data[key]
        if default is ...:
            raise self.fail(key, f"missing; expected {expected}")
        return default

    def number(self, key: str, low: float, high: float, unit: str = "", default: Any = ...) -> float:
        """Return a finite number in [low, high].

        Raises:
            FileError: The key is missing without a default, not a number, or out of range.
        """
        expected = f"a number from {low:g} to {high:g}{' ' + unit if unit else ''}"
        value = self._get(key, expected, default)
        if value is default and default is not ...:
            return value
        legal = isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
        if not legal or abs(value) > sys.float_info.max:
            raise self.fail(key, f"{shown(value)} is not {expected}")
        return float(value)

    def integer(self, key: str, low: int, high: int, default: Any = ...) -> int:
        """Return an integer in [low, high].

        Raises:
            FileError: The key is missing without a default, not an integer, or out of range.
        """
        expected = f"a whole number from {low} to {high}"
        value = self._get(key, expected, default)
        if value is default and default is not ...:
            return value
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.fail(key, f"{shown(value)} is not {expected}")
        return value

    def text(self, key: str, choices: Iterable[str] | None = None, default: Any = ...) -> str:
        """Return a string, one of choices where given.

        Raises:
            FileError: The key is missing without a default, not a string, or not a legal choice.
        """
        legal = None if choices is None else list(choices)
        expected = "a text" if legal is None else "one of " + ", ".join(legal)
        value = self._get(key, expected, default)
        if value is default and default is not ...:
            return value
        if not isinstance(value, str) or (legal is not None and value not in legal):
            raise self.fail(key, f"{shown(value)} is not {expected}")
        return value

    def flag(self, key: str, default: Any = ...) -> bool:
        """Return true or false.

        Raises:
            FileError: The key is missing without a default, or neither true nor false.
        """
        value = self._get(key, "true or false", default)
        if value is default and default is not ...:
            return value
        if not isinstance(value, bool):
            raise self.fail(key, f"{shown(value)} is not true or false")
        return value

    def array(self, key: str, default: Any = ...) -> list[Any]:
        """Return an array.

        Raises:
            FileError: The key is missing without a default, or not an array.
        """
        value = self._get(key, "an array", default)
        if not isinstance(value, list):
            raise self.fail(key, f"{shown(value)} is not an array")
        return value

    def table(self, key: str, default: Any = ...) -> Table:
        """Return a sub-table.

        Raises:
            FileError: The key is missing without a default, or not a table.
        """
        value = self._get(key, "a table", default)
        if not isinstance(value, Mapping):
            raise self.fail(key, f"{shown(value)} is not a table")
        return Table(value, self._where, self._path(key))

    def tables(self, key: str) -> list[Table]:
        """Return an array of tables ([[key]]), which must not be empty.

        Raises:
            FileError: The key is missing, empty, or not an array of tables.
        """
        value = self._get(key, "an array of tables", ...)
        if not isinstance(value, list) or not value or not all(isinstance(item, Mapping) for item in value):
            raise self.fail(key, "expected one or more tables")
        return [Table(item, self._where, f"{self._path(key)}[{index}]") for index, item in enumerate(value)]

    def done(self) -> None:
        """Refuse keys that nothing read.

        Raises:
            FileError: A key is unknown; the message lists the known ones.
        """
        for key in self._data:
            if key not in self._read:
                raise self.fail(key, f"unknown; expected one of {', '.join(sorted(self._read))}")
