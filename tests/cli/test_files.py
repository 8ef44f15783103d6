"""Whatever is given in a file's place, by whatever argument of whatever verb: one line, exit code 2, soon, small."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from robolamp.assets import shipped
from robolamp.log.writer import LogWriter
from tests.log.ticks import JOINTS, make_tick

ARGUMENTS = {
    "controller of score": "score FILE",
    "controller of explain": "explain FILE",
    "controller of dry-run": "dry-run FILE --goal 0.1 -o OUT",
    "controller of deploy": "deploy FILE --goal 0.1 -o OUT",
    "controller of render": "render FILE -o OUT/x.png",
    "calibration of score": "score hop --calibration FILE",
    "calibration of dry-run": "dry-run hop --goal 0.1 --calibration FILE -o OUT",
    "calibration of compare": "compare LOG --calibration FILE",
    "calibration of calibrate score": "calibrate score FILE RECORDING",
    "base of calibrate fit": "calibrate fit RECORDING -o OUT/x.toml --base FILE",
    "base of calibrate bam": "calibrate bam PARAMETERS -o OUT/x.toml --base FILE",
    "calibration to export": "calibrate bam FILE -o OUT/x.json",
    "parameters to import": "calibrate bam FILE.json -o OUT/x.toml",
    "recording of calibrate score": "calibrate score nominal FILE.csv",
    "recording of calibrate fit": "calibrate fit FILE.json -o OUT/x.toml",
    "recording of calibrate report": "calibrate report nominal FILE.mcap -o OUT/x.html",
    "servo of calibrate record": "calibrate record --servo FILE -o OUT --emulate",
    "reality": "dry-run hop --goal 0.1 --reality FILE -o OUT",
    "faults": "dry-run hop --goal 0.1 --faults FILE -o OUT",
    "faults of emulate": "emulate --faults FILE",
    "servos of emulate": "emulate --servos FILE",
    "tolerances": "compare LOG --tolerances FILE",
    "log of compare": "compare FILE",
    "other log of compare": "compare LOG FILE",
    "truth of compare": "compare LOG --truth FILE",
    "log of replay": "replay FILE -o OUT/x.html",
    "log of render": "render FILE.mcap -o OUT/x.png",
    "log of log info": "log info FILE",
    "log of log export": "log export FILE -o OUT/x.csv",
    "log of log recover": "log recover FILE -o OUT/x.mcap",
    "task of evolve": "evolve FILE -o OUT/run",
    "terms of evolve": "evolve hop --terms FILE -o OUT/run",
    "lamp.toml": "score hop --lamp LAMP/hardware/lamp.toml",
    "a model": "score hop --lamp LAMP/sim/lamp/scene.xml",
    "a session's manifest": "calibrate lamp LAMP/manifest.toml -o OUT/x.toml",
    "a session's manifest reported": "calibrate report nominal LAMP/manifest.toml -o OUT/x.html",
    "an EEPROM": "emulate --eeprom LAMP/knee.toml",
    "a run's record": "evolve --resume LAMP/run.toml",
}
"""Verbs with FILE where the thing goes, or LAMP/NAME where it goes into a folder under that name."""

THINGS = ("pipe", "device", "socket", "folder", "sparse")
WORDS = {
    "pipe": "named pipe",
    "device": "device",
    "socket": "socket",
    "folder": "a folder|a directory|no recording",
    "sparse": "is too large: 6,",
}


def made(thing: str, path: Path) -> None:
    """Put something into a file's place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if thing == "pipe":
        os.mkfifo(path)
    elif thing == "device":
        path.symlink_to("/dev/zero")
    elif thing == "socket":
        with socket.socket(socket.AF_UNIX) as end:
            here = Path.cwd()
            os.chdir(path.parent)  # a socket's whole path is short
            try:
                end.bind(path.name)
            finally:
                os.chdir(here)
    elif thing == "folder":
        path.mkdir()
    else:
        with path.open("wb") as stream:
            stream.truncate(6_000_000_000)


def words_of(template: str, thing: str, folder: Path, sound: dict[str, str]) -> list[str]:
    def put(word: str) -> str:
        if word.startswith("FILE"):
            path = folder / f"{thing}{word.removeprefix('FILE')}"
            made(thing, path)
            return str(path)
        if word.startswith("LAMP/"):
            made(thing, folder / word)
            return str(folder / "LAMP")
        return str(folder / word) if word.startswith("OUT") else sound.get(word, word)

    return [put(word) for word in template.split()]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("sound")
    recording = folder / "a.csv"
    rows = "\n".join(f"{i / 100:.2f},{0.5 * (i // 50 % 2)},{0.4 * (i // 60 % 2)},5.0" for i in range(300))
    recording.write_text(f"# p_gain = 400\n# mass = 0.2\n# length = 0.1\ntime_s,goal_rad,angle_rad,voltage_v\n{rows}\n")
    parameters = folder / "m1.json"
    values = {"kt": 0.3, "R": 3.0, "armature": 0.002, "friction_base": 0.01, "friction_viscous": 0.005}
    parameters.write_text(json.dumps({"model": "m1", "actuator": "xl330", **values}))
    path = folder / "run.mcap"
    with LogWriter(path, context={"goal_m": "0.3", "control_period": "0.02"}, joints=JOINTS, now=100.0) as log:
        for index in range(20):
            log.tick(make_tick(index))
    return {"RECORDING": str(recording), "PARAMETERS": str(parameters), "LOG": str(path)}


@pytest.fixture(scope="module")
def driver() -> Iterator[subprocess.Popen[str]]:
    words = [sys.executable, "-m", "tests.cli.file_driver"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        assert process.stdin is not None
        process.stdin.close()
        process.wait(timeout=30)


def told(driver: subprocess.Popen[str], words: Sequence[str]) -> dict[str, object]:
    assert driver.stdin is not None
    assert driver.stdout is not None
    driver.stdin.write(json.dumps(list(words)) + "\n")
    driver.stdin.flush()
    return json.loads(driver.stdout.readline())


def in_one_line(said: dict[str, object]) -> str:
    assert said["code"] == 2, said
    message = str(said["err"])
    assert message.startswith("robolamp: ")
    assert message.count("\n") == 1, message
    assert len(message) < 1500
    assert int(str(said["kilobytes"])) < 300_000, said
    return message


# A folder of recordings or of runs has a meaning of its own.
FOLDERS = ("log of compare", "recording of calibrate score", "lamp.toml")
CASES = [
    (name, thing) for name in ARGUMENTS for thing in THINGS if (thing, name) not in {("folder", x) for x in FOLDERS}
]


@pytest.mark.parametrize(("argument", "thing"), CASES)
def test_what_is_no_file_is_named(
    argument: str, thing: str, tmp_path: Path, sound: dict[str, str], driver: subprocess.Popen[str]
) -> None:
    message = in_one_line(told(driver, words_of(ARGUMENTS[argument], thing, tmp_path, sound)))
    assert re.search(WORDS[thing], message), message
    assert not [item for item in tmp_path.rglob("*") if item.is_file() and item.stat().st_size < 1e9]


MARK = b"\xef\xbb\xbf"


def with_mark(source: Path, target: Path) -> str:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(MARK + source.read_bytes())
    return str(target)


def test_a_byte_order_mark_is_read_over_in_every_text(
    tmp_path: Path, sound: dict[str, str], driver: subprocess.Popen[str]
) -> None:
    data = shipped()
    controller = with_mark(data / "sim/lamp/controllers/hop.toml", tmp_path / "c.toml")
    calibration = with_mark(data / "calibration/nominal.toml", tmp_path / "n.toml")
    recording, parameters = (with_mark(Path(sound[name]), tmp_path / name) for name in ("RECORDING", "PARAMETERS"))
    Path(recording).rename(tmp_path / "A.CSV")
    Path(parameters).rename(tmp_path / "M1.JSON")
    for name in ("hardware/lamp.toml", "sim/tasks/hop.toml"):
        with_mark(data / name, tmp_path / "lamp" / name)
    lamp = str(tmp_path / "lamp")
    for words in (
        ["explain", controller, "--calibration", calibration, "--lamp", lamp, "--goals", "0.2", "--duration", "0.5"],
        ["calibrate", "score", calibration, str(tmp_path / "A.CSV")],
        ["calibrate", "bam", str(tmp_path / "M1.JSON"), "-o", str(tmp_path / "x.toml")],
        ["calibrate", "bam", calibration, "-o", str(tmp_path / "X.JSON")],
    ):
        said = told(driver, words)
        assert said["code"] == 0, said


@pytest.mark.parametrize(
    "words",
    [
        "replay LOG -o LOG",
        "replay LOG --truth PARAMETERS -o PARAMETERS",
        "log recover LOG -o LOG",
        "compare LOG -o LOG",
        "calibrate fit RECORDING -o RECORDING",
        "calibrate report nominal RECORDING -o RECORDING",
        "calibrate bam PARAMETERS -o PARAMETERS",
    ],
)
def test_what_is_read_is_never_written_over(words: str, sound: dict[str, str], driver: subprocess.Popen[str]) -> None:
    before = {path: Path(path).read_bytes() for path in sound.values()}
    message = in_one_line(told(driver, [sound.get(word, word) for word in words.split()]))
    assert "choose another -o" in message
    assert {path: Path(path).read_bytes() for path in sound.values()} == before


@pytest.mark.parametrize("name", ["limbo-22.5cm", "limbo-22.5cm.toml"])
def test_a_shipped_name_with_a_point_is_found(name: str, driver: subprocess.Popen[str]) -> None:
    said = told(driver, ["explain", name, "--goals", "0.2", "--duration", "0.5", "--json"])
    assert said["code"] == 0, said


DOTS = "a" + ".a" * 50_000 + " = 1\n"


@pytest.mark.parametrize("text", [DOTS, "a = " + "[" * 50_000, "a = " + "{a=" * 50_000], ids=["key", "array", "table"])
@pytest.mark.parametrize("argument", [name for name in ARGUMENTS if name not in ("a model", "terms of evolve")])
def test_toml_nested_without_end_is_refused_at_once(
    argument: str, text: str, tmp_path: Path, sound: dict[str, str], driver: subprocess.Popen[str]
) -> None:
    words = words_of(ARGUMENTS[argument], "pipe", tmp_path, sound)
    (place,) = [path for path in tmp_path.rglob("*") if path.is_fifo()]
    place.unlink()
    place.write_text(text)
    began = time.monotonic()
    message = in_one_line(told(driver, words))
    assert time.monotonic() - began < 15
    if "log" not in argument and "truth" not in argument and not place.suffix:
        assert "not valid TOML" in message


def test_an_override_nested_without_end_is_refused_at_once(tmp_path: Path, driver: subprocess.Popen[str]) -> None:
    for override in (DOTS.replace(" ", "").strip(), "a=" + "[" * 50_000, "a=" + "1" * 5000):
        in_one_line(told(driver, ["evolve", "hop", "-o", str(tmp_path / "run"), "--set", override]))
