"""`robolamp new`: makes a folder for your own lamp."""

from __future__ import annotations

import secrets
import shutil
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.cli.screen.output import print_json
from robolamp.errors import FileError
from robolamp.lamp import load_lamp
from robolamp.pose.gesture_file import all_gestures

_README = """\
# A lamp of my own

Give this folder to any verb as `--lamp {name}`. A file that is not here is taken from robolamp's own: delete what you
do not change, and it follows robolamp.

| file | what to change there |
| --- | --- |
{rows}

The gestures in sim/lamp/gestures are there to be changed, too, and yours go beside them: `robolamp gesture list --lamp
{name}` lists them all.

Parts of other lengths: change `hardware/cad/shape.toml`, then `python {name}/hardware/cad/build.py` writes the parts to
print, sim/lamp/lamp.xml, and limits that the stops ask for (it needs `pip install 'robolamp[cad]'`).

1. Your servos' ids, signs, zeros and limits, and your ports: `robolamp setup scan`, then `assign`, `zero`, `foot`, each
   with `--lamp {name}`; they write hardware/lamp.toml.
2. `robolamp setup check --lamp {name}`: what is still in the way of a run.
3. `robolamp dry-run hop --lamp {name}`: the same on the emulated lamp; nothing moves on the desk.
4. `robolamp deploy hop --lamp {name} --stage shadow`, then `gentle`, then `full`.
"""


_CAD = Path("hardware/cad")


def _files(assets: Assets) -> dict[str, str]:
    """What a new folder holds, and what to change there; empty: nothing, others are built with it."""
    scene = load_lamp(assets).model
    cad = {str(_CAD / path.name): "" for path in sorted(assets.path(str(_CAD / "shape.toml")).parent.glob("*.py"))}
    model = Path(scene).with_name("lamp.xml")
    meshes = sorted((assets.path(str(model)).parent / "meshes").glob("*.stl"))
    return {
        "hardware/lamp.toml": "servos, signs, zeros, limits, ports, foot sensor",
        str(_CAD / "shape.toml"): "lengths of arms, foot, shade: what its printed parts and its model are built from",
        **cad,
        scene: "what stands on the desk",
        str(model): "the lamp's links: lengths, masses, shapes",
        **{str(model.parent / "meshes" / path.name): "" for path in meshes},
        **{str(path.relative_to(path.parents[3])): "" for path in all_gestures(assets)},
        "calibration/nominal.toml": "the twin's numbers, as long as nothing is measured",
        "sim/tasks/hop.toml": "what to evolve",
    }


def new(
    directory: Path,
    *,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Make a folder for your own lamp: copies of description, model, calibration and a task for you to change.

    Give the folder to any other verb as --lamp DIRECTORY. A file that is not in
    it is taken from robolamp's own files.

    Args:
        directory: The folder to make; must not exist yet, or be empty.
        as_json: Print one JSON object.
    """
    assets = Assets()
    try:
        if directory.is_dir() and any(directory.iterdir()):
            raise FileError("is not empty; expected a folder that does not exist yet, or an empty one", str(directory))
        if directory.exists() and not directory.is_dir():
            raise FileError("is a file; expected a folder that does not exist yet", str(directory))
        files = _files(assets)
        directory.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot be made: {error.strerror}", str(directory)) from None
    beside = directory.parent / f".robolamp-{secrets.token_hex(6)}"  # whole or not at all: renamed when it is done
    try:
        beside.mkdir()
        for relative in files:
            (beside / relative).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(assets.path(relative), beside / relative)
        rows = "\n".join(f"| `{relative}` | {what} |" for relative, what in files.items() if what)
        (beside / "README.md").write_text(_README.format(name=directory.name, rows=rows), encoding="utf-8")
        beside.rename(directory)
    except OSError as error:
        raise FileError(f"cannot be made: {error.strerror}", str(directory)) from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    if as_json:
        print_json({"directory": str(directory), "files": [*files, "README.md"]})
    else:
        changed = sum(1 for what in files.values() if what)
        print(f"{directory}: {changed} files to change, and README.md, which says what is where")
        print(f"next: robolamp setup scan --lamp {directory}")
    return 0
