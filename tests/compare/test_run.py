"""Whole comparisons: lamps bent by known amounts, reports, files that do not fit."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from robolamp.cli.screen.output import jsonable
from robolamp.compare.compare_logs import compare_log
from robolamp.compare.verdicts.tolerances import load_tolerances
from robolamp.errors import FileError, SafetyError
from robolamp.log.reader import read_run
from robolamp.log.writer import LogWriter
from robolamp.signals import Health, Observation, Tick
from robolamp.twin.bend import Bend
from robolamp.twin.pictures import render

from .lamps import ASSETS, CALIBRATION, LAMP, PERIOD, RUN, SEND, write_run


@pytest.fixture(autouse=True)
def _side_views(monkeypatch):
    """Draw the strips without OpenGL: the same everywhere, and fast."""

    def no_context(width: int, height: int):
        raise render.RenderUnavailableError("not in this test")

    monkeypatch.setattr(render, "_gl_context", no_context)


def compare(folder, diagnosis=False, **options):
    log, truth = write_run(folder, **options)
    out = folder / "report.html"
    return compare_log(log, truth=truth, assets=ASSETS, calibration=CALIBRATION, out=out, diagnosis=diagnosis)


def test_the_twin_itself_is_inside_with_nothing_to_tell(tmp_path):
    result = compare(tmp_path, diagnosis=True)
    assert result.verdict == "inside"
    for joint in result.joints:
        assert abs(joint.lag) < 0.0005
        assert joint.after.mae < 0.001  # the encoder's steps alone are 0.4 mrad
        assert joint.samples == joint.of == RUN
    assert abs(result.lamp.travel - result.other.travel) < 0.001
    assert result.diagnosis == ()


def test_goals_that_leave_late_are_told_and_are_no_lag(tmp_path):
    result = compare(tmp_path, send=SEND + 0.006)
    assert [finding.cause for finding in result.diagnosis] == ["goal angles are sent later than the calibration says"]
    assert all(abs(joint.lag) < 0.0005 for joint in result.joints)


def test_noise_and_lost_readings_do_not_move_the_lag(tmp_path):
    result = compare(tmp_path, noise=0.001, lost=0.05)
    for joint in result.joints:
        assert abs(joint.lag) < 0.001
        assert joint.after.mae < 0.003
        assert joint.samples < RUN
    assert result.control.exact is None  # this log holds no controller
    assert sum("often does not answer" in finding.cause for finding in result.diagnosis) == 3


@pytest.mark.parametrize("delay", [0.006])
def test_a_slower_servo_shows_as_that_lag(tmp_path, delay):
    result = compare(tmp_path, diagnosis=True, bend=Bend(delay=delay))
    for joint in result.joints:
        assert joint.lag == pytest.approx(delay, abs=0.001)
        assert joint.after.mae < 0.003 < joint.before.mae
    first = result.diagnosis[0]
    assert first.knob == "delay"
    assert first.size == pytest.approx(delay, abs=0.001)
    assert first.cause == f"goal angles take effect {first.size * 1e3:.1f} ms later than modelled"


def test_a_weak_knee_is_named_with_its_size_and_its_remedy(tmp_path):
    result = compare(tmp_path, diagnosis=True, bend=Bend(strength=np.array([1.0, 0.8, 1.0])))
    errors = [joint.after.mae for joint in result.joints]
    assert max(errors) == errors[1]
    first = result.diagnosis[0]
    assert (first.knob, first.unit) == ("strength knee", "1")
    assert first.size == pytest.approx(-0.2, abs=0.02)
    assert first.share > 0.5
    assert "calibrate record" in first.remedy
    assert "joint.knee.torque_constant" in first.remedy


def test_a_heavier_lamp_and_another_supply_are_both_told(tmp_path):
    found = {
        one.knob: one.size for one in compare(tmp_path, diagnosis=True, bend=Bend(mass=1.2, supply=-0.4)).diagnosis
    }
    assert found["mass"] == pytest.approx(0.2, abs=0.05)
    assert found["supply"] == pytest.approx(-0.4, abs=0.05)


def test_missed_ticks_are_counted_and_told(tmp_path):
    result = compare(tmp_path, skip=(60, 61, 90, 120))
    assert result.as_dict()["missed_ticks"] == 4
    assert "the loop did not keep its schedule" in [finding.cause for finding in result.diagnosis]
    assert all(joint.after.mae < 0.003 for joint in result.joints)


def test_the_replay_is_a_log_on_the_same_clock(tmp_path):
    result = compare(tmp_path)
    twin, lamp = read_run(result.twin_log, "/twin"), read_run(tmp_path / "run.mcap")
    assert result.twin_log == tmp_path / "report.twin.mcap"
    np.testing.assert_array_equal(twin.goal, lamp.goal)
    assert np.abs(twin.log_time - lamp.log_time).max() < 1_000_000
    assert np.abs(twin.angle - lamp.angle).max() < 0.01
    assert twin.context["backend"] == "twin"
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "report.html",
        "report.twin.mcap",
        "run.mcap",
        "truth.mcap",
    ]


def test_without_truth_the_lamps_travel_is_unknown(tmp_path):
    log, _ = write_run(tmp_path)
    result = compare_log(log, assets=ASSETS, calibration=CALIBRATION, out=tmp_path / "report.html", diagnosis=False)
    assert result.verdict == result.task.word == "cannot say"
    assert result.judged.why == ("travel unknown: nothing measured how far the lamp came",)
    assert np.isnan(result.lamp.travel)
    assert json.loads(json.dumps(jsonable(result.as_dict()), allow_nan=False))["travel_m"] is None


def test_a_killed_log_is_compared_as_far_as_it_goes(tmp_path):
    log, _ = write_run(tmp_path)
    data = log.read_bytes()
    log.write_bytes(data[:600])  # not even its first chunk
    with pytest.raises(FileError):
        compare_log(log, assets=ASSETS, calibration=CALIBRATION, out=tmp_path / "report.html", diagnosis=False)
    log.write_bytes(data[:-200])
    result = compare_log(log, assets=ASSETS, calibration=CALIBRATION, out=tmp_path / "report.html", diagnosis=False)
    assert result.as_dict()["truncated"]
    assert "The log ends early" in (tmp_path / "report.html").read_text()


class Page(HTMLParser):
    VOID = ("input", "meta", "img", "br", "link", "path", "use")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data.replace("\u00a0", " ")


def test_the_report_is_one_whole_file_that_tells_the_run(tmp_path):
    result = compare(tmp_path, noise=0.001)
    text = result.report.read_text()
    page = Page()
    page.feed(text)
    page.close()
    assert page.open == []
    assert all(link.startswith(("data:image/jpeg;base64,", "#")) for link in page.links)
    assert sum(link.startswith("data:") for link in page.links) == 2  # the strips of twin and lamp
    assert "http" not in re.sub(r"<(script|style).*?</\1>|<pre>.*?</pre>", "", text, flags=re.DOTALL)
    assert len(text) < 5_000_000
    assert "Inside tolerances" in page.text
    for word in (
        "sway <&>",
        "30.0 cm",
        *LAMP.names,
        CALIBRATION.hash[:12],
        "lamp stayed up, twin stayed up",
        "The motion",
        "What is different",
        "lag",
    ):
        assert word in page.text
    assert f"{result.joints[0].after.mae * 1e3:.1f}" in page.text
    assert text.count("data-panel=") == 13  # angle, difference and current of each joint; force, travel, supply, period


def test_two_reports_of_one_log_are_the_same(tmp_path):
    log, truth = write_run(tmp_path)
    pages = []
    for name in ("a.html", "b.html"):
        compare_log(log, truth=truth, assets=ASSETS, calibration=CALIBRATION, out=tmp_path / name, diagnosis=False)
        pages.append((tmp_path / name).read_text())
    assert pages[0] == pages[1]


def bare_log(path, joints=LAMP.names, goal=0.0, days=0, angle=0.0, phase="start"):
    n = len(joints)
    with LogWriter(path, context={}, joints=joints, now=86_400.0 * days) as log:
        for index in range(5):
            time = index * PERIOD
            zero = np.zeros(n)
            seen = Observation(time, zero + angle, zero, zero, zero, 2.0, 0.0, Health.unknown(n))
            log.tick(Tick(index, phase if index else "start", time, time, time, time + 0.001, seen, np.full(n, goal)))
    return path


@pytest.mark.parametrize(("phase", "driven"), [("start", 0), ("run", 4)])
def test_a_log_without_context_and_next_to_no_run_phase_is_compared(tmp_path, phase, driven):
    log = bare_log(tmp_path / "run.mcap", phase=phase)
    result = compare_log(log, assets=ASSETS, calibration=CALIBRATION, out=tmp_path / "report.html", diagnosis=False)
    assert result.verdict == "cannot say"
    assert f"too few readings: {driven} ticks of the controller" in result.judged.why
    assert [joint.samples for joint in result.joints] == [5, 5, 5]


@pytest.mark.parametrize(
    ("error", "message", "make"),
    [
        (FileError, "is of joints a, b; ", lambda path: bare_log(path, joints=("a", "b"))),
        (FileError, "no joint has a reading", lambda path: bare_log(path, angle=np.nan)),
        (SafetyError, "goal 3 rad of ankle is not from", lambda path: bare_log(path, goal=3.0)),
    ],
)
def test_a_log_that_does_not_fit_the_lamp_leaves_nothing_behind(tmp_path, error, message, make):
    log = make(tmp_path / "run.mcap")
    with pytest.raises(error, match=message) as caught:
        compare_log(log, assets=ASSETS, calibration=CALIBRATION, out=tmp_path / "report.html", diagnosis=False)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_a_truth_of_another_run(tmp_path):
    log = bare_log(tmp_path / "yesterday.mcap", days=1)
    _, truth = write_run(tmp_path)
    with pytest.raises(FileError, match="it is of another run"):
        compare_log(
            log, truth=truth, assets=ASSETS, calibration=CALIBRATION, out=tmp_path / "report.html", diagnosis=False
        )


def test_the_report_must_not_replace_the_log(tmp_path):
    log, _ = write_run(tmp_path)
    before = log.read_bytes()
    with pytest.raises(FileError, match="would be overwritten"):
        compare_log(log, assets=ASSETS, calibration=CALIBRATION, out=log)
    assert log.read_bytes() == before


def test_tolerances_decide(tmp_path):
    strict = tmp_path / "strict.toml"
    strict.write_text('schema = 1\nname = "strict"\njoint_mae = 0.0001\nlag = 1.0\ntravel = 1.0\n')
    log, _ = write_run(tmp_path, Bend(strength=0.9))  # further off than replays are from each other
    result = compare_log(
        log,
        assets=ASSETS,
        calibration=CALIBRATION,
        out=tmp_path / "report.html",
        tolerances=load_tolerances(ASSETS, strict),
    )
    assert result.verdict == "outside"
    assert len(result.judged.exceeded) == 3
    assert result.judged.exceeded[0].startswith("ankle: MAE 12.")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('schema = 1\nname = "x"\njoint_mae = -1\nlag = 0\ntravel = 0\n', "joint_mae: -1 is not a number from 0"),
        ('schema = 1\nname = "x"\njoint_mae = 0.1\nlag = 0\n', "travel: missing"),
        ('schema = 1\nname = "x"\njoint_mae = 0.1\nlag = 0\ntravel = 0\nlags = 0\n', "lags: unknown"),
    ],
)
def test_bad_tolerances(tmp_path, text, message):
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(FileError, match=message):
        load_tolerances(ASSETS, tmp_path / "bad.toml")
