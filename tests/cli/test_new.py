"""`robolamp new`, as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.main import main
from robolamp.errors import FileError
from robolamp.evolve.tasks.task import load_task
from robolamp.lamp import load_lamp
from robolamp.twin.lamp_model import build


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as exited:
        main([*words])
    out, err = capsys.readouterr()
    return int(exited.value.code or 0), out, err


def test_a_new_folder_is_a_whole_lamp_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "deep" / "mine"
    code, out, _ = run(capsys, "new", str(folder), "--json")
    told = json.loads(out)
    assert code == 0
    assert sorted(told["files"]) == sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())
    assert [path.name for path in folder.parent.iterdir()] == ["mine"]
    assets = Assets.of(folder)
    lamp, calibration = load_lamp(assets), load_calibration(assets)
    assert all(path.is_relative_to(folder) for path in (lamp.path, calibration.path, assets.path(lamp.model)))
    assert load_task(assets, "hop").name == "hop"
    build(lamp, calibration, assets)
    (folder / "sim/lamp/lamp.xml").write_text("<mujoco")
    with pytest.raises(FileError, match="not a MuJoCo model"):  # its own model is what is read
        build(lamp, calibration, assets)


def test_an_empty_folder_is_filled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "new", str(tmp_path))
    assert code == 0
    assert f"--lamp {tmp_path}" in out
    assert (tmp_path / "hardware/lamp.toml").is_file()


@pytest.mark.parametrize("kind", ["full", "file", "under a file"])
def test_nothing_is_overwritten(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "mine"
    if kind == "full":
        folder.mkdir()
        (folder / "note").write_text("mine")
    else:
        folder.write_text("mine")
        folder = folder / "deeper" if kind == "under a file" else folder
    code, _, err = run(capsys, "new", str(folder))
    assert code == 2
    assert err.count("\n") == 1
    assert str(folder) in err
    assert len(list(tmp_path.rglob("*"))) == (2 if kind == "full" else 1)
