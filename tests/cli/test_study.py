"""`robolamp study` on runs so small that they take a second."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from PIL import Image

from robolamp.evolve.study.study_runs import Shelf

from .test_main import call

TINY = [
    word
    for setting in ("gp.population=6", "gp.generations=3", "duration=0.3", "timestep=0.004", "cases.count=1")
    for word in ("--set", setting)
]
TIMES = ("physics_s", "wall_s")


def told(run: Path) -> list[dict]:
    lines = [json.loads(line) for line in (run / "progress.jsonl").read_text().splitlines()]
    return [{key: value for key, value in line.items() if key not in TIMES} for line in lines]


def stamps(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def test_an_axis_end_to_end(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("study", "selection", "-o", tmp_path / "runs", "--points", "proportionate,6", "--seeds", 2, *TINY)
    code, out, err = call(capsys, *words, "--json")
    assert (code, err) == (0, "")
    said = json.loads(out)
    assert (said["runs"], said["finished"]) == (4, 4)
    assert [verdict["study"] for verdict in said["verdicts"]] == ["selection", "selection"]
    assert {verdict["verdict"] for verdict in said["verdicts"]} <= {"agrees", "does not agree", "cannot tell"}
    with Image.open(said["pictures"][0]) as image:
        assert (image.format, image.size) == ("PNG", (1200, 520))
    page = Path(said["report"]).read_text()
    assert "robolamp study selection -o runs --seeds 2 --points proportionate,6 --set cases.count=1" in page
    assert str(tmp_path) not in page
    runs = tmp_path / "runs" / "luxo-1997"
    names = {f"m6-g3-{kind}-pc90-nfc1-s{seed}" for kind in ("proportionate", "tournament6") for seed in (1, 2)}
    assert {path.name for path in runs.iterdir() if path.is_dir()} == names
    assert all(len(told(runs / name)) == 3 for name in names)
    # Again: nothing is run, and another study takes over what it shares.
    before = stamps(runs)
    assert call(capsys, *words, "--json")[1] == out
    assert stamps(runs) == before
    more = ("study", "crossover", "-o", tmp_path / "runs", "--points", "90", "--seeds", 2, *TINY, "--json")
    assert json.loads(call(capsys, *more)[1])["finished"] == 2
    assert stamps(runs) == before


def test_a_killed_study_goes_on_as_if_it_had_not_been(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ["study", "selection", "--points", "2", "--seeds", "1", "--workers", "1", "--set", "gp.population=40",
             "--set", "gp.generations=12", "--set", "duration=0.3", "--set", "timestep=0.004"]  # fmt: skip
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    name = Path("luxo-1997") / "m40-g12-tournament2-pc90-nfc3-s1"
    process = subprocess.Popen([sys.executable, "-m", "robolamp", *words, "-o", str(killed)], stderr=subprocess.DEVNULL)
    progress, deadline = killed / name / "progress.jsonl", time.monotonic() + 60
    while not (progress.exists() and progress.read_text().count("\n") >= 2) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert 2 <= len(told(killed / name)) < 12
    code, out, _ = call(capsys, *words, "-o", killed, "--draw-only")
    assert code == 0
    assert "0 of 1 run finished" in out
    for folder in (killed, whole):
        code, out, _ = call(capsys, *words, "-o", folder)
        assert code == 0
        assert "1 of 1 run finished" in out
    assert told(killed / name) == told(whole / name)
    assert len(told(whole / name)) == 12


def test_a_run_stopped_before_its_first_checkpoint_is_begun_again(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    stump = tmp_path / "luxo-1997" / "m6-g3-tournament6-pc90-nfc1-s1"
    stump.mkdir(parents=True)
    (stump / "run.toml").write_text("schema = 1\n")
    words = ("study", "selection", "-o", tmp_path, "--points", "6", "--seeds", 1, *TINY, "--json")
    assert json.loads(call(capsys, *words)[1])["finished"] == 1


def test_the_page_names_the_commands_that_make_what_it_shows(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    page, folder = tmp_path / "page.md", ("-o", tmp_path / "runs")
    for points, seeds in (("0", 2), ("90", 1)):
        assert call(capsys, "study", "crossover", *folder, "--points", points, "--seeds", seeds, *TINY)[0] == 0
    words = ("--draw-only", "--report", page)
    assert call(capsys, "study", "crossover", *folder, *words)[0] == 0
    commands = re.findall("^robolamp study .*$", page.read_text(), re.MULTILINE)
    assert [re.sub(" --set [^ ]+", "", command) for command in commands] == [
        "robolamp study crossover -o runs --seeds 2 --points 0 --report page.md",
        "robolamp study crossover -o runs --seeds 1 --points 90 --report page.md",
    ]


def test_a_page_of_all_studies_names_those_of_each(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    page, folder = tmp_path / "page.md", ("-o", tmp_path / "runs")
    small = ("--set", "duration=0.1", "--set", "timestep=0.004")
    assert call(capsys, "study", "population", *folder, "--points", "10", "--seeds", 1, *small)[0] == 0
    assert call(capsys, "study", "all", *folder, "--draw-only", "--report", page)[0] == 0
    assert re.findall("^robolamp study .*$", page.read_text(), re.MULTILINE) == [
        f"robolamp study population -o runs --seeds 1 --points 10 {' '.join(small)}",
        "robolamp study all -o runs --draw-only --report page.md",
    ]


def test_drawing_only_takes_the_scale_from_the_runs(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("study", "crossover", "-o", tmp_path / "runs")
    assert call(capsys, *words, "--points", "90", "--seeds", 1, *TINY)[0] == 0
    page = tmp_path / "docs" / "studies.md"
    code, out, err = call(capsys, *words, "--draw-only", "--report", page)
    assert (code, err) == (0, "")
    assert "1 of 21 runs finished" in out
    assert "`gp.population=6`" in page.read_text()
    assert (tmp_path / "docs" / "studies" / "crossover.png").exists()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["figures"], "study: 'figures' is not one of population, generations, .* representation, all"),
        (["population", "--points", "60"], "--points: '60' is not a point of population: 10, 50"),
        (["all", "--points", "50,100"], "--points: '50,100': all studies together take paper or small"),
        (["population", "--set", "gp.population=7"], "--set: gp.population is what the study population varies"),
        (["population", "--set", "gp.colour=7"], "gp.colour: unknown"),
        (["population", "--set", "gp.depth"], "is not KEY=VALUE"),
        (["population", "--seeds", "0"], "--seeds"),
        (["population", "--report", "page.txt"], "--report: 'page.txt' does not end in .md"),
        (["population", "--draw-only"], "runs: holds no runs of studies yet"),
        (["population", "--calibration", "none"], "none: no such calibration"),
    ],
)
def test_what_cannot_be_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = call(capsys, "study", *words, "-o", "runs")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert re.search(line, err), err
    assert list(tmp_path.iterdir()) == []


def test_another_scale_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("study", "crossover", "-o", tmp_path, "--points", "90", "--seeds", 1)
    assert call(capsys, *words, *TINY)[0] == 0
    before = stamps(tmp_path)
    code, out, _ = call(capsys, *words, "--json", "--set", "duration=1")
    assert code == 2
    assert "they would not compare" in json.loads(out)["error"]
    assert stamps(tmp_path) == before


def test_two_at_work_in_one_folder_are_one_too_many(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("study", "crossover", "-o", tmp_path, "--points", "90", "--seeds", 1, *TINY)
    with Shelf(tmp_path).alone():
        code, out, err = call(capsys, *words)
        assert (code, out) == (2, "")
        assert "another robolamp is at work here" in err
    assert call(capsys, *words)[0] == 0


def test_it_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = call(capsys, "study", "--help")
    assert (code, err) == (0, "")
    assert "Figures 5 to 8" in out
    for option in ("--points", "--seeds", "--set", "--report", "--draw-only", "--json"):
        assert option in out
