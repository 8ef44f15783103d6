"""Logs that are small on the disk and would be large in memory."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from robolamp.errors import FileError
from robolamp.log import mcap_stream as stream
from robolamp.log.cdr import LayoutError, decode, fields_of
from robolamp.log.mcap_stream import read_contents
from robolamp.log.reader import read_run
from robolamp.log.recover import recover
from robolamp.log.writer import LogWriter

from .ticks import JOINTS, make_tick

MAGIC = b"\x89MCAP0\r\n"
MIB = bytes(1 << 20)


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def record(opcode: int, data: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(data)) + data


def chunk(compression: str, packed: bytes, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + text(compression)
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


def log_of(*chunks: bytes) -> bytes:
    return MAGIC + record(1, text("") + text("")) + b"".join(chunks) + record(2, bytes(20)) + MAGIC


def zeros_zstd(mebibytes: int, *, says: bool) -> bytes:
    packer = zstandard.ZstdCompressor(write_content_size=says).compressobj(size=mebibytes << 20 if says else -1)
    return b"".join([*(packer.compress(MIB) for _ in range(mebibytes)), packer.flush()])


def zeros_lz4(mebibytes: int) -> bytes:
    packer = lz4.frame.LZ4FrameCompressor()
    return b"".join([packer.begin(), *(packer.compress(MIB) for _ in range(mebibytes)), packer.flush()])


BOMBS = {
    "4 GiB by its own word": lambda: chunk("zstd", zeros_zstd(4096, says=True), 4096 << 20),
    "1 GiB without a word": lambda: chunk("zstd", zeros_zstd(1024, says=False), 1024 << 20),
    "a lie": lambda: chunk("zstd", zeros_zstd(1024, says=False), 100),
    "lz4": lambda: chunk("lz4", zeros_lz4(256), 256 << 20),
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_chunk_that_unpacks_to_gigabytes_is_refused_in_little_memory(tmp_path: Path, bomb: str) -> None:
    path = tmp_path / "bomb.mcap"
    path.write_bytes(log_of(BOMBS[bomb]()))
    assert path.stat().st_size < 2_000_000
    tracemalloc.start()
    try:
        with pytest.raises(FileError, match=r"bomb\.mcap: byte 25: a chunk unpacks to more than 67 MB") as caught:
            read_contents(path)
        assert tracemalloc.get_traced_memory()[1] < 200_000_000
    finally:
        tracemalloc.stop()
    assert "\n" not in str(caught.value)
    with pytest.raises(FileError, match="holds no message that can be recovered"):
        recover(path, tmp_path / "out.mcap")


def test_what_stands_around_such_a_chunk_can_be_recovered(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path, context={"goal_m": "0.3", "control_period": "0.02"}, joints=JOINTS, now=100.0) as log:
        for index in range(50):
            log.tick(make_tick(index))
    whole = path.read_bytes()
    found = stream._CHUNK.search(whole)
    assert found is not None
    bent = whole[: found.start()] + BOMBS["1 GiB without a word"]() + whole[found.start() :]
    path.write_bytes(bent)
    with pytest.raises(FileError, match="unpacks to more than"):
        read_run(path)
    saved = recover(path, tmp_path / "saved.mcap")
    assert len(saved.damage) == 1
    assert len(read_run(saved.file).index) == 50


@pytest.mark.parametrize("size", [10, 1 << 40])
def test_a_chunk_of_another_size_than_it_says_is_damage(tmp_path: Path, size: int) -> None:
    path = tmp_path / "bent.mcap"
    path.write_bytes(log_of(chunk("zstd", zeros_zstd(1, says=True), size)))
    contents = read_contents(path)
    assert contents.truncated
    assert contents.damage == [f"byte 25: a damaged chunk (1048576 bytes unpacked, expected {size})"]


def test_messages_beyond_all_bounds_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "_MOST_KEPT", 100_000)
    path = tmp_path / "many.mcap"
    messages = b"".join(record(5, struct.pack("<HIQQ", 1, 0, 0, 0)) for _ in range(1000))  # 31 bytes each
    path.write_bytes(log_of(chunk("", messages, len(messages))))
    with pytest.raises(FileError, match=r"its messages take more than 0 MB; expected the log of one run"):
        read_contents(path)


@pytest.mark.parametrize("length", [1 << 62, (1 << 64) - 1, 1 << 33])
def test_a_record_longer_than_the_file_is_damage(tmp_path: Path, length: int) -> None:
    path = tmp_path / "long.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", 5, length) + bytes(100))
    with pytest.raises(
        FileError, match=r"holds no /lamp/tick messages.*the file ends early, in the middle of a record"
    ):
        read_run(path)


@pytest.mark.parametrize("last", ["int8 x\n", "\n"])
def test_a_message_type_that_doubles_with_each_line_is_refused(last: str) -> None:
    types = [f"pkg/T{n + 1} a\npkg/T{n + 1} b\n" for n in range(24)]
    definition = types[0] + "".join(f"{'=' * 80}\nMSG: pkg/T{n + 1}\n{body}" for n, body in enumerate(types[1:]))
    with pytest.raises(LayoutError, match="more than 1000 lines"):
        fields_of(definition + f"{'=' * 80}\nMSG: pkg/T24\n{last}")


def test_one_long_sequence_does_not_widen_all_messages_without_end() -> None:
    def message(count: int) -> bytes:
        return b"\x00\x01\x00\x00" + struct.pack("<I", count) + bytes(count)

    messages = [message(0)] * 10_000 + [message(10_000)]
    with pytest.raises(LayoutError, match="values: 10001 messages of up to 10000 values are too many"):
        decode("uint8[] values", messages, ["values"])
