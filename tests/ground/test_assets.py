from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from robolamp import assets
from robolamp.assets import Assets
from robolamp.errors import FileError


def own(folder: Path) -> Assets:
    (folder / "calibration").mkdir()
    (folder / "calibration" / "mine.toml").write_text("")
    (folder / "calibration" / "nominal.toml").write_text("")
    return Assets.of(folder)


def test_ones_own_files_come_before_the_shipped_ones(tmp_path: Path) -> None:
    mine = own(tmp_path)
    assert mine.path("calibration/nominal.toml") == tmp_path / "calibration" / "nominal.toml"
    assert mine.named("mine", "calibration", "calibration") == tmp_path / "calibration" / "mine.toml"
    assert mine.named("nominal.toml", "calibration", "calibration") == tmp_path / "calibration" / "nominal.toml"
    assert mine.path("hardware/lamp.toml") == Assets().path("hardware/lamp.toml")


def test_a_path_is_taken_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text("")
    assert Assets().named(path, "calibration", "calibration") == path


@pytest.mark.parametrize("name", ["nowhere", "a/nominal", "nominal.txt", "", ".", "x" * 5000])
def test_an_unknown_name_is_refused(name: str) -> None:
    with pytest.raises(FileError) as caught:
        Assets().named(name, "calibration", "calibration")
    assert "\n" not in str(caught.value)
    if len(name) < 100:
        assert "no such calibration; give a file, or one of: bending, nominal" in str(caught.value)


def test_missing_folders_and_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="none: is not a folder; `--lamp` expects one"):
        Assets.of(tmp_path / "none")
    with pytest.raises(FileError, match=r"sim/lamp/lamp\.obj not found"):
        Assets.of(tmp_path).path("sim/lamp/lamp.obj")
    assert Assets.of(None) == Assets()


def test_a_folder_in_a_files_place_is_refused_not_passed_over(tmp_path: Path) -> None:
    (tmp_path / "calibration" / "nominal.toml").mkdir(parents=True)
    mine = Assets.of(tmp_path)
    with pytest.raises(FileError, match=r"nominal\.toml: is a folder; expected a file"):
        mine.path("calibration/nominal.toml")
    with pytest.raises(FileError, match=r"nominal\.toml: is a folder; expected a file"):
        mine.named("nominal", "calibration", "calibration")


def test_a_folder_whose_name_is_too_long(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="File name too long"):
        Assets.of(tmp_path / ("x" * 300))


def test_what_is_of_another_kind_is_not_a_name(tmp_path: Path) -> None:
    mine = own(tmp_path)
    known = "bending, nominal, xl330-m288-bench"
    with pytest.raises(FileError, match=rf"mine: no such calibration; give a file, or one of: {known}$"):
        mine.named("mine", "calibration", "calibration", exclude=("mine",))


def test_a_wheel_keeps_its_data_inside_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "site-packages" / "robolamp"
    package.mkdir(parents=True)
    monkeypatch.setattr(assets, "_PACKAGE", package)
    assert assets.shipped() == package / "_assets"


@pytest.mark.parametrize("name", ["limbo-22.5cm", "limbo-22.5cm.toml"])
def test_a_name_may_have_points(name: str) -> None:
    assert Assets().named(name, "sim/lamp/controllers", "controller").name == "limbo-22.5cm.toml"


@pytest.mark.parametrize(
    ("folder", "kind"),
    [
        ("calibration", "calibration"), ("sim/lamp/realities", "reality"), ("sim/tasks", "task"),
        ("calibration/tolerances", "tolerances file"), ("sim/lamp/controllers", "controller"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("file", ["v1.2.toml", "V1.2.TOML"])
def test_ones_own_names_may_have_points_and_capitals(tmp_path: Path, folder: str, kind: str, file: str) -> None:
    (tmp_path / folder).mkdir(parents=True)
    (tmp_path / folder / file).write_text("")
    name = file.rpartition(".")[0]
    assert Assets.of(tmp_path).named(name, folder, kind) == tmp_path / folder / file
    with pytest.raises(FileError, match=f"one of: .*{re.escape(name)}"):
        Assets.of(tmp_path).named("nowhere", folder, kind)


def test_a_pipe_in_a_files_place_is_refused_and_does_not_hide_the_others(tmp_path: Path) -> None:
    mine = own(tmp_path)
    os.mkfifo(tmp_path / "calibration" / "odd.toml")
    assert mine.named("mine", "calibration", "calibration") == tmp_path / "calibration" / "mine.toml"
    with pytest.raises(FileError, match=r"odd\.toml: is a named pipe; expected a file"):
        mine.named("odd", "calibration", "calibration")
