"""What is made of a log: a summary, a table, a whole log of a broken one."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from arro3.io import read_parquet
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from robolamp.cli.main import main
from robolamp.errors import FileError
from robolamp.log import writer as writer_module
from robolamp.log.reader import read_run
from robolamp.log.recover import recover
from robolamp.log.run_table import columns_of, export
from robolamp.log.summary import summarise
from robolamp.log.writer import LogWriter

from .test_trouble import many_chunks
from .ticks import JOINTS, make_tick

CONTEXT = {
    "backend": "twin",
    "goal_m": "0.3",
    "control_period": "0.02",
    "terminals": "t a0 a1 s0",
    "controller": "(x)\n",
}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """25 ticks, two of them missing, and an event."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with LogWriter(path, context=CONTEXT, joints=JOINTS, now=100.0) as log:
        for index in range(25):
            if index not in (10, 11):
                log.tick(make_tick(index))
        log.event("warning", "knee: hot", at=100.3)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return many_chunks(tmp_path_factory.mktemp("log") / "run.mcap", 40)


def call(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return int(ended.value.code or 0), *capsys.readouterr()


@pytest.mark.parametrize("verb", ["info", "export", "recover"])
def test_every_verb_explains_itself(capsys: pytest.CaptureFixture[str], verb: str) -> None:
    assert f"\n│ {verb}" in call(capsys, "log", "--help")[1]
    code, out, err = call(capsys, "log", verb, "--help")
    assert (code, err) == (0, "")
    assert f"robolamp log {verb}" in out
    assert "--json" in out


def test_info_tells_what_a_log_holds(capsys: pytest.CaptureFixture[str], log: Path) -> None:
    code, out, _ = call(capsys, "log", "info", log, "--json")
    said = json.loads(out)
    assert code == 0
    assert said["ticks"] == 23
    assert said["missed_ticks"] == 2
    assert said["gaps"] == [{"at_s": pytest.approx(0.18), "length_s": pytest.approx(0.06)}]
    assert said["faults"] == {"knee: no answer": 5}
    assert said["phases"] == {"start": 2, "run": 21}
    assert said["events"] == [{"at_s": pytest.approx(0.2999), "level": "warning", "text": "knee: hot"}]
    assert said["topics"] == {"/lamp/events": 1, "/lamp/goals": 23, "/lamp/measured": 23, "/lamp/tick": 23}
    assert said["duration_s"] == pytest.approx(0.48, abs=0.01)
    assert (said["voltage_V"], said["max_current_A"], said["max_temperature_degC"]) == ([5.0, 5.0], 0.12, 31.0)
    assert (said["truncated"], said["damage"], said["context"]["goal_m"]) == (False, [], "0.3")
    code, out, _ = call(capsys, "log", "info", log)
    for text in ("whole", "23 at 50 Hz", "2 missed", "60 ms at 0.18 s", "knee: no answer (5 ticks)", "knee: hot"):
        assert text in out, text
    assert call(capsys, "log", "info", log, "--text", "controller") == (0, "(x)\n", "")
    code, _, err = call(capsys, "log", "info", log, "--text", "colour")
    assert (code, err.count("\n")) == (2, 1)
    assert "has no 'colour'; it has backend, control_period, controller" in err


def test_info_of_a_cut_log_says_where_it_ends(tmp_path: Path, whole: Path) -> None:
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    summary = summarise(cut)
    assert summary.truncated
    assert 0 < summary.ticks < 40
    [line] = summary.damage
    assert line.endswith("the file ends early, in the middle of a record")
    cut.write_bytes(data[:300])
    with pytest.raises(FileError, match=r"holds no messages: byte .* ends early"):
        summarise(cut)


def test_a_table_holds_every_value(tmp_path: Path, capsys: pytest.CaptureFixture[str], log: Path) -> None:
    run = read_run(log)
    table = tmp_path / "t.csv"
    code, out, _ = call(capsys, "log", "export", log, "-o", table, "--json")
    said = json.loads(out)
    assert (code, said["rows"], said["truncated"]) == (0, 23, False)
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == said["columns"] == list(columns_of(run))
    assert [row["knee_angle_rad"] == "" for row in rows] == np.isnan(run.angle[:, 1]).tolist()
    known = np.isfinite(run.angle[:, 1])
    assert [float(row["knee_angle_rad"]) for row in rows if row["knee_angle_rad"]] == run.angle[known, 1].tolist()
    assert [float(row["neck_goal_rad"]) for row in rows] == run.goal[:, 2].tolist()
    assert [int(row["unix_time_ns"]) for row in rows] == run.log_time.tolist()
    assert float(rows[0]["began_s"]) == 0.0
    assert {row["faults"] for row in rows} == {"", "knee: no answer"}
    assert rows[0]["input_s0"] == ""
    assert float(rows[5]["input_s0"]) == run.inputs[5, 3]


def test_parquet_holds_the_same_as_csv_and_the_context(tmp_path: Path, log: Path) -> None:
    run = read_run(log)
    columns = export(run, tmp_path / "t.parquet")
    table = read_parquet(tmp_path / "t.parquet").read_all()
    assert table.column_names == columns
    assert (table.shape[0], table["phase"][0].as_py(), table["faults"][4].as_py()) == (23, "start", "knee: no answer")
    found = [float("nan") if math.isnan(value.as_py()) else value.as_py() for value in table["knee_angle_rad"]]
    np.testing.assert_array_equal(found, run.angle[:, 1])
    assert [value.as_py() for value in table["unix_time_ns"]] == run.log_time.tolist()


def test_a_table_of_no_known_format_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], log: Path) -> None:
    code, _, err = call(capsys, "log", "export", log, "-o", tmp_path / "t.xls")
    assert (code, err.count("\n")) == (2, 1)
    assert "'.xls' is no format of tables; expected .csv or .parquet" in err
    assert not list(tmp_path.iterdir())


def stock(path: Path) -> dict[str, int]:
    """Messages by topic, read through the index and decoded by the libraries of MCAP and ROS 2 alone."""
    counts: dict[str, int] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        for _, channel, _, _ in reader.iter_decoded_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
        assert summary.statistics.message_count == sum(counts.values())
        assert [record.name for record in reader.iter_metadata()] == ["robolamp"]
    return counts


def test_a_cut_log_is_made_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str], whole: Path) -> None:
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(0.7 * len(data))])
    before = read_run(cut)
    code, out, _ = call(capsys, "log", "recover", cut, "--json")
    said = json.loads(out)
    assert (code, said["left_out"], len(said["damage"])) == (0, 0, 1)
    made = Path(said["log"])
    assert made == tmp_path / "cut.recovered.mcap"
    assert stock(made) == said["messages"]
    after = read_run(made)
    assert not after.truncated
    assert after.context == before.context
    np.testing.assert_array_equal(after.angle, before.angle)
    np.testing.assert_array_equal(after.log_time, before.log_time)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.0, 1.0), length=st.integers(1, 3000), filling=st.sampled_from([0, 6, 255]))
def test_what_lies_behind_a_damaged_place_is_saved(
    tmp_path: Path, whole: Path, share: float, length: int, filling: int
) -> None:
    data = bytearray(whole.read_bytes())
    place = 8 + int(share * (len(data) - 8))
    data[place : place + length] = bytes([filling]) * len(data[place : place + length])
    broken, made = tmp_path / "broken.mcap", tmp_path / "made.mcap"
    broken.write_bytes(data)
    try:
        found = recover(broken, made)
    except FileError as error:  # the chunk that names the topics is gone, and the summary's copy too
        assert "no message that can be recovered" in str(error)  # noqa: PT017
        return
    if "/lamp/tick" not in found.messages:
        return
    run = read_run(made)
    assert not run.truncated
    for row, index in enumerate(run.index):
        np.testing.assert_array_equal(run.goal[row], make_tick(int(index)).goal)
        np.testing.assert_array_equal(run.angle[row], make_tick(int(index)).observation.angle)
    chunk = len(data) / 40  # at most so large
    if place > 3 * chunk:  # the topics' names were spared
        assert run.index.size >= 40 - (length / (0.25 * chunk)) - 3


def test_ticks_that_lost_a_message_with_a_chunk_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A chunk that is full ends in the middle of a tick: what is left of that tick must not be laid to another's."""
    path = tmp_path / "run.mcap"
    original = writer_module.Writer
    monkeypatch.setattr(writer_module, "Writer", lambda stream: original(stream, chunk_size=3000))
    with LogWriter(path, context=CONTEXT, joints=JOINTS, now=100.0) as log:
        for index in range(60):
            log.tick(make_tick(index))
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 255
    path.write_bytes(data)
    made = tmp_path / "made.mcap"
    found = recover(path, made)
    assert len(set(found.messages.values())) > 1  # topics have lost different ticks
    run = read_run(made)
    assert 40 < run.index.size < 60
    for row, index in enumerate(run.index):
        tick = make_tick(int(index))
        np.testing.assert_array_equal(run.goal[row], tick.goal)
        np.testing.assert_array_equal(run.angle[row], tick.observation.angle)


def test_recovering_refuses_what_it_cannot_do(tmp_path: Path, capsys: pytest.CaptureFixture[str], whole: Path) -> None:
    (tmp_path / "empty.mcap").write_bytes(b"\x89MCAP0\r\n")
    for words, told in (
        ((whole, "-o", whole), "is the log itself"),
        ((tmp_path / "empty.mcap",), "holds no message that can be recovered (byte 8: the file ends early)"),
        ((tmp_path / "none.mcap",), "No such file"),
        ((Path(__file__),), "not an MCAP log"),
    ):
        code, out, err = call(capsys, "log", "recover", *words)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert told in err
    assert call(capsys, "log", "recover", whole, "-o", tmp_path / "copy.mcap")[1].startswith(
        f"{whole}: nothing was wrong"
    )
