"""Logs whose messages name the joints in another order, and logs whose time stamps step."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from robolamp.cli.main import main
from robolamp.compare.replays.trajectory import of_run
from robolamp.errors import FileError
from robolamp.log.reader import Run, read_run, read_truth
from robolamp.log.run_context import run_context
from robolamp.log.schemas import JOINT_STATE, joint_state
from robolamp.log.writer import LogWriter
from tests.compare.lamps import CALIBRATION, LAMP, write_run

from .rewritten import rewritten
from .ticks import make_tick

HOUR = 3600 * 10**9
AT = 60  # tick before which the clock is set


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run"))


def same(one: Run, other: Run, rows=slice(None)) -> None:
    for name in ("goal", "angle", "velocity", "current", "angle_age", "voltage", "index", "began", "write_done"):
        np.testing.assert_array_equal(getattr(one, name)[rows], getattr(other, name), err_msg=name)
    assert one.joints == other.joints


def stepped(step: int):
    """Return a clock that is set by `step` [ns] once tick AT is over."""
    return lambda topic, number, log_time: log_time + step * (number > AT)


@pytest.mark.parametrize(
    "order",
    [
        lambda topic, number: [2, 1, 0] if topic == "/lamp/measured" else None,
        lambda topic, number: [1, 2, 0] if topic == "/lamp/goals" else None,
        lambda topic, number: [2, 0, 1],
        lambda topic, number: [[2, 0, 1], [0, 1, 2], [1, 0, 2]][number % 3],
    ],
    ids=["measured", "goals", "all", "another each time"],
)
def test_joints_are_known_by_their_names(pair, tmp_path, order):
    log = rewritten(pair[0], tmp_path / "other.mcap", order=order)
    same(read_run(pair[0]), read_run(log))


def test_a_log_without_its_context_maps_what_was_measured_to_the_goals(pair, tmp_path):
    order = lambda topic, number: [2, 1, 0] if topic == "/lamp/measured" else None  # noqa: E731
    same(read_run(pair[0]), read_run(rewritten(pair[0], tmp_path / "other.mcap", order=order, context=False)))


def test_a_twins_log_is_mapped_by_name_too(tmp_path):
    context = run_context(
        backend="twin", lamp=LAMP, calibration=CALIBRATION, controller="", controller_name="", terminals=(), goal=0.3,
        control_period=0.02,
    )  # fmt: skip
    with LogWriter(tmp_path / "twin.mcap", context=context, joints=LAMP.names, now=0.0, lossless=True) as log:
        for index in range(20):
            log.tick(make_tick(index), prefix="/twin")
    order = lambda topic, number: [1, 2, 0] if topic == "/twin/measured" else [2, 1, 0]  # noqa: E731
    other = rewritten(tmp_path / "twin.mcap", tmp_path / "other.mcap", order=order)
    same(read_run(tmp_path / "twin.mcap", "/twin"), read_run(other, "/twin"))


def test_a_truth_is_held_against_the_joints_that_it_names(pair, tmp_path):
    order = lambda topic, number: [2, 0, 1]  # noqa: E731
    run, truth = read_run(pair[0]), read_truth(pair[1])
    other = read_truth(rewritten(pair[1], tmp_path / "truth.mcap", order=order))
    bases = [of_run(run, each, "lamp").base for each in (truth, other)]
    assert bases[0] is not None
    assert bases[1] is not None
    np.testing.assert_array_equal(bases[0].angle, bases[1].angle)


def test_joints_of_another_name_are_refused_in_one_line(tmp_path):
    with LogWriter(tmp_path / "log.mcap", context={}, joints=("a", "b", "c"), now=0.0, lossless=True) as log:
        for index in range(5):
            log.tick(make_tick(index))
        states = joint_state(("a", "b", "elbow"), [0.0] * 3)
        log.message("/lamp/measured", JOINT_STATE, states, 200.0)
    with pytest.raises(FileError, match="/lamp/measured is of joints a, b, elbow; expected a, b, c") as caught:
        read_run(tmp_path / "log.mcap")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("step", [-HOUR, HOUR, -(10**9), 7 * 10**8], ids=["-1 h", "+1 h", "-1 s", "+0.7 s"])
def test_a_run_keeps_to_its_own_clock_where_that_of_the_wall_is_set(pair, tmp_path, step):
    log = rewritten(pair[0], tmp_path / "log.mcap", clock=stepped(step))
    run, whole = read_run(log), read_run(pair[0])
    same(whole, run)
    assert run.clock_steps == [(AT + 1, pytest.approx(step * 1e-9))]
    assert whole.clock_steps == []
    np.testing.assert_allclose(run.at(run.log_time), whole.write_done, atol=2e-9)


def test_a_tick_that_was_logged_while_the_clock_was_set_is_lost_alone(pair, tmp_path):
    def clock(topic: str, number: int, log_time: int) -> int:
        return log_time - HOUR * (number > AT or (number == AT and topic != "/lamp/measured"))

    run = read_run(rewritten(pair[0], tmp_path / "log.mcap", clock=clock))
    same(read_run(pair[0]), run, rows=np.arange(200) != AT)


@pytest.mark.parametrize("step", [-HOUR, HOUR])
@pytest.mark.parametrize("whose", ["both", "the log alone"])
def test_a_truth_stays_beside_its_log(pair, tmp_path, step, whose):
    run = read_run(pair[0])
    truth = read_truth(pair[1])
    other = read_run(rewritten(pair[0], tmp_path / "log.mcap", clock=stepped(step)))
    at = stepped(step) if whose == "both" else lambda topic, number, log_time: log_time
    beside = read_truth(rewritten(pair[1], tmp_path / "truth.mcap", clock=at))
    np.testing.assert_allclose(other.at(beside.log_time), run.at(truth.log_time), atol=1e-6)


def test_an_own_clock_that_runs_back_is_refused_in_one_line(tmp_path):
    with LogWriter(tmp_path / "log.mcap", context={}, joints=LAMP.names, now=0.0, lossless=True) as log:
        for index in range(10):
            tick = make_tick(index)
            tick.began -= 5.0 * (index > 5)
            log.tick(tick)
    with pytest.raises(FileError, match=r"its own clock does not go on: tick 6 began at 95\.120 s, the one") as caught:
        read_run(tmp_path / "log.mcap")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["names", "clock"])
@pytest.mark.parametrize(
    "verb",
    [
        ["compare", "LOG", "--no-diagnosis", "-o", "OUT.html"],
        ["compare", "LOG", "-o", "OUT.html"],
        ["compare", "LOG", "STRAIGHT", "--no-diagnosis", "-o", "OUT.html"],
        ["compare", "FOLDER", "-o", "OUT.html"],
        ["render", "LOG", "--twin", "-o", "OUT.png"],
        ["log", "info", "LOG"],
        ["log", "export", "LOG", "-o", "OUT.csv"],
        ["log", "recover", "LOG", "-o", "OUT.mcap"],
    ],
    ids=lambda verb: " ".join(verb[:3]),
)
def test_every_verb_reads_such_logs(pair, tmp_path, capsys, verb, kind):
    folder = tmp_path / "runs"
    folder.mkdir()
    changed = {"clock": stepped(-HOUR)} if kind == "clock" else {"order": lambda topic, number: [2, 1, 0]}
    rewritten(pair[0], folder / "log.mcap", **changed)
    shutil.copy(pair[1], folder / "truth.mcap")
    words = {"LOG": folder / "log.mcap", "FOLDER": folder, "STRAIGHT": pair[0]}
    with pytest.raises(SystemExit) as caught:
        main([str(words.get(word, word.replace("OUT", str(tmp_path / "out")))) for word in verb])
    out, err = capsys.readouterr()
    missed = verb[0] == "compare" and verb[1] != "FOLDER"  # the lamp of these logs stands where it stood
    assert (caught.value.code or 0, err) == (1 if missed else 0, "")
    if kind == "clock" and verb[:2] == ["log", "info"]:
        assert "clock was set by -3600.00 s" in out
        assert " 3.98 s" in out  # how long it took, not what the stamps say
    if kind == "clock" and verb[0] == "compare" and verb[1] == "LOG" and verb[2] == "-o":
        assert "the clock of the time stamps was set by -3600.0 s" in out


def test_the_step_is_in_json(pair, tmp_path, capsys):
    log = rewritten(pair[0], tmp_path / "log.mcap", clock=stepped(-HOUR))
    with pytest.raises(SystemExit):
        main(["log", "info", str(log), "--json"])
    said = json.loads(capsys.readouterr().out)
    assert said["clock_steps"] == [{"tick": AT + 1, "by_s": pytest.approx(-3600.0)}]
    assert said["duration_s"] == pytest.approx(3.984, abs=0.01)
