"""Runs of emulated lamps: what differs is named, what changed is named, folders, and the controller to the bit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robolamp.cli.main import main
from robolamp.compare.causes.evidence import Evidence
from robolamp.compare.causes.ranking import explain
from robolamp.compare.folder.folder_runs import _travel, compare_folder
from robolamp.compare.replays.controller_replay import replay_controller
from robolamp.emulator.reality.file import Reality
from robolamp.errors import FileError
from robolamp.log.reader import read_run

from .emulated import hop
from .lamps import ASSETS, CALIBRATION, LAMP, write_run

NONE = Reality.none(LAMP)
WEAK = replace(NONE, strength=np.array([1.0, 0.9, 1.0]))


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    return hop(tmp_path_factory.mktemp("straight") / "log.mcap", NONE)


@pytest.fixture(scope="module")
def weak(tmp_path_factory):
    return hop(tmp_path_factory.mktemp("weak") / "log.mcap", WEAK, day=1)


def call(capsys, *words) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as caught:
        main(["compare", *map(str, words)])
    out, err = capsys.readouterr()
    return int(caught.value.code or 0), out, err


def test_the_controller_gives_the_logged_goals_to_the_bit_and_a_bent_log_says_from_where_not(straight):
    run = read_run(straight)
    again = replay_controller(run, LAMP)
    assert (again.exact, again.first, again.ticks) == (True, -1, 200)
    row = int(np.flatnonzero(run.phase == "run")[40])
    run.goal[row] = np.nextafter(run.goal[row], 9.0)
    bent = replay_controller(run, LAMP)
    assert (bent.exact, bent.first, bent.what) == (False, int(run.index[row]), "goals")


def test_nothing_is_named_on_a_lamp_that_nothing_bends(straight):
    assert explain(Evidence(read_run(straight), LAMP, CALIBRATION, ASSETS), LAMP).causes == ()


def test_a_log_says_how_long_answers_are_on_the_wire(straight):
    run = read_run(straight)
    assert run.answer_wire == pytest.approx(float(np.mean(run.read_done - run.began)), abs=5e-6)


@pytest.mark.slow
def test_a_noisy_encoder_is_named_first_with_its_size(tmp_path):
    sizes = []
    for seed in range(1, 10):
        noisy = replace(NONE, encoder_noise=np.array([0.0, 0.0, 0.0015]), seed=seed)
        log = hop(tmp_path / f"{seed}.mcap", noisy)
        first = explain(Evidence(read_run(log), LAMP, CALIBRATION, ASSETS), LAMP).causes[0]
        assert first.name == "encoder noise neck"
        sizes.append(first.size)
    assert np.median(sizes) == pytest.approx(0.0015, rel=0.2)  # of some 30 ticks at rest each
    assert max(sizes) / min(sizes) < 2.0


@pytest.mark.parametrize("latency", [0.001, 0.0015])
def test_a_line_that_holds_everything_up_is_named_first_with_its_size(latency, tmp_path):
    log = hop(tmp_path / "log.mcap", replace(NONE, latency=latency))
    first = explain(Evidence(read_run(log), LAMP, CALIBRATION, ASSETS), LAMP).causes[0]
    assert first.name == "latency"
    assert first.size == pytest.approx(latency, rel=0.25)


def test_a_weak_knee_in_the_emulator_is_named_first_with_its_size(weak, tmp_path, capsys):
    truth = weak.with_name("truth.mcap")
    code, out, err = call(capsys, weak, "--truth", truth, "--json", "-o", tmp_path / "r.html")
    result = json.loads(out)
    good = result["verdict"] == "inside" and result["task"] != "not done"
    assert (code, err) == (0 if good else 1, "")
    first = result["diagnosis"][0]
    assert first["knob"] == "strength knee"
    assert first["size"] == pytest.approx(-0.10, abs=0.02)
    assert result["controller_exact"] is True
    assert len(result["flights"]) >= 3
    far = abs(result["travel_m"] - result["twin_travel_m"]) > 0.05
    assert (result["parted_s"] is not None) == (far or any("MAE" in line for line in result["exceeded"]))
    assert result["flights"][0]["flight_s"] == pytest.approx(result["flights"][0]["twin_flight_s"], abs=0.04)


@pytest.mark.slow
def test_yesterdays_lamp_against_todays_names_what_changed_whichever_is_named_first(straight, weak, tmp_path, capsys):
    code, out, _ = call(capsys, straight, weak, "--json", "-o", tmp_path / "ab.html")
    result = json.loads(out)
    assert code in (0, 1)
    assert result["against"] == str(straight)  # the earlier one
    assert result["twin_log"] is None
    assert result["diagnosis"][0]["cause"].startswith("the knee's motor is 1")
    assert result["diagnosis"][0]["cause"].endswith("% weaker than before")
    assert (tmp_path / "ab.html").stat().st_size < 5_000_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ab.html"]


def test_two_runs_alike_differ_in_nothing(straight, tmp_path, capsys):
    code, out, _ = call(capsys, straight, straight, "--json", "--no-diagnosis", "-o", tmp_path / "aa.html")
    result = json.loads(out)
    assert (code, result["verdict"]) == (0, "inside")
    assert all(joint["mae_mrad"]["before"] < 1e-6 for joint in result["joints"])
    assert result["parted_s"] is None
    assert all(hop["off_late_ms"] == 0 for hop in result["flights"])


def test_runs_of_two_tasks_cannot_be_compared(straight, tmp_path, capsys):
    other, _ = write_run(tmp_path)
    code, out, err = call(capsys, straight, other)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "only runs of one controller" in err


def test_a_folder_tells_trend_and_correlation_and_what_it_skipped(straight, weak, tmp_path, capsys):
    for number, (name, source) in enumerate([("a", straight), ("b", weak)]):
        folder = tmp_path / f"run-{number}"
        folder.mkdir()
        (folder / "log.mcap").write_bytes(source.read_bytes())
        (folder / "truth.mcap").write_bytes(source.with_name("truth.mcap").read_bytes())
        assert name
    (tmp_path / "broken.mcap").write_text("no log")
    (tmp_path / "travel.csv").write_text("log,travel_m\nrun-0/log.mcap,0.111\n")
    code, out, err = call(capsys, tmp_path, "--json")
    result = json.loads(out)
    assert (code, err) == (0, "")
    assert [row["log"].endswith("log.mcap") for row in result["runs"]] == [True, True]
    assert result["runs"][0]["travel_m"] == 0.111  # the ruler, not the truth
    assert result["runs"][0]["landing_error_m"] == pytest.approx(0.189)
    assert result["runs"][0]["mae_mrad"] < result["runs"][1]["mae_mrad"]
    assert result["srcc"] == {"landing_error": None, "travel": None, "hops": None, "controllers": 1}
    assert [entry["why"] for entry in result["skipped"]] == [
        "is not an MCAP log (it does not begin with the MCAP magic)"
    ]
    page = (tmp_path / "compare.html").read_text()
    assert "2 runs" in page
    assert page.count("<svg") == 3


def test_the_correlation_is_pearsons_over_controllers(straight):
    folder = compare_folder(straight.parent, assets=ASSETS, calibration=CALIBRATION)
    lamp, twin = [0.02, 0.05, 0.03, 0.09], [0.01, 0.06, 0.02, 0.05]
    rows = []
    for number in range(8):
        own = number % 4
        travels = {"travel": 0.3 + lamp[own], "twin_travel": 0.3 + twin[own]}
        rows.append(replace(folder.rows[0], controller=str(own), goal=0.3, **travels))
    value, count = replace(folder, rows=tuple(rows)).correlation(lambda row: row.score, lambda row: row.twin_score)
    assert (value, count) == (pytest.approx(float(np.corrcoef(lamp, twin)[0, 1])), 4)


def test_an_empty_folder_is_2(tmp_path, capsys):
    code, _, err = call(capsys, tmp_path)
    assert (code, err.count("\n")) == (2, 1)
    assert "holds no log" in err


@settings(max_examples=60, deadline=None)
@given(st.lists(st.text(max_size=8), max_size=4))
def test_any_line_of_travel_csv_is_read_or_refused_in_one_line(fields):
    try:
        found = _travel(fields, "travel.csv, line 2")
    except FileError as error:
        message = error.message
    else:
        message = ""
        assert len(found) <= 1
    assert "\n" not in message.replace(",".join(fields), "")
