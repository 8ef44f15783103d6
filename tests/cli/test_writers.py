"""Whoever writes a file writes it where it was asked to, and nowhere else; and leaves nothing half-written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robolamp.errors import FileError
from robolamp.files import alone, open_new, write_atomic

RUN = "dry-run hop --goal 0.3 --lockstep --duration 0.5"
WRITERS = {  # every verb that writes files, all that it can write
    "dry-run": f"{RUN} --faults quiet.toml -o out",
    "compare": "compare run/log.mcap -o out/report.html",
    "compare a folder": "compare run -o out/report.html",
    "calibrate bam": "calibrate bam nominal -o out/bam.json",
    "calibrate bam, import": "calibrate bam bam.json -o out/bam.toml",
    "calibrate record": "calibrate record --emulate --step drop-2 -o out",
    "evolve": "evolve hop -o out --population 2 --generations 1 --seed-from hop --set duration=0.5",
    "study": "study population --points 10 --seeds 1 --set duration=0.5 --set gp.generations=1 -o out",
    "log export": "log export run/log.mcap -o out/run.csv",
    "log recover": "log recover run/log.mcap -o out/recovered.mcap",
    "replay": "replay run/log.mcap -o out/page.html",
    "render": "render run/log.mcap -o out/strip.png --no-opengl",
    "new": "new out",
}
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGQUIT: 131, signal.SIGHUP: 129}
QUIET = 'name = "quiet"\n'
MAIN = "from robolamp.cli.entry import main; main()"
STRUCK = f"""
import os, signal
signal.signal(NUMBER, signal.SIG_DFL)  # it may be ignored where the tests run, as behind nohup
def strike(place):
    real = getattr(os, place)
    def struck(*words, **more):
        os.kill(os.getpid(), NUMBER)
        for _ in range(1000): pass  # where the handler runs
        return real(*words, **more)
    setattr(os, place, struck)
strike("replace"); strike("rename")
{MAIN}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("a run")
    call(f"{RUN} -o run", folder)
    call("calibrate bam nominal -o bam.json", folder)
    return folder


def call(words: str, folder: Path, code: str = MAIN) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *words.split()]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=250)


def prepared(folder: Path, run: Path) -> Path:
    folder.mkdir()
    (folder / "run").symlink_to(run / "run")
    (folder / "bam.json").symlink_to(run / "bam.json")
    (folder / "quiet.toml").write_text(QUIET)
    return folder


def files(folder: Path) -> set[Path]:
    """What is in the folder of the output, and beside it."""
    found = {path.relative_to(folder) for path in folder.rglob("*") if not path.is_dir() or path.is_symlink()}
    return {
        path for path in found if path.name not in ("run", "bam.json", "quiet.toml", ".lock") or "out" in path.parts
    }


@pytest.mark.parametrize("writer", WRITERS)
def test_links_are_not_written_through_and_a_signal_leaves_nothing(tmp_path: Path, run: Path, writer: str) -> None:
    words = WRITERS[writer]
    clean = prepared(tmp_path / "clean", run)
    done = call(words, clean)
    assert done.returncode in (0, 1), done.stderr
    written = {path for path in files(clean) if path.name != ".lock"}
    assert written

    planted, outside = prepared(tmp_path / "planted", run), tmp_path / "outside"
    outside.mkdir()
    for number, path in enumerate(sorted(written)):
        (planted / path).parent.mkdir(parents=True, exist_ok=True)
        (planted / path).symlink_to(outside / str(number))
        if number % 2 == 0 and path.name != "log.mcap":  # the others dangle; a log that is there is never written over
            (outside / str(number)).write_text("precious")
    before = {path.name: path.read_text() for path in outside.iterdir()}
    again = call(words, planted)
    if again.returncode == 2:
        assert again.stderr.count("\n") == 1, again.stderr
    else:
        assert again.returncode == done.returncode, again.stderr
        assert not any((planted / path).is_symlink() for path in written)
    assert {path.name: path.read_text() for path in outside.iterdir()} == before

    struck = prepared(tmp_path / "struck", run)
    ended = call(words, struck, STRUCK.replace("NUMBER", str(int(signal.SIGTERM))))
    assert ended.returncode in (130, 143, 2), ended.stderr
    assert "Traceback" not in ended.stderr
    assert files(struck) <= {*written, *(path for path in files(struck) if path.name == ".lock")}


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_a_write_as_a_shell_says_it(tmp_path: Path, run: Path, number: signal.Signals) -> None:
    folder = prepared(tmp_path / "struck", run)
    ended = call(WRITERS["log export"], folder, STRUCK.replace("NUMBER", str(int(number))))
    assert (ended.returncode, ended.stdout, ended.stderr) == (SIGNALS[number], "", "")
    assert files(folder) == set()


def test_a_signal_that_is_ignored_stays_so(tmp_path: Path, run: Path) -> None:
    folder = prepared(tmp_path / "struck", run)
    code = STRUCK.replace("SIG_DFL", "SIG_IGN")
    assert call(WRITERS["log export"], folder, code.replace("NUMBER", str(int(signal.SIGHUP)))).returncode == 0
    assert {path.name for path in files(folder)} == {"run.csv"}


def test_a_file_of_two_names_changes_under_one_only(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("precious")
    (tmp_path / "planted").hardlink_to(tmp_path / "mine")
    with os.fdopen(open_new(tmp_path / "planted"), "w") as stream:
        stream.write("new")
    assert (tmp_path / "mine").read_text() == "precious"


def test_a_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    (tmp_path / "stdout").symlink_to("/dev/null")
    os.mkfifo(tmp_path / "pipe")
    for name in ("stdout", "pipe"):
        with pytest.raises(FileError, match="is a device or a pipe; expected a file"):
            write_atomic(tmp_path / name, "x")
    assert (tmp_path / "stdout").is_symlink()
    assert (tmp_path / "pipe").is_fifo()
    with pytest.raises(OSError, match="No such device"):  # and nobody waits for a reader
        open_new(tmp_path / "pipe")


def test_a_lock_is_no_way_out_either(tmp_path: Path) -> None:
    (tmp_path / ".lock").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(FileError, match="cannot be written"), alone(tmp_path):
        pass
    assert not (tmp_path / "elsewhere").exists()


def test_a_link_to_a_folder_is_a_folder_to_write_to(tmp_path: Path, run: Path) -> None:
    folder = prepared(tmp_path / "asked", run)
    (folder / "elsewhere").mkdir()
    (folder / "out").symlink_to("elsewhere")
    assert call(WRITERS["log export"], folder).returncode == 0
    assert (folder / "elsewhere" / "run.csv").is_file()
