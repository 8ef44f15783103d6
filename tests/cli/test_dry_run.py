"""`robolamp dry-run`: the main job, as a user runs it, and what it refuses."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from robolamp.log.reader import read_run, read_truth

COMMAND = [sys.executable, "-m", "robolamp"]


def robolamp(*words: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *words], cwd=cwd, capture_output=True, text=True, timeout=280, check=False,
        env={**os.environ, **environment},
    )  # fmt: skip


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """One dry run on an unbent lamp, in lockstep: its folder, and what it said."""
    folder = tmp_path_factory.mktemp("dry-run")
    words = ("--goal", "20cm", "--reality", "none", "--lockstep", "-o", "run", "--json")
    done = robolamp("dry-run", "hop", *words, cwd=folder, MUJOCO_GL="0")  # pictures by OpenGL
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_it_hops_to_the_goal(ran: tuple[Path, dict]) -> None:
    _, said = ran
    assert said["goal_m"] == 0.2
    assert said["ended"] == "finished"
    assert not said["fell"]
    assert said["hops"] >= 2
    assert 2 <= said["hops_flown"] <= said["hops"]
    assert abs(said["error_m"]) < 0.05
    assert said["error_m"] == pytest.approx(said["landed_m"] - 0.2)


def test_what_it_says_is_in_its_files(ran: tuple[Path, dict]) -> None:
    folder, said = ran
    run, truth = read_run(folder / said["log"]), read_truth(folder / said["truth"])
    assert len(run.index) == said["ticks"]
    assert int(run.hops[-1]) == said["hops"]
    assert {"start", "run", "landing"} == set(run.phase)
    assert run.context["backend"] == "emulator"
    assert truth.base_x[-1] == pytest.approx(said["landed_m"], abs=0.05)
    assert truth.clearance.max() > 0.002
    report = (folder / said["report"]).read_text()
    assert "uPlot" in report
    assert "data:image/" in report
    assert not re.search(r"(src|href)=[\"']https?:", report), "the report is one self-contained file"


@pytest.mark.realtime
def test_in_real_time_it_ends_well_and_the_emulator_is_gone(tmp_path: Path) -> None:
    words = ("--goal", "20cm", "--reality", "none", "--duration", "5", "-o", str(tmp_path / "run"), "--json")
    done = robolamp("dry-run", "hop", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    said = json.loads(done.stdout)
    assert (said["ended"], said["fell"]) == ("finished", False)
    assert said["lockstep"] is (tmp_path / "run" / "truth.mcap.cut").exists()
    if said["lockstep"]:
        assert said["host_late_ms"] > 12, "only a busy computer is a reason to go on in lockstep"
    listed = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    assert str(tmp_path) not in listed


def test_a_folder_with_a_run_is_not_overwritten(ran: tuple[Path, dict]) -> None:
    folder, _ = ran
    before = (folder / "run" / "log.mcap").read_bytes()
    done = robolamp("dry-run", "hop", "--goal", "0.2", "-o", "run", cwd=folder)
    assert done.returncode == 2
    assert "holds a run already" in done.stderr
    assert (folder / "run" / "log.mcap").read_bytes() == before


def test_without_opengl_the_report_is_drawn(ran: tuple[Path, dict], tmp_path: Path) -> None:
    folder, said = ran
    done = robolamp("compare", str(folder / said["log"]), "-o", "report.html", cwd=tmp_path, MUJOCO_GL="off")
    assert done.returncode in (0, 1), done.stderr
    assert "data:image/" in (tmp_path / "report.html").read_text()


def test_ctrl_c_lands_the_lamp_and_reports(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, "dry-run", "hop", "--goal", "0.4", "--lockstep", "--duration", "300", "-o", "run"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr
    for line in process.stderr:
        if line.strip() == "run":
            break
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=100)
    assert process.returncode == 1, err
    assert "stopped" in out
    assert "torque off" in err
    phases = read_run(tmp_path / "run" / "log.mcap").phase.tolist()
    assert phases[-1] == "landing"
    assert phases.count("run") < 15_000


@pytest.mark.realtime
def test_ctrl_c_before_the_start_is_no_run(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, "dry-run", "hop", "--goal", "0.4", "-o", "out/[a]", "--json"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not (tmp_path / "out" / "[a]" / "truth.mcap").exists():  # the emulator is getting ready
        assert process.poll() is None
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=100)
    assert (process.returncode, err) == (1, "")
    said = json.loads(out)
    assert (said["ended"], said["reason"]) == ("stopped", "request to stop")
    assert said["verdict"] is said["report"] is None
    assert said["log"] == "out/[a]/log.mcap"


def test_in_a_terminal_it_draws_what_happens(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
    process = subprocess.Popen(
        [*COMMAND, "dry-run", "hop", "--goal", "0.1", "--duration", "1", "--lockstep", "-o", "run"],
        cwd=tmp_path, env=environment, stdin=slave, stdout=slave, stderr=slave,
    )  # fmt: skip
    os.close(slave)
    shown = b""
    try:
        while process.poll() is None or select.select([master], [], [], 0.2)[0]:
            if select.select([master], [], [], 0.2)[0]:
                try:
                    shown += os.read(master, 65536)
                except OSError:  # the last writer has closed the terminal
                    break
        assert process.wait(100) == 0
    finally:
        os.close(master)
    text = shown.decode()
    for word in ("soft start", "hopping", "soft landing", "foot", "hops", "Landed at", "report"):
        assert word in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("dry-run", "nosuch", "--goal", "0.3"), "one of: cycle, cycle-sighted, hop"),
        (("dry-run", "hop", "--goal", "far"), "--goal: 'far' is not a length"),
        (("dry-run", "hop", "--goal", "-0.3"), "is not a length"),
        (("dry-run", "hop", "--goal", "0.3", "--reality", "nosuch"), "no such reality"),
        (("dry-run", "hop", "--goal", "0.3", "--calibration", "nosuch"), "no such calibration"),
        (("dry-run", "hop", "--goal", "0.3", "--lamp", "nosuch"), "is not a folder"),
        (("deploy", "hop", "--goal", "0.3", "--port", "/dev/nosuch"), "/dev/nosuch: no such serial port"),
    ],
)
def test_bad_input_is_one_line(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    done = robolamp(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    assert not list(tmp_path.iterdir()), "nothing half-written"
    as_json = robolamp(*words, "--json", cwd=tmp_path)
    assert as_json.returncode == 2
    assert set(json.loads(as_json.stdout)) == {"error", "where"}


def test_a_controller_that_needs_more_than_the_lamp_has(tmp_path: Path) -> None:
    (tmp_path / "blind.toml").write_text('schema = 1\nname = "blind"\nexpressions = "(list px a0 (ifltz vx 1 t))"\n')
    done = robolamp("dry-run", "blind.toml", "--goal", "0.3", cwd=tmp_path)
    assert done.returncode == 2
    assert "joints.ankle: needs px, which this lamp cannot supply" in done.stderr


def test_a_malformed_expression_is_pointed_at(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('schema = 1\nname = "bad"\n[joints]\nankle = "(+ a0)"\nknee = "0"\nneck = "0"\n')
    done = robolamp("score", "bad.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert "bad.toml: joints.ankle: found ')' at line 1, column 6; expected 2 arguments of +, not 1" in done.stderr


def test_a_time_to_take_reaches_the_controller_and_the_log(tmp_path: Path) -> None:
    joints = '[joints]\nankle = "(* 0.1 goal_time)"\nknee = "0"\nneck = "0"\n'
    (tmp_path / "c.toml").write_text(f'schema = 1\nname = "c"\n{joints}')
    words = ("--goal", "0.1", "--duration", "0.5", "--reality", "none", "--lockstep", "-o", "run", "--json")
    done = robolamp("dry-run", "c.toml", "--goal-time", "1.5", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    run = read_run(tmp_path / "run" / "log.mcap")
    assert run.context["goal_time_s"] == "1.5"
    seen = run.inputs[run.phase == "run", run.terminals.index("goal_time")]
    assert (seen == 1.5).all()
    assert run.goal[run.phase == "run"][:, 0] == pytest.approx(0.15)


def test_in_lockstep_it_repeats_and_faults_are_logged(tmp_path: Path) -> None:
    script = (
        'name = "x"\nseed = 4\n[status]\ndropped = 0.01\n[[event]]\nwhat = "silent"\nat = 4\nlasts = 0.02\nservo = 1\n'
    )
    (tmp_path / "faults.toml").write_text(script)
    said = []
    for folder in ("one", "two"):
        words = ("--goal", "20cm", "--duration", "4", "--lockstep", "--faults", "faults.toml", "-o", folder, "--json")
        done = robolamp("dry-run", "hop", *words, cwd=tmp_path)
        facts = json.loads(done.stdout)
        assert (tmp_path / folder / "injections.jsonl").read_text().count("dropped") > 3
        said.append({key: facts[key] for key in ("landed_m", "hops", "ticks", "faults", "interventions", "ended")})
    assert said[0] == said[1]
    assert (tmp_path / "one/injections.jsonl").read_text() == (tmp_path / "two/injections.jsonl").read_text()
    assert any("ankle" in fault for fault in said[0]["faults"])
