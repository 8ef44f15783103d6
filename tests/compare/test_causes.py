"""What is named as a cause, what is not, and how much is left unexplained."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import replace

import numpy as np
import pytest

from robolamp.cli.main import main
from robolamp.compare.align import Trace, compare_joint
from robolamp.compare.causes.evidence import DRIVEN, Evidence
from robolamp.compare.causes.knobs import KINDS, Knob, knobs
from robolamp.compare.causes.ranking import Account, explain, together
from robolamp.compare.causes.words import diagnose
from robolamp.compare.travel.hop_count import count_hops
from robolamp.compare.travel.sensed_flights import flights
from robolamp.dynamixel.registers import Name
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Event
from robolamp.emulator.reality.file import Reality, load_reality
from robolamp.log.reader import Run, read_run, read_truth
from robolamp.log.run_context import SERVO_SETTINGS, servo_settings
from robolamp.runtime.loop import TORQUE_ON
from robolamp.twin.bend import Bend

from .emulated import hop
from .lamps import ASSETS, CALIBRATION, LAMP, write_run
from .test_hops_and_course import foot

NONE = Reality.none(LAMP)


@pytest.fixture(scope="module")
def rocking(tmp_path_factory):
    return hop(tmp_path_factory.mktemp("rocking") / "log.mcap", load_reality("knob:supply_voltage:1", LAMP, ASSETS))


@pytest.fixture(scope="module")
def weak(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("weak"), Bend(strength=np.array([1.0, 0.8, 1.0])))[0]


def call(capsys, *words) -> tuple[int, str]:
    with pytest.raises(SystemExit) as caught:
        main(["compare", *map(str, words)])
    out, err = capsys.readouterr()
    assert err == ""
    return int(caught.value.code or 0), out


def cut(run: Run, ticks: int) -> Run:
    """Return a run that ends after so many ticks of the controller's."""
    last = int(np.flatnonzero(run.phase == "run")[0]) + ticks
    whole = run.index.size
    arrays = {
        name: value[:last] for name, value in vars(run).items() if isinstance(value, np.ndarray) and len(value) == whole
    }
    return replace(run, **arrays, faults=run.faults[:last])


def test_every_cause_says_its_share_and_the_diagnosis_what_is_left(weak, tmp_path, capsys):
    _, out = call(capsys, weak, "--json", "-o", tmp_path / "r.html")
    result = json.loads(out)
    shares = [finding["share"] for finding in result["diagnosis"] if finding["share"] is not None]
    assert shares
    assert result["unexplained_share"] == pytest.approx(1.0 - sum(shares))
    assert result["no_causes_why"] is None
    _, said = call(capsys, weak, "-o", tmp_path / "r.html")
    left = f"Left unexplained: {result['unexplained_share'] * 100:.0f} % of the difference."
    assert left in said
    assert left.replace(" %", "\u00a0%") in (tmp_path / "r.html").read_text()
    numbered = [line for line in said.splitlines() if line.startswith(tuple(f"  {n}. " for n in range(1, 9)))]
    assert len(numbered) == len(result["diagnosis"])
    assert all("of the difference)" in line or "(share not known)" in line for line in numbered)


def test_a_difference_that_is_none_says_so(tmp_path, capsys):
    log, _ = write_run(tmp_path)
    _, out = call(capsys, log)
    assert "Left unexplained: 100 % of a difference no larger than that of two good readings." in out


@pytest.mark.parametrize("ticks", [0, 1, round(DRIVEN / 0.02) - 1])
def test_no_cause_where_the_controller_drove_for_too_little(weak, ticks):
    evidence = Evidence(cut(read_run(weak), ticks), LAMP, CALIBRATION, ASSETS)
    account = explain(evidence, LAMP)
    assert account.causes == ()
    assert np.isnan(account.unexplained)
    assert account.left == (
        f"What explains the difference is not known: the controller drove for {ticks * 0.02:.2f} s; "
        f"finding a cause takes {DRIVEN:g} s."
    )


def test_a_run_that_ended_before_the_controller_drove_has_no_cause(tmp_path, capsys):
    gone = Event("unplugged", at=1.2, lasts=60.0, port="servo")
    log = hop(tmp_path / "log.mcap", load_reality("worn", LAMP, ASSETS), events=(gone,))
    _, out = call(capsys, log, "--json")
    result = json.loads(out)
    assert [finding["knob"] for finding in result["diagnosis"] if finding["knob"]] == []
    assert result["unexplained_share"] is None
    assert result["no_causes_why"].startswith("the controller drove for 0.00 s")


def test_joints_that_stand_still_tell_nothing_of_their_motors(weak):
    run = read_run(weak)
    run.goal[:, 2] = 0.0  # the neck
    evidence = Evidence(run, LAMP, CALIBRATION, ASSETS)
    assert evidence.moved.tolist() == [True, True, False]
    run.goal[:] = 0.0
    still = explain(Evidence(run, LAMP, CALIBRATION, ASSETS), LAMP)
    assert not {one.knob.kind for one in still.causes if one.knob} & {"strength", "friction", "delay", "floor"}


def test_no_size_is_beyond_its_bounds():
    random = np.random.default_rng(1)
    slope = random.normal(size=400)
    like = slope + random.normal(0.0, 1e-3, 400)  # two that can hardly be told apart
    value = 300.0 * slope - 299.0 * like
    free = together(value, np.zeros(400), np.zeros(400), [(slope, -1e9, 1e9), (like, -1e9, 1e9)])[0]
    assert min(map(abs, free)) > 100.0
    held = together(value, np.zeros(400), np.zeros(400), [(slope, -0.9, 3.0), (like, -0.5, 0.5)])[0]
    assert -0.9 <= held[0] <= 3.0
    assert -0.5 <= held[1] <= 0.5
    inside = together(0.2 * slope, np.zeros(400), np.zeros(400), [(slope, -0.9, 3.0)])[0]
    assert inside == [pytest.approx(0.2)]


@pytest.mark.parametrize("knob", knobs(LAMP), ids=lambda knob: knob.name)
@pytest.mark.parametrize("share", [-1.0, -0.5, 0.5, 1.0])
def test_a_size_at_the_end_of_what_is_believed_says_more_than(knob: Knob, share):
    low, high = knob.bounds
    size = share * (high if share > 0 else -low)
    said = knob.cause(size or -1e-3)  # what cannot be less in a lamp can become less from one run to another
    assert said
    assert "{" not in said
    beyond = f"more than {knob.amount(abs(size))}"
    assert (beyond in said) == (abs(share) == 1.0 and size != 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_hold_what_realities_usually_are(kind):
    about = KINDS[kind]
    assert about.low <= min(about.trials)
    assert max(about.trials) <= about.high
    assert about.high >= 10 * about.worth


def test_hops_that_did_not_fly_come_first_where_the_truth_is_known(rocking, tmp_path, capsys):
    _, out = call(capsys, rocking, "--truth", rocking.with_name("truth.mcap"), "--json", "-o", tmp_path / "r.html")
    result = json.loads(out)
    count = count_hops(read_run(rocking), read_truth(rocking.with_name("truth.mcap")), LAMP)
    assert count.flown is not None
    assert count.flown < count.counted == result["hops"]
    first = result["diagnosis"][0]
    flew = "0 flew" if not count.flown else f"{count.flown} flew"
    assert first["cause"] == f"{count.counted} hops were counted, {flew}"
    assert "the foot came up by" in first["evidence"]


def test_without_the_truth_only_flights_that_are_too_short_are_told(rocking):
    run = read_run(rocking)
    lamp = dataclasses.replace(LAMP, flight_time=0.2)  # as for a log whose counter took shorter ones
    count = count_hops(run, None, lamp)
    assert count.flown is None
    assert count.short > 0
    found = diagnose(run, Account(), (), CALIBRATION, lamp)
    assert f"{count.counted} hops were counted, {count.short} of them too short to have flown" in [
        each.cause for each in found
    ]
    assert not any("flew" in each.cause for each in found)


def test_a_lamp_that_flew_all_its_hops_has_no_such_cause(tmp_path):
    log = hop(tmp_path / "log.mcap", NONE)
    count = count_hops(read_run(log), read_truth(log.with_name("truth.mcap")), LAMP)
    assert count.counted == count.flown >= 3
    assert count.short == 0
    assert count.text == ""


ODD = {
    Name.POSITION_I_GAIN: 300,
    Name.POSITION_D_GAIN: 500,
    Name.FEEDFORWARD_1ST_GAIN: 200,
    Name.PROFILE_VELOCITY: 90,
    Name.PWM_LIMIT: 600,
    Name.HOMING_OFFSET: 30,
}


@pytest.mark.parametrize("name", ODD)
def test_a_servo_set_otherwise_comes_before_its_motor(name, tmp_path):
    """Another client writes a register of the knee once torque is on: what the log says of it is named first."""

    def meddle(text: str, world: EmulatedLamp) -> None:
        if text == TORQUE_ON:
            world.servos[1].put(name, ODD[name])

    run = read_run(hop(tmp_path / "log.mcap", NONE, on_event=meddle, duration=0.5))
    assert servo_settings(run.context)["knee"][name] == ODD[name]
    found = diagnose(run, Account(), (), CALIBRATION, LAMP)
    right = 885 if name == Name.PWM_LIMIT else 0
    assert found[0].cause == f"the knee's servo has other settings: {name} {ODD[name]}, not {right}"


@pytest.mark.parametrize("text", [None, "", "{", "[]", '{"knee": 3}', '{"knee": {"Position I Gain": "x"}}'])
def test_a_log_that_does_not_say_how_servos_were_set_says_nothing_of_it(weak, text):
    run = read_run(weak)
    if text is not None:
        run.context[SERVO_SETTINGS] = text
    assert servo_settings(run.context) == {}
    assert not any("other settings" in each.cause for each in diagnose(run, Account(), (), CALIBRATION, LAMP))


@pytest.mark.parametrize("known", [0, 3, 40, 74])
def test_a_mean_over_few_readings_is_none(known):
    time = np.arange(150) * 0.02
    twin = Trace.of(time, 0.3 * np.sin(9.0 * time))
    value = np.where(np.arange(150) < known, twin.value, np.nan)
    joint = compare_joint("knee", twin, Trace.of(time, value), 150)
    assert not joint.known
    assert joint.samples <= known
    for each in (joint.lag, joint.before.mae, joint.after.mae, joint.after.rmse, joint.after.worst):
        assert np.isnan(each)
    assert compare_joint("knee", twin, twin, 150).known


@pytest.mark.parametrize("lost", ["angle", "current", "foot_force"])
def test_readings_that_are_missing_are_no_agreement(lost, tmp_path, capsys):
    """A joint (or sensor) that was read in 3 of 150 ticks is unknown everywhere, and never inside."""
    log, _ = write_run(tmp_path, blind=lost)
    code, out = call(capsys, log, "--json", "--no-diagnosis")
    result = json.loads(out)
    if lost == "angle":
        assert code == 1
        assert result["verdict"] != "inside"
        assert all(joint["mae_mrad"]["after"] is None for joint in result["joints"])
    if lost == "current":
        assert all(joint["current_mae_a"] is None for joint in result["joints"])
    if lost == "foot_force":
        assert result["foot_force_mae_n"] is None


def test_a_flight_in_which_the_foot_was_not_read_is_none():
    side = foot([(0.5, 0.65), (1.0, 1.15)])
    hole = (side.tick > 0.52) & (side.tick < 0.62)
    force = np.where(hole, np.nan, side.force)
    assert [flight.off for flight in flights(replace(side, force=force), LAMP)] == [pytest.approx(1.0, abs=0.01)]
