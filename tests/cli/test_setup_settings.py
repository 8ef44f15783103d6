"""Servo settings from the command line: an emulated lamp whose EEPROM another client has been in."""

from __future__ import annotations

import contextlib
import json
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from contract.backends import LAMP
from emulator.test_process import emulator

from robolamp.assets import Assets
from robolamp.lamp import load_lamp

from .test_main import call
from .test_setup import Foot

WRONG = {
    "Drive Mode": (1, "Drive Mode(10) is 1, not 0", {"zero", "sign"}),
    "Homing Offset": (300, "Homing Offset(20) is 300, not 0", {"zero"}),
    "Secondary(Shadow) ID": (1, "Secondary(Shadow) ID(12) is 1, not 255", set()),
    "Startup Configuration": (1, "Startup Configuration(60) is 1, not 0", set()),
    "Velocity Limit": (30, "Velocity Limit(44) is 30, not 445", set()),
    "Temperature Limit": (45, "Temperature Limit(31) is 45, not 70", set()),
}


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A lamp's folder of one's own."""
    shutil.copytree(LAMP.path.parent, tmp_path / "own" / "hardware")
    return tmp_path / "own"


@contextlib.contextmanager
def wrong(folder: Path, **eeprom: dict[str, int]) -> Iterator[tuple[object, ...]]:
    """An emulated lamp with EEPROM as given, by joint: the words that name its ports."""
    folder.mkdir()
    for joint, registers in eeprom.items():
        rows = "".join(f'"{name}" = {value}\n' for name, value in registers.items())
        (folder / f"{joint}.toml").write_text(f'model = "XL330-M288-T"\n[eeprom]\n{rows}')
    with emulator("--reality", "none", "--eeprom", str(folder)) as (_, ready):
        yield "--port", ready["servo_port"], "--foot-port", ready["foot_port"]


@pytest.mark.parametrize("register", WRONG)
def test_ready_is_said_only_where_it_is_so(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, own: Path, register: str
) -> None:
    value, said, upset = WRONG[register]
    with wrong(tmp_path / "eeprom", knee={register: value}) as ports:
        words = (*ports, "--lamp", own)
        code, out, _ = call(capsys, "setup", "check", *words, "--json")
        assert (code, said in json.loads(out)["error"]) == (2, True), out
        if register == "Startup Configuration":  # torque came on with the power, and locks EEPROM
            assert "Torque Enable(64) is 1, not 0; `robolamp stop` first" in json.loads(out)["error"]
            assert call(capsys, "stop", *ports[:2])[0] == 0
        code, out, err = call(capsys, "setup", "check", "--fix", *words)
        assert f"mended: knee (id 2): {said}" in out + err
        if upset:
            assert code == 2
            assert err.endswith("`robolamp setup zero`\n")
            code, out, _ = call(capsys, "deploy", "hop", "--goal", "0.1", "-o", tmp_path / "run", *words, "--json")
            assert (code, "`robolamp setup zero`" in json.loads(out)["error"]) == (2, True), out
            assert not (tmp_path / "run").exists()
            zero = ("setup", "zero", "--keep-signs", "--yes", *ports[:2], "--lamp", own, "--json")
            code, out, _ = call(capsys, *zero)
            if "sign" in upset:
                assert (code, json.loads(out)["where"]) == (2, "--keep-signs")
                assert "the signs must be found again: knee's (Drive Mode(10) was 1)" in json.loads(out)["error"]
                return
            assert code == 0, out
            assert "wanted" not in (own / "hardware" / "lamp.toml").read_text()
        code, out, err = call(capsys, "setup", "check", *words)
        assert (code, "ready" in out) == (0, True), err


def test_zeros_are_not_found_while_a_setting_makes_them_wrong(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, own: Path
) -> None:
    before = (own / "hardware" / "lamp.toml").read_text()
    with wrong(tmp_path / "eeprom", knee={"Homing Offset": 300}) as ports:
        zero = ("setup", "zero", "--keep-signs", "--yes", *ports[:2], "--lamp", own, "--json")
        code, out, _ = call(capsys, *zero)
    assert code == 2
    assert "Homing Offset(20) is 300, not 0" in json.loads(out)["error"]
    assert "`robolamp setup check --fix` first" in json.loads(out)["error"]
    assert (own / "hardware" / "lamp.toml").read_text() == before


def test_a_mend_leaves_the_rest_of_lamp_toml_alone(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, own: Path
) -> None:
    before = (own / "hardware" / "lamp.toml").read_text()
    with wrong(tmp_path / "eeprom", neck={"Drive Mode": 1, "Homing Offset": 7}) as ports:
        assert call(capsys, "setup", "check", "--fix", *ports, "--lamp", own)[0] == 2
    after = (own / "hardware" / "lamp.toml").read_text().splitlines()
    added = [line for line in after if "_wanted" in line]
    assert [line for line in after if line not in added] == before.splitlines()
    assert sorted(line.split(" = ")[0] for line in added) == ["sign_wanted", "zero_wanted"]
    neck = load_lamp(Assets.of(own)).joints[2]
    assert neck.sign_wanted == "Drive Mode(10) was 1"


def test_two_new_servos_on_the_line_are_not_renumbered(capsys: pytest.CaptureFixture[str]) -> None:
    with emulator("--reality", "none", "--factory") as (process, ready):
        process.send_signal(signal.SIGUSR1)  # the next one is plugged in before the first has its id
        words = ("--port", ready["servo_port"], "--last-id", 3, "--json")
        deadline = time.monotonic() + 60.0  # a busy computer plugs it in late
        found: list[tuple[int, int, bool]] = []
        while found != [(1, 57_600, True)] and time.monotonic() < deadline:
            code, out, _ = call(capsys, "setup", "scan", *words)
            assert code == 0
            found = [(row["id"], row["baud"], row.get("doubled", False)) for row in json.loads(out)["servos"]]
        assert found == [(1, 57_600, True)]
        error = "found none"
        while "found none" in error and time.monotonic() < deadline:  # nor does it hear them at once
            code, out, _ = call(capsys, "setup", "assign", "--joint", "ankle", *words)
            assert code == 2
            error = json.loads(out)["error"]
        assert "several servos answer to this id" in error
        code, out, _ = call(capsys, "setup", "scan", *words)
        assert [row["id"] for row in json.loads(out)["servos"]] == [1]


@pytest.mark.parametrize("tare", [0.0, -0.25, 0.3])
def test_a_tare_of_a_standing_lamp_is_refused(
    capsys: pytest.CaptureFixture[str], own: Path, tare: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = own / "hardware" / "lamp.toml"
    path.write_text(path.read_text().replace("tare = 0.0 ", f"tare = {tare} "))
    before = path.read_text()
    with Foot(tare + 2.06) as foot:
        words = ("setup", "foot", "--lamp", own, "--foot-port", foot.name, "--json")
        code, out, _ = call(capsys, *words, "--yes")
        assert code == 2
        assert f"it shows {tare + 2.06:.2f} N, 2.06 N above its tare so far" in json.loads(out)["error"]
        assert path.read_text() == before
        # Where the tare so far has the weight in it already, only a lamp that is set down shows that.
        path.write_text(before.replace(f"tare = {tare} ", f"tare = {tare + 2.06} "))
        monkeypatch.setattr("robolamp.cli.setup._ask", lambda text: None)
        code, out, _ = call(capsys, *words)
    assert code == 2
    assert "0.00 N above the lifted one, less than the 0.4 N of a ground contact" in json.loads(out)["error"]


STEPS = {
    "scan": ({"--port", "--last-id"}, "Show which servos answer"),
    "assign": ({"--port", "--last-id", "--joint"}, "Give the one new servo"),
    "zero": ({"--port", "--keep-signs", "--yes"}, "Find zeros and signs"),
    "foot": ({"--foot-port", "--weight", "--yes"}, "Tare the foot sensor"),
    "check": ({"--port", "--foot-port", "--fix"}, "Check everything"),
}


@pytest.mark.parametrize("step", STEPS)
def test_each_step_has_a_help_of_its_own(capsys: pytest.CaptureFixture[str], step: str) -> None:
    own, begins = STEPS[step]
    code, out, _ = call(capsys, "setup", step, "--help")
    assert code == 0
    assert begins in out
    every = set().union(*(options for options, _ in STEPS.values()))
    assert {option for option in every if f"{option} " in out} == own
    code, out, _ = call(capsys, "setup", "--help")
    assert code == 0
    assert begins in out
