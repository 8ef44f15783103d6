"""A port that was unplugged and came back: what the controller did before and afterwards is compared, and no more."""

from __future__ import annotations

import json

import numpy as np
import pytest

from robolamp.cli.main import main
from robolamp.compare.pauses import on_clock_of, pauses, silent
from robolamp.compare.replays.controller_replay import replay_controller
from robolamp.emulator.faults.script import Event
from robolamp.emulator.reality.file import Reality
from robolamp.log.reader import read_run
from robolamp.log.summary import summarise

from .emulated import hop
from .lamps import LAMP

NONE = Reality.none(LAMP)
GONE = {
    "standing": (Event("unplugged", at=1.0, lasts=0.4, port="servo"),),
    "in the run": (Event("unplugged", at=4.46, lasts=0.4, port="servo"),),
    "in the run, for 2 s": (Event("unplugged", at=4.46, lasts=2.0, port="servo"),),
    "no servo answers": tuple(Event("silent", at=4.46, servo=joint.id, lasts=0.5) for joint in LAMP.joints),
}


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    return hop(tmp_path_factory.mktemp("straight") / "straight.mcap", NONE)


@pytest.fixture(scope="module", params=GONE)
def replugged(request, tmp_path_factory):
    """A log of a nominal lamp whose servo port was gone for a while."""
    folder = tmp_path_factory.mktemp("replugged")
    return hop(folder / "replugged.mcap", NONE, events=GONE[request.param], day=1)


def call(capsys, *words) -> dict:
    with pytest.raises(SystemExit) as caught:
        main(["compare", *map(str, words), "--json"])
    out, err = capsys.readouterr()
    assert err == ""
    return {"code": caught.value.code or 0, **json.loads(out)}


@pytest.mark.slow
def test_the_twin_explains_a_nominal_lamp_that_was_replugged(replugged, tmp_path, capsys):
    result = call(capsys, replugged, "-o", tmp_path / "r.html")
    assert (result["code"], result["verdict"], result["exceeded"]) == (0, "inside", [])
    assert result["parted_s"] is None
    assert result["parted_first_s"] is None
    assert result["missed_ticks"] == 0
    assert result["controller_exact"] is not False
    said = [finding["cause"] for finding in result["diagnosis"]]
    assert [text for text in said if "log holds faults" not in text] == []
    assert summarise(replugged).missed_ticks == 0


def test_two_runs_of_which_one_was_replugged_are_alike(replugged, straight, tmp_path, capsys):
    result = call(capsys, replugged, straight, "--no-diagnosis", "-o", tmp_path / "ab.html")
    assert result["against"] == str(straight)
    for joint in result["joints"]:
        assert joint["mae_mrad"]["after"] < 15.0  # half of what is allowed: a pause lets it settle
        assert abs(joint["lag_ms"]) < 5.0
    assert result["parted_s"] is None  # where it stood then, it stands a little otherwise: stiction
    other = call(capsys, straight, replugged, "--no-diagnosis", "-o", tmp_path / "ba.html")
    assert other["joints"] == result["joints"]  # the later one is held against the earlier, whichever is named first


def test_the_controllers_time_stands_still_in_a_pause(replugged, straight):
    run, whole = read_run(replugged), read_run(straight)
    found = pauses(run)
    assert len(found) == (1 if run.phase[run.restarts].size and (run.phase == "run")[: run.restarts[0]].any() else 0)
    assert pauses(whole) == ()
    for pause in found:
        assert pause.length > 1.5  # it goes softly to where it was
        lost = np.isnan(run.angle[pause.last]).all()
        assert silent(run)[pause.last] == lost
        assert replay_controller(run, LAMP).exact
        # On the clock of the run that was not interrupted the first tick afterwards follows the last.
        ticks = run.scheduled[[pause.last, pause.next]] - run.scheduled[np.flatnonzero(run.phase == "run")[0]]
        first, second = on_clock_of(whole, run, ticks)
        assert 0.0 < second - first < 0.06
        back = on_clock_of(run, whole, np.array([first, second]))
        np.testing.assert_allclose(back, ticks, atol=1e-6)
    assert replay_controller(whole, LAMP).exact


def test_a_run_that_lost_a_port_forever_is_not_paused(tmp_path):
    gone = Event("unplugged", at=4.46, lasts=60.0, port="servo")
    run = read_run(hop(tmp_path / "log.mcap", NONE, events=(gone,)))
    assert pauses(run) == ()
    assert not silent(run).any()
