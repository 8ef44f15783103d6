"""`robolamp new`: makes a folder for your own lamp."""

from __future__ import annotations

import secrets
import shutil
from pathlib import Path
from typing import Annotated, Literal

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

{about}

1. Your servos' ids, signs, zeros and limits, and your ports: `robolamp setup scan`, then `assign`, `zero`, `foot`, each
   with `--lamp {name}`; they write hardware/lamp.toml.
2. `robolamp setup check --lamp {name}`: what is still in the way of a run.
{steps}
"""

_PRINTED = """\
Parts of other lengths: change `hardware/cad/shape.toml`, then `python {name}/hardware/cad/build.py` writes the parts to
print, sim/lamp/lamp.xml, and limits that the stops ask for (it needs `pip install 'robolamp[cad]'`)."""
_PRINTED_STEPS = """\
3. `robolamp dry-run hop --goal 0.3 --lamp {name}`: the same on the emulated lamp; nothing moves on the desk.
4. `robolamp deploy hop --goal 0.3 --lamp {name} --stage shadow`, then `gentle`, then `full`."""

_OTHER = """\
Joints from the foot up: yaw, ankle, knee, roll, neck. Where yours are fewer, other ones, or have other servos: change
the [[joint]] tables of hardware/lamp.toml and, alike, the joints and actuators of sim/lamp/lamp.xml. Each servo's
numbers are in calibration/nominal.toml. Controllers have one expression for each joint: delete that of a joint that you
take out, from both files in sim/lamp/controllers, and write one for each that you add. Poses of gestures and realities
name joints, too, but need not name all.

What works on such a lamp: setup, emulate, dry-run, deploy, monitor, evolve, score, explain, render, replay and compare;
gestures and realities that name joints of its own; calibrate, where its servos carry the hops that it records (those of
the emulated `worn` do not: a guard ends the one of 30 cm). What does not: robolamp's own controllers, which drive three
joints (`cycle` here drives five, and `robolamp evolve hop --lamp {name} -o run` begins with it); its odometer
(`robolamp odometer fit cycle --lamp {name} -o FILE` learns one; name the file in hardware/lamp.toml); sequences that
hop by `hop`. There are no parts to print."""
_OTHER_STEPS = """\
3. `robolamp gesture play shake --lamp {name}` plays a gesture on the emulated lamp; nothing moves on the desk.
4. `robolamp gesture play shake --lamp {name} --port PORT --stage shadow`, then `gentle`, then `full`.
5. `robolamp dry-run cycle --goal 0.2 --reality none --lamp {name}` hops as well as its twin. A lamp with weaker servos
   rocks instead: evolve it."""


_CAD = Path("hardware/cad")
_THREE = 3  # joints of the lamp that can be printed
_OF_FIVE = {
    "hardware/lamp.toml": "sim/five/lamp.toml",
    "sim/lamp/lamp.xml": "sim/five/lamp.xml",
    "calibration/nominal.toml": "sim/five/nominal.toml",
    "sim/lamp/controllers/cycle.toml": "sim/five/cycle.toml",
    "sim/lamp/controllers/hop-counting.toml": "sim/five/cycle.toml",  # what calibration hops by
    "sim/lamp/gestures/shake.toml": "sim/five/shake.toml",
}
"""What a lamp of five joints has in other files, and where these are."""


def _files(assets: Assets, joints: int) -> dict[str, str]:
    """What a new folder holds, and what to change there; empty: nothing, others are built with it."""
    scene = load_lamp(assets).model
    model = Path(scene).with_name("lamp.xml")
    parts: dict[str, str] = {}
    if joints == _THREE:
        shape = assets.path(str(_CAD / "shape.toml"))
        meshes = sorted((assets.path(str(model)).parent / "meshes").glob("*.stl"))
        parts = {
            str(_CAD / shape.name): "lengths of arms, foot, shade: what its printed parts and its model are built from",
            **{str(_CAD / path.name): "" for path in sorted(shape.parent.glob("*.py"))},
            **{str(model.parent / "meshes" / path.name): "" for path in meshes},
        }
    return {
        "hardware/lamp.toml": "servos, signs, zeros, limits, ports, foot sensor",
        scene: "what stands on the desk",
        str(model): "the lamp's links: lengths, masses, shapes",
        **parts,
        **(
            {}
            if joints == _THREE
            else {
                "sim/lamp/controllers/cycle.toml": "a hop written by hand",
                "sim/lamp/controllers/hop-counting.toml": "the same, by which `robolamp calibrate` hops",
            }
        ),
        **{str(path.relative_to(path.parents[3])): "" for path in all_gestures(assets)},
        **({} if joints == _THREE else {"sim/lamp/gestures/shake.toml": ""}),
        "calibration/nominal.toml": "the twin's numbers, as long as nothing is measured",
        "sim/tasks/hop.toml": "what to evolve",
    }


def new(
    directory: Path,
    *,
    joints: Literal[3, 5] = 3,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Make a folder for your own lamp: copies of description, model, calibration and a task for you to change.

    Give the folder to any other verb as --lamp DIRECTORY. A file that is not in
    it is taken from robolamp's own files.

    Args:
        directory: The folder to make; must not exist yet, or be empty.
        joints: How many joints the lamp to begin with has: 3, robolamp's own, with parts to print; or 5, on a turntable
            and with a head that rolls, from which lamps with other joints or servos are made.
        as_json: Print one JSON object.
    """
    assets = Assets()
    try:
        if directory.is_dir() and any(directory.iterdir()):
            raise FileError("is not empty; expected a folder that does not exist yet, or an empty one", str(directory))
        if directory.exists() and not directory.is_dir():
            raise FileError("is a file; expected a folder that does not exist yet", str(directory))
        files = _files(assets, joints)
        directory.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot be made: {error.strerror}", str(directory)) from None
    sources = {} if joints == _THREE else _OF_FIVE
    about, steps = (_PRINTED, _PRINTED_STEPS) if joints == _THREE else (_OTHER, _OTHER_STEPS)
    beside = directory.parent / f".robolamp-{secrets.token_hex(6)}"  # whole or not at all: renamed when it is done
    try:
        beside.mkdir()
        for relative in files:
            (beside / relative).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(assets.path(sources.get(relative, relative)), beside / relative)
        rows = "\n".join(f"| `{relative}` | {what} |" for relative, what in files.items() if what)
        name = directory.name
        parts = {"about": about.format(name=name), "steps": steps.format(name=name)}
        text = _README.format(name=name, rows=rows, **parts)
        (beside / "README.md").write_text(text, encoding="utf-8")
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
