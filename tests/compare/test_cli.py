"""`robolamp compare` from the outside: exit codes and output."""

from __future__ import annotations

import json
import re

import pytest

from robolamp.cli.main import main
from robolamp.twin.bend import Bend

from .lamps import write_run


def call(capsys, *words) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as caught:
        main(["compare", *map(str, words)])
    out, err = capsys.readouterr()
    return int(caught.value.code or 0), out, err


def test_inside_but_not_at_the_goal_is_1_and_the_report_lands_beside_the_log(tmp_path, capsys):
    log, truth = write_run(tmp_path)
    code, out, err = call(capsys, log, "--truth", truth, "--no-diagnosis")
    assert (code, err) == (1, "")
    task, verdict, alone = out.splitlines()[:3]
    assert re.match(r"Did it do the task\? +Not done\. Landed at 0\.0 cm for a goal of 30\.0 cm", task)
    assert re.match(r"Does the twin explain it\? +Inside tolerances\.", verdict)
    assert re.match(r"And its controller alone on the twin\? +Not known\. It could not be run", alone)
    assert out.endswith(f"report: {tmp_path / 'run.html'}\n")
    assert (tmp_path / "run.html").stat().st_size > 10_000


def test_outside_is_1_and_json_holds_the_numbers(tmp_path, capsys):
    log, _ = write_run(tmp_path, Bend(delay=0.03))
    code, out, err = call(capsys, log, "--json", "-o", tmp_path / "out" / "r.html")
    result = json.loads(out)
    assert (code, err, out.count("\n")) == (1, "", 1)
    assert result["verdict"] == "outside"
    assert [joint["name"] for joint in result["joints"]] == ["ankle", "knee", "neck"]
    for joint in result["joints"]:
        assert joint["lag_ms"] == pytest.approx(30.0, abs=2.0)
        for key in ("mae_mrad", "rmse_mrad"):
            assert joint[key]["after"] < joint[key]["before"]
    assert result["hops"] == 3
    assert set(result["diagnosis"][0]) == {"cause", "evidence", "remedy", "knob", "size", "unit", "share"}
    assert result["diagnosis"][0]["knob"] == "delay"
    assert result["report"] == str(tmp_path / "out" / "r.html")
    assert (tmp_path / "out" / "r.twin.mcap").is_file()


@pytest.mark.parametrize("extra", [("--calibration", "none.toml"), ("--tolerances", "none"), ("--lamp", "none")])
def test_what_cannot_be_compared_is_2(tmp_path, capsys, extra):
    log, _ = write_run(tmp_path)
    code, out, err = call(capsys, log, *extra)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "none" in err
    assert not (tmp_path / "run.html").exists()


def test_a_log_that_is_none_is_2_with_json(tmp_path, capsys):
    (tmp_path / "run.mcap").write_text("no log")
    code, out, err = call(capsys, tmp_path / "run.mcap", "--json")
    assert (code, err) == (2, "")
    assert json.loads(out) == {
        "error": "is not an MCAP log (it does not begin with the MCAP magic)",
        "where": str(tmp_path / "run.mcap"),
    }


def test_help_explains_the_exit_codes(capsys):
    code, out, _ = call(capsys, "--help")
    assert code == 0
    said = " ".join(out.split())
    assert "Exit code 0: all differences are inside the tolerances" in said
    assert "nothing says that the task was not done; 1:" in said
    assert "2: could not compare." in said
