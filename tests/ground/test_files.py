from __future__ import annotations

import hashlib
import os
import re
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robolamp.errors import FileError, RobolampError
from robolamp.files import (
    Table,
    all_below,
    parse_json,
    parse_toml,
    partial,
    read_bytes,
    read_text,
    read_toml,
    sha256,
    write_atomic,
)


def test_an_error_is_one_line_with_its_place() -> None:
    error = RobolampError("3 is not 1 or 2", "lamp.toml")
    assert (str(error), error.message, error.where) == ("lamp.toml: 3 is not 1 or 2", "3 is not 1 or 2", "lamp.toml")
    assert str(RobolampError("nothing")) == "nothing"


def test_a_file_is_written_whole_with_missing_folders_and_ordinary_rights(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.toml"
    write_atomic(path, "äöü\n")
    write_atomic(path, b"\x00\xff")
    assert path.read_bytes() == b"\x00\xff"
    umask = os.umask(0o022)
    try:
        write_atomic(path, "x")
    finally:
        os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o644
    assert [item.name for item in path.parent.iterdir()] == ["b.toml"]


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "b.toml"
    write_atomic(path, "old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FileError, match=r"b\.toml: cannot be written: No space left on device"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["b.toml"]
    with pytest.raises(FileError, match="cannot be written"):
        write_atomic(path / "below", "x")


def test_who_reads_a_file_meanwhile_reads_the_old_one_whole(tmp_path: Path) -> None:
    path = tmp_path / "b.toml"
    path.write_text("old")
    with path.open() as reader:
        write_atomic(path, "new and longer")
        assert (reader.read(), path.read_text()) == ("old", "new and longer")


def test_a_folder_in_the_way_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    with pytest.raises(FileError, match="taken: cannot be written"):
        write_atomic(tmp_path / "taken", "x")
    assert [item.name for item in tmp_path.iterdir()] == ["taken"]


def test_hashes_and_unreadable_files(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"abc")
    assert sha256(path) == hashlib.sha256(b"abc").hexdigest()
    for read in (read_text, read_toml, sha256):
        with pytest.raises(FileError, match="none: cannot be read: No such file or directory"):
            read(tmp_path / "none")


@given(st.text(max_size=50))
def test_any_text_is_toml_or_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    try:
        assert isinstance(read_toml(path), dict)
    except FileError as error:
        message = str(error)
    else:
        return
    assert message.startswith(f"{path}: not ")
    assert "\n" not in message


def table(**data: object) -> Table:
    return Table(data, "file.toml", "part")


@pytest.mark.parametrize("value", [True, "1", float("nan"), float("inf"), 5.1, -1, [1], 10**400])
def test_what_is_no_number_in_range(value: object) -> None:
    with pytest.raises(FileError, match=r"^file\.toml: part\.x: .* is not a number from 0 to 5 m$"):
        table(x=value).number("x", 0.0, 5.0, "m")
    with pytest.raises(FileError):
        table(x=value).integer("x", 0, 5)


@pytest.mark.parametrize("value", [float("inf"), float("nan"), 10**400])
def test_no_upper_bound_still_means_a_finite_number(value: object) -> None:
    with pytest.raises(FileError, match="is not a number from 0 to inf"):
        table(x=value).number("x", 0.0, float("inf"))
    assert table(x=1e300).number("x", 0.0, float("inf")) == 1e300


def test_values_with_their_types_and_defaults() -> None:
    full = table(n=2, f=0.5, t="a", b=False, a=[1], d={"k": 1}, ds=[{"k": 2}])
    assert isinstance(full.number("n", 0, 5), float)
    assert full.integer("n", 0, 5) == 2
    assert full.text("t", ["a", "b"]) == "a"
    assert full.flag("b") is False
    assert full.array("a") == [1]
    assert full.table("d").integer("k", 0, 5) == 1
    assert [part.integer("k", 0, 5) for part in full.tables("ds")] == [2]
    assert full.names() == ["n", "f", "t", "b", "a", "d", "ds"]
    assert "n" in full
    assert "x" not in full
    empty = table()
    assert empty.number("x", 0, 1, default=None) is None
    assert empty.integer("x", 0, 1, default=7) == 7
    assert empty.text("x", default="") == ""
    assert empty.flag("x", default=True) is True
    assert empty.array("x", default=[]) == []
    assert empty.table("x", default={}).names() == []


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (lambda t: t.number("x", 0, 1, "V"), "part.x: missing; expected a number from 0 to 1 V"),
        (lambda t: t.integer("x", 0, 1), "part.x: missing; expected a whole number from 0 to 1"),
        (lambda t: t.text("x", ["a", "b"]), "part.x: missing; expected one of a, b"),
        (lambda t: t.flag("x"), "part.x: missing; expected true or false"),
        (lambda t: t.array("x"), "part.x: missing; expected an array"),
        (lambda t: t.table("x"), "part.x: missing; expected a table"),
        (lambda t: t.tables("x"), "part.x: missing; expected an array of tables"),
        (lambda t: t.integer("f", 0, 1), "part.f: 0.5 is not a whole number"),
        (lambda t: t.text("f"), "part.f: 0.5 is not a text"),
        (lambda t: t.flag("f"), "part.f: 0.5 is not true or false"),
        (lambda t: t.array("f"), "part.f: 0.5 is not an array"),
        (lambda t: t.table("f"), "part.f: 0.5 is not a table"),
        (lambda t: t.tables("f"), "part.f: expected one or more tables"),
        (lambda t: t.done(), "part.f: unknown; expected one of "),
    ],
)
def test_every_refusal_names_key_and_expectation(read, words: str) -> None:
    with pytest.raises(FileError) as caught:
        read(table(f=0.5))
    assert str(caught.value).startswith(f"file.toml: {words}")


MARK = b"\xef\xbb\xbf"


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(MARK + "name = 'ä'\r\nother = 1\r".encode())
    assert read_text(path) == "name = 'ä'\nother = 1\n"
    assert read_toml(path) == {"name": "ä", "other": 1}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("name = 1".encode("utf-16"), "is UTF-16 text; expected UTF-8"),
        ("name = 1".encode("utf-16-be"), "not text: a zero byte"),
        (b"\xfe\xff" + "name = 1".encode("utf-16-be"), "is UTF-16 text"),
        ("name = 1".encode("utf-32"), "is UTF-32 text"),  # whose mark begins with that of UTF-16
        (b"\xff", "not UTF-8 text (byte 0)"),
    ],
)
def test_another_encoding_is_named(tmp_path: Path, data: bytes, words: str) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(data)
    with pytest.raises(FileError, match=re.escape(words)):
        read_toml(path)


HEAVY = {
    "a key of 50,000 points": "a" + ".a" * 50_000 + " = 1",
    "with blanks": "a" + " . a" * 50_000 + " = 1",
    "quoted": "'a'" + '."b"' * 50_000 + " = 1",
    "a table's": "[" + "a." * 50_000 + "a]",
    "of tables": "[[" + "a." * 50_000 + "a]]",
    "inside an inline table": "x = {" + "a." * 50_000 + "a = 1}",
    "arrays": "a = " + "[" * 50_000 + "]" * 50_000,
    "arrays without an end": "a = " + "[" * 50_000,
    "inline tables": "a = " + "{a=" * 50_000 + "1" + "}" * 50_000,
    "both": "a = " + "[{a=" * 50_000,
    "after strings": "s = \"[[[\" # [[[\nt = '''{{{'''\na = " + "[" * 50_000,
}


@pytest.mark.parametrize("text", HEAVY.values(), ids=HEAVY.keys())
def test_nesting_without_end_is_refused_at_once(text: str) -> None:
    began = time.monotonic()
    with pytest.raises(FileError, match=r"not valid TOML: (a key of more than 16 parts|nested more than 16 deep) \(at"):
        parse_toml(text, "x.toml")
    assert time.monotonic() - began < 1.0


def test_what_looks_like_nesting_inside_strings_and_comments_is_none() -> None:
    text = f'a = "{"[" * 50}"\nb = \'\'\'{"{" * 50}\'\'\'\nc = """{"a." * 50}\\""""  # {"[" * 50}\nd = 1.5\n'
    assert parse_toml(text, "")["a"] == "[" * 50
    assert parse_toml("a = [" + "1.5, " * 1000 + "]", "")["a"] == [1.5] * 1000
    assert parse_toml("a.b.c = [[{d.e = 1}]]", "") == {"a": {"b": {"c": [[{"d": {"e": 1}}]]}}}


@given(st.binary(max_size=200) | st.text(alphabet="[]{}.='\"#\n\\a1, ", max_size=200).map(str.encode))
def test_no_bytes_break_the_readers(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("any") / "x"
    path.write_bytes(data)
    for read in (read_toml, lambda one: parse_json(read_text(one), str(one))):
        message = ""
        try:
            read(path)
        except FileError as error:
            message = str(error)
        assert "\n" not in message


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "1" * 5000, "", '{"a": 1, "b": 2, "a": 3}'])
def test_json_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(FileError, match=r"x\.json: not valid JSON"):
        parse_json(text, "x.json")


def test_what_a_message_shows_is_one_short_line() -> None:
    with pytest.raises(FileError) as caught:
        Table(parse_toml('"c\\nd" = 1', "x.toml"), "x.toml").done()
    assert "\n" not in str(caught.value)
    with pytest.raises(FileError) as caught:
        Table({"a": "x\n" * 10_000}, "x.toml").number("a", 0, 1)
    assert len(str(caught.value)) < 200
    assert "\n" not in str(caught.value)


def test_only_regular_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    large = tmp_path / "large"
    large.write_bytes(b"")
    os.truncate(large, 6_000_000_000)
    for path, words in (
        (tmp_path / "pipe", "is a named pipe; expected a file"),
        (Path("/dev/zero"), "is a device; expected a file"),
        (tmp_path, "cannot be read: is a directory; expected a file"),
        (large, "is too large: 6,000 MB, expected 67 MB at most"),
        (tmp_path / "none", "No such file"),
    ):
        for read in (read_bytes, read_text):
            with pytest.raises(FileError, match=words):
                read(path)
    with pytest.raises(FileError, match="too large: 6,000 MB, expected 268 MB"):
        sha256(large)


def test_a_file_of_proc_has_no_size_and_is_read() -> None:
    if Path("/proc/self/status").exists():
        assert read_text(Path("/proc/self/status")).startswith("Name:")


def test_what_fails_while_a_file_is_made_is_told_of_that_file(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with pytest.raises(FileError) as caught, partial(path) as temporary:
        raise FileError("cannot be written: No space left on device", str(temporary))
    assert str(caught.value) == f"{path}: cannot be written: No space left on device"
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileError, match=r"^other: is another$"), partial(path):
        raise FileError("is another", "other")


def test_a_folder_that_cannot_be_looked_into_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("b/c.csv", "a.csv", "b/d/.e"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "loop").symlink_to(tmp_path)
    found = [path.relative_to(tmp_path).as_posix() for path in all_below(tmp_path)]
    assert found == ["a.csv", "b/c.csv", "b/d/.e"]
    scan = os.scandir

    def refused(folder: str) -> object:
        if str(folder).endswith("/d"):
            raise PermissionError(13, "Permission denied", str(folder))
        return scan(folder)

    monkeypatch.setattr(os, "scandir", refused)
    with pytest.raises(FileError, match=r"b/d: cannot be read: Permission denied"):
        all_below(tmp_path)
