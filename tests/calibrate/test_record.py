"""Recording: through the loop and the wire, resumable, guided, and never half done."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from robolamp.calibrate.lamp.session import read_session
from robolamp.calibrate.manifest import NAME, load_manifest
from robolamp.calibrate.procedure import Step, procedure
from robolamp.calibrate.recorder import Person, StepConnection
from robolamp.calibrate.servo.recordings import read_recordings
from robolamp.calibrate.servo.soundness import faults
from robolamp.cli.calibrate.record import emulated
from robolamp.errors import FileError, SafetyError
from robolamp.log.reader import read_run
from robolamp.runtime.stop import StopRequest
from tests.calibrate.sessions import LAMP, SETUP, recorded, short, steps

SOFT = short(steps("steps-soft")[0], 1.5)
DROP = steps("drop-2")[0]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("session")
    recorded(folder, [SOFT, DROP, *steps("hop-15cm")])
    return folder


def test_a_step_is_logged_with_its_gain_and_all_that_the_servos_say(session: Path) -> None:
    run = read_run(session / "steps-soft.mcap")
    assert run.context["position_p_gain"] == "200 200 200"
    assert run.context["clamped"] == "yes"
    assert run.control_period == 0.01
    assert run.interventions[-1, :2].tolist() == [0, 0]  # finite, inside the limits
    for known in (run.voltage, run.pwm, run.current, run.temperature, run.began, run.write_done):
        assert np.isfinite(known).all()


def test_the_clamp_holds_the_base_and_a_hop_does_not_stay(session: Path) -> None:
    manifest = load_manifest(session)
    assert manifest
    assert [entry.clamped for entry in manifest.entries] == [True, True, False]
    assert manifest.entries[0].travel is None
    assert manifest.entries[2].travel == pytest.approx(0.147, abs=0.01)
    assert manifest.mass == pytest.approx(0.238, abs=0.01)  # sim/lamp/README.md


def test_a_drop_turns_torque_off_and_goes_on_watching(session: Path) -> None:
    run = read_run(session / "drop-2.mcap")
    limp = run.phase == "limp"
    assert limp.sum() == 200
    assert (run.torque[limp] == 0).all()
    assert (run.torque[~limp] == 1).all()
    knee = run.angle[limp, 1]
    assert abs(knee[-1] - knee[0]) > 0.3  # it has dropped
    assert np.diff(run.began[limp]) == pytest.approx(0.01, abs=1e-6)


def test_recordings_are_what_a_fit_of_single_servos_reads(session: Path) -> None:
    recordings = {recording.name: recording for recording in read_recordings([session])}
    assert len(recordings) == 9
    soft = recordings["steps-soft.mcap#knee"]
    assert (soft.servo, soft.p_gain[0]) == ("XL330-M288-T", 200.0)
    assert faults(soft) == []


def test_a_session_that_was_killed_goes_on_where_it_stopped(tmp_path: Path) -> None:
    class Killed(Exception):
        pass

    @contextlib.contextmanager
    def fails(step: Step) -> Iterator[StepConnection]:
        if step.name == "drop-2":
            (tmp_path / "drop-2.mcap.part").write_bytes(b"half")
            raise Killed
        with emulated(SETUP, "none")(step) as ports:
            yield ports

    with pytest.raises(Killed):
        recorded(tmp_path, [SOFT, DROP], connect=fails)
    first = (tmp_path / "steps-soft.mcap").read_bytes()
    assert len(read_session(tmp_path, LAMP).recordings) == 1  # what is there can be used already
    said: list[str] = []
    manifest = recorded(tmp_path, [SOFT, DROP], said=said)
    assert said[0] == "1/2 steps-soft: recorded already"
    assert (tmp_path / "steps-soft.mcap").read_bytes() == first
    assert [entry.step for entry in manifest.entries] == ["steps-soft", "drop-2"]
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", "drop-2.mcap", NAME, "steps-soft.mcap"]


def test_a_request_to_stop_lands_the_lamp_and_keeps_no_half_recording(tmp_path: Path) -> None:
    stop = StopRequest()
    stop.request()
    with pytest.raises(SafetyError, match=r"steps-soft: stopped: request to stop; start again to go on"):
        recorded(tmp_path, [SOFT], stop=stop)
    assert not list(tmp_path.glob("*.mcap*"))


def test_a_folder_of_something_else_is_refused(session: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"is of emulator none, not of emulator worn; give a new folder"):
        recorded(session, [SOFT], "worn")
    (tmp_path / "old.mcap").touch()
    with pytest.raises(FileError, match=r"holds old\.mcap, but no manifest"):
        recorded(tmp_path, [SOFT])
    (tmp_path / "old.mcap").unlink()
    recorded(tmp_path, [SOFT])
    (tmp_path / "steps-soft.mcap").write_bytes(b"other")
    with pytest.raises(FileError, match=r"is not the file that manifest\.toml lists"):
        recorded(tmp_path, [SOFT])
    (tmp_path / NAME).write_text("schema = 2\n")
    with pytest.raises(FileError, match="schema"):
        recorded(tmp_path, [SOFT])


def test_a_person_is_told_what_to_do_and_asked_what_only_a_person_can_see(tmp_path: Path) -> None:
    told: list[str] = []

    def connect(step: Step) -> contextlib.AbstractContextManager[StepConnection]:
        @contextlib.contextmanager
        def blind() -> Iterator[StepConnection]:
            with emulated(SETUP, "none")(step) as ports:
                yield StepConnection(ports.servo_port, ports.foot_port, ports.clock, ports.epoch)

        return blind()

    person = Person(told.append, lambda text: 0.12, lambda text: 0.214)
    manifest = recorded(tmp_path, [SOFT, *steps("hop-15cm")], person=person, connect=connect)
    assert (manifest.mass, manifest.entries[-1].travel) == (0.214, 0.12)
    assert told[0].startswith("1/2 steps-soft - delay, and how the gain")
    assert "measure how far it went" in told[1]


def test_a_way_that_nobody_measured_keeps_no_half_recording(tmp_path: Path) -> None:
    @contextlib.contextmanager
    def blind(step: Step) -> Iterator[StepConnection]:
        with emulated(SETUP, "none")(step) as ports:
            yield StepConnection(ports.servo_port, ports.foot_port, ports.clock, ports.epoch)

    def leaves(text: str) -> float:
        assert (tmp_path / "hop-15cm.mcap.part").exists()
        raise KeyboardInterrupt

    person = Person(lambda text: None, leaves, lambda text: 0.214)
    with pytest.raises(KeyboardInterrupt):
        recorded(tmp_path, [*steps("hop-15cm")], person=person, connect=blind)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", NAME]


def test_every_step_says_what_hands_do_and_what_it_is_for() -> None:
    all_steps = procedure(LAMP)
    assert len({step.name for step in all_steps}) == len(all_steps)
    assert "Clamp the base" in all_steps[0].hands
    standing = next(step for step in all_steps if not step.clamped)
    assert "Take the clamp off" in standing.hands
    assert all(step.hands.endswith(".") and step.shows for step in all_steps)


def robolamp(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robolamp", "calibrate", *words]
    return subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)


def test_bad_words_are_named(tmp_path: Path) -> None:
    where = str(tmp_path / "new")
    for words, part in (
        (("record", "-o", where, "--emulate", "--step", "jump"), "--step: 'jump' is not a step; expected one of ramps"),
        (("record", "-o", where), "standard input: is no terminal"),
        (("record", "-o", where, "--emulate", "--reality", "nowhere"), "nowhere"),
        (("all", "-o", where), "--emulate"),
    ):
        done = robolamp(*words)
        assert done.returncode == 2
        assert part in done.stderr
        assert "Traceback" not in done.stderr
    assert not (tmp_path / "new").exists()
    said = json.loads(robolamp("lamp", where, "-o", "x.toml", "--json").stdout)
    assert "manifest.toml" in said["error"]


def test_prompts_wait_for_enter_and_ask_again_for_a_weight_that_is_none(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "robolamp", "calibrate", "record", "-o", str(tmp_path / "new"), "--step", "ramps",
         "--port", "/dev/nowhere", "--foot-port", "/dev/nowhere"],
        stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    os.close(theirs)
    os.write(ours, b"heavy\n214 g\n\n")
    out, err = process.communicate(timeout=60)
    os.close(ours)
    assert "'heavy' is not a number from 50 to 5000 (grams)" in out
    assert "1/1 ramps - friction at low speed" in out
    assert "Enter when ready" in out
    assert process.returncode == 2
    assert "/dev/nowhere" in err
    manifest = load_manifest(tmp_path / "new")
    assert manifest
    assert manifest.mass == 0.214  # what was answered is kept
