"""Verdicts in three parts: what is told of runs whose truth is known, and that what nobody measured is never inside."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robolamp.cli.main import main
from robolamp.compare.compare_logs import compare_joints
from robolamp.compare.logged_motion import truth_of
from robolamp.compare.replays.goal_replay import replay
from robolamp.compare.replays.trajectory import of_replay, of_run
from robolamp.compare.run_ending import ending_of
from robolamp.compare.travel.landing import Landing, landing_of
from robolamp.compare.travel.sensed_flights import Flight, Hop, flights, hops
from robolamp.compare.verdicts.controller_alone import RUNS, Alone, alone_of
from robolamp.compare.verdicts.task_verdict import task_of
from robolamp.compare.verdicts.tolerances import load_tolerances
from robolamp.compare.verdicts.twin_verdict import verdict_of
from robolamp.controller.pilot import Pilot
from robolamp.emulator.faults.script import Event
from robolamp.errors import FileError
from robolamp.log.reader import Run, Truth, read_run, read_truth
from robolamp.signals import ASKED_AGAIN

from .driven import constant, dry_run
from .lamps import ASSETS, CALIBRATION, LAMP, write_run

ALLOWED = load_tolerances(ASSETS)
WEAK = 'name = "weak"\n[joint.knee]\nstrength = 0.92\nfriction = 1.3\n[lamp]\nmass = 1.05\n'


def weak(folder: Path) -> str:
    """A reality whose lamp crouches and rocks, but does not leave the ground."""
    (folder / "weak.toml").write_text(WEAK)
    return str(folder / "weak.toml")


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return dry_run(tmp_path_factory.mktemp("good"))


def compare(capsys, *words) -> tuple[int, dict]:
    with pytest.raises(SystemExit) as caught:
        main(["compare", *map(str, words), "--json"])
    return int(caught.value.code or 0), json.loads(capsys.readouterr().out)


def test_a_good_run_is_done_and_inside_by_the_truth_beside_its_log(good, tmp_path, capsys):
    code, said = compare(capsys, good, "--no-diagnosis", "-o", tmp_path / "r.html")
    assert (code, said["task"], said["verdict"], said["verdict_why"]) == (0, "done", "inside", [])
    assert said["task_why"][0].startswith("landed at 29.5 cm for a goal of 30.0 cm")
    assert said["hops"] == said["hops_flown"] == said["twin_alone_hops"]
    assert said["twin_alone_m"] == pytest.approx(said["travel_m"], abs=0.005)
    assert said["twin_alone_fell"] is False


@pytest.mark.parametrize(("controller", "only_felt"), [("hop-counting", 0), ("hop", 1)])
def test_the_controller_alone_lands_where_score_says(controller, only_felt, tmp_path, capsys):
    log = dry_run(tmp_path / "run", controller=controller)
    _, said = compare(capsys, log, "--no-diagnosis", "-o", tmp_path / "r.html")
    with pytest.raises(SystemExit):
        main(["score", controller, "--goals", "0.30", "--duration", "4", "--json"])
    scored = json.loads(capsys.readouterr().out)
    assert said["twin_alone_m"] - 0.30 == pytest.approx(scored["errors_m"][0], abs=0.002)
    assert said["twin_alone_hops"] == scored["hops"][0] + only_felt  # score's hops clear 2 mm and land flat


@pytest.mark.parametrize(
    ("what", "task", "verdict", "told"),
    [
        ({"reality": WEAK}, "not done", "outside", "allowed 1.5 cm"),
        ({"controller": (0.0, 0.0, 0.0)}, "not done", "cannot say", "lag unknown: no joint moved"),
        ({"controller": (0.3, 0.5, -0.5)}, "not done", "outside", "fell"),
        ({"stop": 1.0}, "not done", "cannot say", "the controller never drove (stopped: request to stop)"),
        ({"stop": 3.0}, "not done", "cannot say", "cut while the controller drove (stopped: request to stop)"),
        ({"event": Event("silent", at=3.0, lasts=1.0, servo=2)}, "not done", "outside", "readings are missing"),
        ({"event": Event("reboot", at=2.6, servo=2)}, "not done", "outside", "guard: "),
        ({"event": Event("foot_silent", at=2.6, lasts=1.0)}, "not done", "outside", "foot: no force"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else None,
)
def test_a_lamp_that_did_nothing_good_is_not_done_and_inside(what, task, verdict, told, tmp_path, capsys):
    if "reality" in what:
        what = what | {"reality": weak(tmp_path)}
    if "controller" in what:
        what = what | {"controller": constant(tmp_path, *what["controller"])}
    log = dry_run(tmp_path, **what)
    code, said = compare(capsys, log, "--no-diagnosis")
    assert (code, said["task"], said["verdict"]) == (1, task, verdict)
    assert told in " ".join(said["task_why"] + said["verdict_why"])


def killed(folder: Path) -> Path:
    """Write a log whose writer was killed while the controller drove."""
    log, _ = write_run(folder, skip=tuple(range(120, 200)))
    log.write_bytes(log.read_bytes()[:-200])
    return log


def test_a_killed_log_is_cut_and_cannot_be_inside(tmp_path, capsys):
    code, said = compare(capsys, killed(tmp_path), "--no-diagnosis")
    assert (code, said["task"], said["verdict"]) == (1, "not done", "cannot say")
    why = "cut while the controller drove (the log ends early: the process that wrote it was killed)"
    assert why in said["task_why"]
    assert said["verdict_why"] == [f"the run: {why}"]


def test_a_lamp_that_nobody_saw_lands_where_the_ruler_says(good, tmp_path, capsys):
    log = tmp_path / "log.mcap"
    log.write_bytes(good.read_bytes())
    code, said = compare(capsys, log, "--no-diagnosis")
    assert (code, said["task"], said["verdict"]) == (1, "cannot say", "cannot say")
    assert said["task_why"][0] == "nothing measured where it landed"
    assert said["verdict_why"] == ["travel unknown: nothing measured how far the lamp came"]
    code, said = compare(capsys, log, "--no-diagnosis", "--landed", "29.1cm")
    assert (code, said["task"], said["verdict"]) == (0, "done", "inside")
    assert said["travel_m"] == pytest.approx(0.291)
    code, said = compare(capsys, log, "--no-diagnosis", "--landed", "20cm")
    assert (code, said["task"], said["verdict"]) == (1, "not done", "outside")
    for words in ((log, "--landed", "far"), (log, log, "--landed", "20cm"), (tmp_path, "--landed", "20cm")):
        code, said = compare(capsys, *words)
        assert (code, said["where"]) == (2, "--landed")


def test_a_lamp_that_nobody_saw_and_that_stood_still_is_not_done(tmp_path, capsys):
    log = dry_run(tmp_path, controller=constant(tmp_path, 0.0, 0.0, 0.0))
    log.with_name("truth.mcap").unlink()
    code, said = compare(capsys, log, "--no-diagnosis")
    assert (code, said["task"]) == (1, "not done")
    assert "no joint moved" in said["task_why"]


def test_dry_run_tells_the_three_parts_first_on_screen_in_json_and_on_the_page(tmp_path, capsys):
    words = ["dry-run", "hop-counting", "--goal", "0.3", "--reality", weak(tmp_path), "--duration", "3", "--lockstep"]
    with pytest.raises(SystemExit):
        main([*words, "-o", str(tmp_path / "a")])
    told = capsys.readouterr().out.splitlines()[1:]
    assert told[0].startswith("Not done. Landed at ")
    assert told[1].startswith("Twin, replaying the goal angles that the lamp was sent: outside tolerances.")
    assert "allowed: 5.0 cm apart" in told[1]  # or it reads as if two lengths were alike
    assert told[2].startswith("Controller alone on the twin: done. Lands at ")
    assert told[3].startswith("What is different, likeliest: ")
    assert "in the report" in told[3]
    with pytest.raises(SystemExit):
        main([*words, "-o", str(tmp_path / "b"), "--json"])
    said = json.loads(capsys.readouterr().out)
    assert (said["task"], said["verdict"]) == ("not done", "outside")
    assert said["twin_alone_m"] == pytest.approx(0.297, abs=0.01)
    assert said["task_why"]
    assert said["verdict_why"]
    page = Path(said["report"]).read_text()
    asked = [page.index(text) for text in ("Did it do the task?", "Does the twin explain it?", "controller alone on")]
    assert asked == sorted(asked)
    assert asked[-1] < page.index("What is different")


def test_a_folder_tells_each_runs_task_and_verdict(good, tmp_path, capsys):
    for name in ("whole", "cut"):
        (tmp_path / name).mkdir()
    for name in ("log.mcap", "truth.mcap"):
        (tmp_path / "whole" / name).write_bytes(good.with_name(name).read_bytes())
    killed(tmp_path / "cut")
    code, said = compare(capsys, tmp_path)
    assert code == 0
    found = {Path(row["log"]).parent.name: (row["task"], row["verdict"]) for row in said["runs"]}
    assert found == {"whole": ("done", "inside"), "cut": ("not done", "cannot say")}
    alone = {Path(row["log"]).parent.name: row["twin_alone_m"] for row in said["runs"]}
    assert alone == {"whole": pytest.approx(0.297, abs=0.01), "cut": None}  # its log holds no controller
    page = (tmp_path / "compare.html").read_text()
    assert "Of 2, 1 done, 1 not done" in page.replace("\u00a0", " ")


class Judged:
    """A good run, and what is made of it once something of it has been changed."""

    def __init__(self, log: Path) -> None:
        self.run = read_run(log)
        self.lamp = of_run(self.run, truth_of(self.run, None), "lamp")
        self.twin = of_replay(self.run, replay(self.run, LAMP, CALIBRATION, ASSETS))
        self.hops = hops(flights(self.lamp, LAMP), flights(self.twin, LAMP))

    def verdict(self, run: Run | None = None, found: list[Hop] | None = None, **lamp) -> tuple[str, tuple[str, ...]]:
        run = run or self.run
        side = dataclasses.replace(self.lamp, angle=run.angle, **lamp)
        joints = compare_joints(run, side, self.twin)
        found = self.hops if found is None else found
        judged = verdict_of(run, [ending_of(run)], joints, found, side, self.twin, ALLOWED)
        return judged.word, judged.why


@pytest.fixture(scope="module")
def judged(good) -> Judged:
    return Judged(good)


def test_nothing_changed_is_inside(judged):
    assert judged.verdict() == ("inside", ())


def _lose(run: Run, joint: int, ticks: slice) -> Run:
    angle = run.angle.copy()
    angle[np.flatnonzero(run.phase == "run")[ticks], joint] = np.nan
    return dataclasses.replace(run, angle=angle)


@pytest.mark.parametrize(
    ("change", "word", "why"),
    [
        (lambda it: it.verdict(travel=math.nan), "cannot say", "travel unknown"),
        (lambda it: it.verdict(fell=True), "outside", "the lamp fell, the twin did not"),
        (lambda it: it.verdict(found=[Hop(Flight(1.0, 1.1), None)]), "outside", "hop 1: only on the lamp"),
        (lambda it: it.verdict(found=[Hop(None, Flight(1.0, 1.1))]), "outside", "hop 1: only on the twin"),
        (lambda it: it.verdict(_lose(it.run, 1, slice(40, 41))), "outside", "knee: 1 of 200 readings are missing"),
        (lambda it: it.verdict(_lose(it.run, 2, slice(0, 150))), "outside", "neck: 150 of 200 readings are missing"),
        (
            lambda it: it.verdict(dataclasses.replace(it.run, foot_force=np.full(it.run.index.size, np.nan))),
            "outside", "foot: 200 of 200 readings are missing",
        ),
        (
            lambda it: it.verdict(dataclasses.replace(it.run, faults=[("knee: no answer",)] * it.run.index.size)),
            "outside", "a fault while the controller drove: knee: no answer (200 ticks)",
        ),
        (
            lambda it: it.verdict(dataclasses.replace(it.run, phase=np.full(it.run.index.size, "start"))),
            "cannot say", "the controller never drove",
        ),
        (
            lambda it: it.verdict(dataclasses.replace(it.run, angle=np.zeros_like(it.run.angle))),
            "outside", "lag unknown",
        ),
    ],
    ids=["travel", "fall", "hop", "twin's hop", "reading", "readings", "foot", "fault", "never drove", "stood still"],
)  # fmt: skip
def test_what_is_missing_or_unlike_is_never_inside(judged, change, word, why):
    found, reasons = change(judged)
    assert found == word
    assert why in "; ".join(reasons)


def _asked_again(run: Run, ticks: int) -> Run:
    faults = list(run.faults)
    for row in np.flatnonzero(run.phase == "run")[:ticks]:
        faults[row] = (f"knee: {ASKED_AGAIN}",)
    return dataclasses.replace(run, faults=faults)


@pytest.mark.parametrize(("ticks", "word"), [(2, "inside"), (3, "outside")])
def test_an_answer_that_was_there_when_asked_again_is_a_fault_where_it_is_often(judged, ticks, word):
    found, reasons = judged.verdict(_asked_again(judged.run, ticks))
    assert found == word
    assert reasons == (f"a fault while the controller drove: knee: {ASKED_AGAIN} (3 ticks)",) * (ticks == 3)


def _truth(good: Path, **changed) -> tuple[Run, Truth]:
    run, truth = read_run(good), read_truth(good.with_name("truth.mcap"))
    return run, dataclasses.replace(truth, **{name: change(truth) for name, change in changed.items()})


def test_a_hop_flew_if_it_cleared_the_floor_and_landed_flat(good):
    run, truth = _truth(good)
    assert landing_of(run, truth, LAMP).flown == 5
    assert landing_of(run, truth, dataclasses.replace(LAMP, flight_time=0.2)).flown == 0
    _, low = _truth(good, clearance=lambda truth: np.minimum(truth.clearance, 0.0019))
    assert landing_of(run, low, LAMP).flown == 0
    _, tilted = _truth(good, pitch=lambda truth: np.full_like(truth.pitch, np.radians(16)))
    assert landing_of(run, tilted, LAMP).flown == 0


def test_a_truth_that_ends_before_the_run_says_nothing_of_where_it_landed(good):
    run, truth = _truth(good)
    half = truth.log_time.size // 2
    short = dataclasses.replace(
        truth,
        **{
            each.name: getattr(truth, each.name)[:half]
            for each in dataclasses.fields(truth)
            if isinstance(getattr(truth, each.name), np.ndarray)
        },
    )
    landing = landing_of(run, short, LAMP)
    assert math.isnan(landing.travel)
    assert (landing.fell, landing.flown) == (None, None)
    assert math.isnan(of_run(run, short, "lamp").travel)
    assert landing_of(run, None, LAMP) == Landing()


def test_the_truth_beside_a_log_is_found_and_another_runs_is_passed_over(good, tmp_path):
    log = tmp_path / "mine.mcap"
    log.write_bytes(good.read_bytes())
    run = read_run(log)
    assert truth_of(run, None) is None
    (tmp_path / "truth.mcap").write_bytes(good.with_name("truth.mcap").read_bytes())
    assert truth_of(run, None).path == tmp_path / "truth.mcap"
    (tmp_path / "mine.truth.mcap").write_bytes(good.with_name("truth.mcap").read_bytes())
    assert truth_of(run, None).path == tmp_path / "mine.truth.mcap"
    (tmp_path / "mine.truth.mcap").unlink()
    assert truth_of(dataclasses.replace(run, context={**run.context, "backend": "twin"}), None) is None
    other = dataclasses.replace(run, log_time=run.log_time + 10**15)
    assert truth_of(other, None) is None
    with pytest.raises(FileError, match="it is of another run"):
        truth_of(other, tmp_path / "truth.mcap")


def told_of(run: Run, path: Path):
    lamp = of_run(run, read_truth(path.with_name("truth.mcap")), "lamp")
    twin = of_replay(run, replay(run, LAMP, CALIBRATION, ASSETS))
    joints = compare_joints(run, lamp, twin)
    return verdict_of(
        run, [ending_of(run)], joints, hops(flights(lamp, LAMP), flights(twin, LAMP)), lamp, twin, ALLOWED
    )


def rows_of(run: Run, keep: np.ndarray) -> Run:
    """Return some ticks of a run."""
    fields = {field.name: getattr(run, field.name) for field in dataclasses.fields(run)}
    cut = {name: value[keep] for name, value in fields.items() if isinstance(value, np.ndarray)}
    faults = [one for one, kept in zip(run.faults, keep, strict=True) if kept]
    return dataclasses.replace(run, **cut, faults=faults)


def test_ticks_that_a_log_lost_are_not_inside(good):
    """A damaged log that was recovered may lack a part in the middle, in which nobody knows what the lamp did."""
    run = read_run(good)
    late = np.flatnonzero(run.phase == "run")[-40:-10]  # at rest: the rest of the run is all the same
    found = told_of(rows_of(run, ~np.isin(np.arange(run.index.size), late)), good)
    assert found.word == "outside"
    assert found.exceeded == ("30 of 200 ticks are missing in the log, allowed 0.0%",)


def test_a_few_ticks_of_the_controller_are_too_few_whatever_else_is_in_the_log(good):
    run = read_run(good)
    driven = np.flatnonzero(run.phase == "run")
    phase = run.phase.copy()
    phase[driven[5:]] = "landing"
    found = told_of(dataclasses.replace(run, phase=phase), good)
    assert "too few readings: 5 ticks of the controller" in found.unknown


def test_a_ruler_does_not_hide_a_fall_that_the_foot_tells_of(good):
    run = read_run(good)
    force = np.where(run.began > run.began[-1] - 1.0, 0.0, run.foot_force)
    lying = dataclasses.replace(run, foot_force=force)
    alone = Alone(travel=0.3, hops=4, flown=4, hit=True)
    for landing, word in ((Landing(travel=0.3), "not done"), (Landing(travel=0.3, fell=False), "done")):
        assert task_of(lying, LAMP, ending_of(run), landing, alone, 0.015).word == word


@pytest.mark.parametrize("text", ["inf", "nan", "-3", "0"])
def test_numbers_that_no_run_has_are_as_if_the_log_did_not_say(good, text):
    run = read_run(good)
    keys = ("duration_s", "control_period", "answer_wire_s")
    odd = dataclasses.replace(run, context=run.context | dict.fromkeys(keys, text))
    assert odd.control_period == pytest.approx(0.02)
    assert math.isnan(odd.answer_wire)
    alone = alone_of(odd, ending_of(odd), LAMP, CALIBRATION, ASSETS, 0.015)
    assert alone.travel == pytest.approx(0.297, abs=0.002)
    assert math.isnan(dataclasses.replace(run, context=run.context | {"goal_m": "inf"}).goal_m)
    flight = dataclasses.replace(run, context=run.context | {"flight_time_s": text})
    assert "flight_time_s is" in alone_of(flight, ending_of(run), LAMP, CALIBRATION, ASSETS, 0.015).why


def test_a_lamp_that_stands_still_tells_no_zero(tmp_path, capsys):
    """Stiction bears what a joint weighs wherever it stands: a neck 64 mrad off explained a difference of nothing."""
    log = dry_run(tmp_path, controller=constant(tmp_path, 0.0, 0.0, 0.0), goal=0.01)
    _, said = compare(capsys, log)
    assert [cause["knob"] for cause in said["diagnosis"]] == []


def test_a_supply_that_sagged_is_told_of(good, tmp_path, capsys):
    sagged = dry_run(tmp_path, event=Event("sag", at=4.0, volts=0.6, lasts=1.0))
    said = {log: compare(capsys, log)[1]["diagnosis"] for log in (good, sagged)}
    assert [[each["cause"] for each in causes if "sagged" in each["cause"]] for causes in said.values()] == [
        [],
        ["the supply sagged to 4.4 V"],
    ]


def test_of_two_logs_the_faults_of_both_are_told(good, tmp_path, capsys):
    faulty = dry_run(tmp_path / "other", event=Event("silent", at=4.0, lasts=0.05, servo=2))
    for pair in ((good, faulty), (faulty, good)):
        _, said = compare(capsys, *pair, "--no-diagnosis", "-o", tmp_path / "r.html")
        assert said["verdict"] == "outside"
        assert [text for text in said["verdict_why"] if "knee: no answer" in text], said["verdict_why"]


def test_what_was_to_drive_for_minutes_is_driven_until_it_rests(good, monkeypatch):
    ticks = [0]

    def counted(self: Pilot, *arguments: Any) -> Any:
        ticks[0] += 1
        return step(self, *arguments)

    step = Pilot.step
    monkeypatch.setattr(Pilot, "step", counted)
    found = []
    for drives in ("15", "600"):
        run = dataclasses.replace(read_run(good), context=read_run(good).context | {"duration_s": drives})
        found.append(alone_of(run, ending_of(run), LAMP, CALIBRATION, ASSETS, 0.015))
    assert found[0] == found[1]
    assert found[0].hit
    assert ticks[0] < 2 * RUNS * 15 / 0.02


def test_one_that_waits_and_drove_to_its_end_is_driven_as_long(good):
    run, text = read_run(good), ASSETS.path("sim/lamp/controllers/hop-counting.toml").read_text()
    late = re.sub(r"terminals = .*\n", "", text)
    late = late.replace("ground_time", "(ifltz (- t 6.3) (- ground_time 6) ground_time)")  # its first hop is at 6 s
    late = re.sub(r'"""(.*?)"""', r'"""(ifltz (- t 6) 0 \1)"""', late, flags=re.DOTALL)
    run = dataclasses.replace(run, context=run.context | {"controller": late, "duration_s": "10"})
    ending = dataclasses.replace(ending_of(run), drove=10.0)
    assert alone_of(run, ending, LAMP, CALIBRATION, ASSETS, 0.015).travel == pytest.approx(0.297, abs=0.02)
