"""Every verb in poor surroundings: closed streams, narrow character sets, no home, an install that nobody may write."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

import robolamp
from robolamp.cli.main import app

ROBOLAMP = [sys.executable, "-m", "robolamp"]
RUN = "dry-run hop --goal 0.3 --lockstep --duration 0.5"
WORK = {  # by verb: a call that is soon done, and its exit code; none of them has a lamp that it could reach
    "dry-run": (f"{RUN} -o again", 0),
    "deploy": ("deploy hop --goal 0.3 --port none --foot-port none", 2),
    "stop": ("stop --port none", 2),
    "monitor": ("monitor --port none --foot-port none", 2),
    "setup scan": ("setup scan --port none", 2),
    "setup assign": ("setup assign --joint knee --port none", 2),
    "setup zero": ("setup zero --keep-signs --yes --port none", 2),
    "setup foot": ("setup foot --yes --foot-port none", 2),
    "setup check": ("setup check --port none --foot-port none", 2),
    "compare": ("compare run/log.mcap -o compared.html", 1),
    "calibrate record": ("calibrate record -o session", 2),
    "calibrate lamp": ("calibrate lamp run -o lamp.toml", 2),
    "calibrate report": ("calibrate report nominal run/log.mcap -o report.html", 2),
    "calibrate all": ("calibrate all -o none/at/all --calibration none", 2),
    "calibrate fit": ("calibrate fit run/log.mcap -o servo.toml", 2),
    "calibrate bam": ("calibrate bam nominal -o bam.json", 0),
    "calibrate score": ("calibrate score nominal run/log.mcap", 2),
    "score": ("score hop --goals 0.3 --duration 1", 0),
    "explain": ("explain hop", 0),
    "evolve": ("evolve hop -o evolved --population 2 --generations 1 --seed-from hop --set duration=0.5", 0),
    "study": ("study population --points 10 --seeds 1 --set duration=0.5 --set gp.generations=1 -o studies", 0),
    "log info": ("log info run/log.mcap", 0),
    "log export": ("log export run/log.mcap -o run.csv", 0),
    "log recover": ("log recover run/log.mcap -o recovered.mcap", 0),
    "replay": ("replay run/log.mcap -o page.html", 0),
    "render": ("render run/log.mcap -o strip.png --no-opengl", 0),
    "new": ("new mine", 0),
    "odometer fit": ("odometer fit nobody -o odometer.toml", 2),
    "odometer score": ("odometer score --odometer none", 2),
    "gesture list": ("gesture list", 0),
    "gesture check": ("gesture check nobody", 2),
    "gesture play": ("gesture play nobody", 2),
    "gesture record": ("gesture record wave --port none --foot-port none", 2),
    "play": ("play nobody", 2),
    "emulate": ("emulate --ports ports", 0),
}
NARROW = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
BARE = {  # what surrounds it: redirections of a shell, and its environment
    "input and output closed": ("<&- >&-", NARROW),
    "errors closed": ("2>&-", {"PYTHONIOENCODING": "ascii"}),
    "nobody reads": ("", {"PYTHONIOENCODING": "latin-1"}),
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("a run") / "run"
    subprocess.run([*ROBOLAMP, *RUN.split(), "-o", str(folder)], check=True, capture_output=True)
    return folder


def verbs() -> Iterator[str]:
    for name in app:
        if not name.startswith("-"):
            steps = [step for step in app[name] if not step.startswith("-")]
            yield from [f"{name} {step}" for step in steps] or [name]


def test_every_verb_is_tried() -> None:
    assert set(verbs()) == set(WORK)


def called(words: str, folder: Path, redirect: str, more: Mapping[str, str], stdout: int) -> tuple[int, str, str]:
    """Exit code, output and errors of a verb that a shell starts; an emulator is ended when its ports are there."""
    command = ["sh", "-c", f'exec "$@" {redirect}', "sh", *ROBOLAMP, *words.split()]
    environment = {**os.environ, **more}
    pipes = {"stdout": stdout, "stderr": subprocess.PIPE, "text": True, "errors": "surrogateescape"}
    with subprocess.Popen(command, cwd=folder, env=environment, **pipes) as process:  # type: ignore[call-overload]
        if words.startswith("emulate"):
            while process.poll() is None and not (folder / "ports" / "foot").exists():
                time.sleep(0.02)
            process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=120)
    return process.returncode, out or "", err


@pytest.mark.parametrize("verb", WORK)
@pytest.mark.parametrize("bare", BARE)
def test_a_verb_needs_no_streams_and_no_character_set(tmp_path: Path, run: Path, bare: str, verb: str) -> None:
    (tmp_path / "run").symlink_to(run)
    redirect, environment = BARE[bare]
    words, expected = WORK[verb]
    if bare == "nobody reads":
        read, write = os.pipe()
        os.close(read)
        code, out, err = called(words, tmp_path, redirect, environment, write)
        os.close(write)
        assert code in (expected, 141)
    else:
        code, out, err = called(words, tmp_path, redirect, environment, subprocess.PIPE)
        assert code == expected
    assert out.isascii()
    for said in ("Traceback", "ignored", "lost sys", "Error in"):
        assert said not in err
    if code == 2 and not redirect.endswith("2>&-"):
        assert err.startswith("robolamp: ")
        assert err.count("\n") == 1


def test_a_name_that_is_no_text_is_shown_and_kept(tmp_path: Path) -> None:
    folder = os.fsencode(tmp_path) + b"/m\xfcll"
    for encoding in ("utf-8", "ascii"):
        environment = {**os.environ, "PYTHONIOENCODING": encoding}
        done = subprocess.run([*ROBOLAMP, "score", folder], env=environment, capture_output=True, check=False)
        assert (done.returncode, done.stderr.count(b"\n"), done.stdout) == (2, 1, b"")
        assert done.stderr.startswith(b"robolamp: " + folder)


@pytest.mark.parametrize("verb", ["compare", "replay", "render", "log info", "log export", "log recover"])
def test_a_log_whose_name_is_no_text_is_used_like_any_other(tmp_path: Path, run: Path, verb: str) -> None:
    name = b"m\xfcll.mcap"
    shutil.copy(run / "log.mcap", os.fsencode(tmp_path) + b"/" + name)
    words, expected = WORK[verb]
    command = [*ROBOLAMP, *(name if word == "run/log.mcap" else word for word in words.split())]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (expected, b"")


# What root may not write to, either, once it has laid down the right to.
UNPRIVILEGED = ["setpriv", "--bounding-set=-dac_override,-fowner", "--inh-caps=-dac_override,-fowner"]


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, list[str]]]:
    """A copy of the package without compiled code that cannot be written to, and what a command has to begin with."""
    top = tmp_path_factory.mktemp("sealed")
    root = Path(robolamp.__file__).parents[1]
    for name in ("robolamp", "sim", "calibration", "hardware"):
        shutil.copytree(root / name, top / name, ignore=shutil.ignore_patterns("__pycache__"))
    (top / "home").mkdir()
    folders = [top, *(path for path in top.rglob("*") if path.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    before = UNPRIVILEGED if os.getuid() == 0 else []
    if before and not shutil.which("setpriv"):
        pytest.skip("root may write anywhere, and there is no setpriv that takes this right away")
    assert subprocess.run([*before, "touch", str(top / "x")], check=False, capture_output=True).returncode == 1
    yield top, before
    for folder in folders:
        folder.chmod(0o755)


@pytest.mark.parametrize("verb", ["score", "explain", "compare", "render", "evolve", "dry-run"])
@pytest.mark.parametrize("home", ["unset", "missing", "sealed"])
def test_no_home_and_an_install_that_nobody_may_write(
    tmp_path: Path, run: Path, sealed: tuple[Path, list[str]], home: str, verb: str
) -> None:
    top, before = sealed
    (tmp_path / "run").symlink_to(run)
    temporary = run.parent / "tmp"  # one for all, so that each function is compiled once
    temporary.mkdir(exist_ok=True)
    kept = {name: value for name, value in os.environ.items() if name in ("PATH", "LANG", "MUJOCO_GL")}
    at = {"unset": {}, "missing": {"HOME": "/dev/null/none"}, "sealed": {"HOME": str(top / "home")}}[home]
    if home == "unset":  # then the password file has a home, which this must not write to
        at = {"XDG_CACHE_HOME": str(top / "home"), "XDG_CONFIG_HOME": str(top / "home")}
    words, expected = WORK[verb]
    done = subprocess.run(
        [*before, *ROBOLAMP, *words.split()],
        cwd=tmp_path,
        env={**kept, **at, "PYTHONPATH": str(top), "TMPDIR": str(temporary)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == expected, done.stderr
    assert "Traceback" not in done.stderr
    assert not re.search("cache directory|shader cache|locator", done.stderr)  # matplotlib, Mesa, numba
    assert not list(top.rglob("__pycache__"))
    kept_in = {path.name for path in temporary.glob("robolamp-*/*")}
    assert kept_in >= {"matplotlib", "numba"}


def test_a_cache_of_somebody_else_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code is run: a folder that others can write to, or put there, is none to load it from."""
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/none")
    code = "from robolamp.caches import cache_folder; print(cache_folder('numba'))"
    place = tmp_path / f"robolamp-{os.getuid()}"

    def found() -> str:
        environment = {**os.environ, "TMPDIR": str(tmp_path)}
        return subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert found() == str(place / "numba")
    place.chmod(0o777)
    assert found() == "None"
    shutil.rmtree(place)
    (tmp_path / "theirs").mkdir(mode=0o700)
    place.symlink_to(tmp_path / "theirs")
    assert found() == "None"
