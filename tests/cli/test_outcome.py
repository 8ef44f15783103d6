"""What is told and left behind of a run: none, one that was refused, one whose report was interrupted."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from robolamp.cli.options import Setup
from robolamp.cli.run.drive import Drive
from robolamp.cli.run.outcome import concluded, reported, tell, tell_of_none, tidying
from robolamp.errors import BusError
from robolamp.runtime.result import RunResult

SETUP = Setup.of(None, "nominal")


def plan(folder: Path) -> Drive:
    return Drive(SETUP, SETUP.controller("hop"), 0.3, 1.0, "lamp", folder / "log.mcap")


def fail(made: Drive, *files: Path) -> None:
    """Write a run's files, and be refused."""
    made.log.parent.mkdir(parents=True, exist_ok=True)
    for path in (made.log, *files):
        path.write_text("")
    raise BusError("no answer")


def test_a_run_that_never_began_says_why(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    result = RunResult(ended="cut", reason="knee: [red] no answer", faults={"[/b]": 1})
    assert tell_of_none(plan(tmp_path), result, as_json=False) == 1
    out = capsys.readouterr().out
    assert out.startswith("cut: knee: [red] no answer\n")
    assert "[/b] (x1)" in out
    assert tell_of_none(plan(tmp_path), result, as_json=True) == 1
    said = json.loads(capsys.readouterr().out)
    assert (said["ended"], said["reason"]) == ("cut", "knee: [red] no answer")
    assert said["verdict"] is said["report"] is said["landed_m"] is None


def test_what_is_told_is_not_markup(capsys: pytest.CaptureFixture[str]) -> None:
    tell("[/b]", " in out/[a]")
    assert capsys.readouterr().out == "[/b] in out/[a]\n"


def test_a_refusal_leaves_nothing_of_its_own(tmp_path: Path) -> None:
    refused = plan(tmp_path / "new" / "run")
    with pytest.raises(BusError), tidying(refused, refused.log.with_name("truth.mcap")):
        fail(refused, refused.log.with_name("truth.mcap"))
    assert not list(tmp_path.iterdir())


def test_a_refusal_leaves_what_was_there(tmp_path: Path) -> None:
    refused = plan(tmp_path)
    (tmp_path / "truth.mcap").write_text("mine")
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(BusError), tidying(refused, tmp_path / "truth.mcap"):
        fail(refused)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes", "truth.mcap"]


def test_a_run_that_failed_later_keeps_its_log(tmp_path: Path) -> None:
    begun = plan(tmp_path / "run")
    begun.phases["start"] += 1
    with pytest.raises(BusError), tidying(begun):
        fail(begun)
    assert begun.log.is_file()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP])
def test_a_report_that_is_interrupted_can_be_made_later(
    capsys: pytest.CaptureFixture[str], number: signal.Signals
) -> None:
    before, failures = signal.getsignal(number), []
    log = Path("runs/my run/log.mcap")
    assert reported(lambda: os.kill(os.getpid(), number), failures, log) is None
    assert reported(lambda: "another report", failures, log) is None, "Ctrl-C ends what follows, too"
    assert concluded(0, failures) == 130
    assert "log is at runs/my run/log.mcap; `robolamp compare 'runs/my run/log.mcap'`" in capsys.readouterr().err
    assert signal.getsignal(number) is before
