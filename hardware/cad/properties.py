"""What the solids say of the lamp, as a file: links, servos, parts, stiffness, and the hash of its sources."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import head
import joint
import measures
import stiffness
from assembly import Placed, inertia, printed
from description import BODIES, JOINTS, Shape

SOURCES = (
    "assembly.py", "base.py", "bought.py", "description.py", "gauges.py", "head.py", "joint.py", "links.py",
    "measures.py", "shape.toml", "stiffness.py",
)  # fmt: skip
"""What shapes and masses come from."""

_HEAD = """\
# Written by `make cad`. Metres, kilograms, radians; each link in its own frame (origin in its joint; the base's on the
# floor), inertia about its centre of mass as xx, yy, zz, xy, xz, yz. Stiffness in Nm/rad: nominal, 5 %, 95 %.
"""


def source_hash(folder: Path) -> str:
    """Return the SHA-256 of the files in `SOURCES`.

    Args:
        folder: Where they are.
    """
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update(name.encode() + b"\0" + (folder / name).read_bytes() + b"\0")
    return digest.hexdigest()


def properties(
    shape: Shape, parts: list[Placed], prints: Mapping[str, Mapping[str, float]], gaps: Mapping[str, float], count: int
) -> dict[str, Any]:
    """Return all of it, as tables.

    Args:
        shape: The lamp's measures.
        parts: Its parts.
        prints: Thinnest wall and overhang of each printed part.
        gaps: Smallest gaps between links.
        count: Number of screws.
    """
    arms, foot, shade = shape.arms, shape.foot, shape.shade
    bodies = {}
    for body in BODIES:
        found = inertia(parts, body)
        tensor = found.tensor
        six = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
        bodies[body] = {
            "mass": _round(found.mass), "centre": [_round(v) for v in found.centre],
            "inertia": [_round(v) for v in six],
        }  # fmt: skip
    middle = measures.CASE_MIDDLE
    held = joint.socket_floor(measures.CASE_FAR + measures.CRADLE_GAP)
    x, y = arms["spacing"] / 2e3, joint.TUBE_Y / 1e3
    return {
        "source": {"sha256": source_hash(Path(__file__).parent), "files": list(SOURCES)},
        "lengths": {
            "axis": foot["axis"] / 1e3, "lower_arm": arms["lower"] / 1e3, "upper_arm": arms["upper"] / 1e3,
            "foot_radius": foot["radius"] / 1e3,
        },
        "neutral": dict(shape.neutral),
        "stops": {name: list(shape.stops[name]) for name in JOINTS},
        "bodies": bodies,
        "servos": {
            "ankle": {"body": "lower_arm", "middle": [0.0, 0.0, middle / 1e3]},
            "knee": {"body": "lower_arm", "middle": [0.0, 0.0, _round((arms["lower"] - middle) / 1e3)]},
            "neck": {"body": "upper_arm", "middle": [0.0, 0.0, _round((arms["upper"] - middle) / 1e3)]},
        },
        "tubes": {
            "radius": arms["tube"] / 2e3, "x": x, "y": y,
            "lower_arm": [_round(held / 1e3), _round((arms["lower"] - held) / 1e3)],
            "upper_arm": [
                _round(joint.socket_floor(shape.fork_reach("knee")) / 1e3), _round((arms["upper"] - held) / 1e3)
            ],
        },
        "shade": {
            "start": _round(head.start(shape) / 1e3), "end": shade["end"] / 1e3,
            "mouth_radius": shade["mouth_radius"] / 1e3,
            "bulb_radius": shade["bulb_radius"] / 1e3, "bulb_middle": shade["bulb_middle"] / 1e3,
        },
        "stiffness": {
            **{name: [_round(v, 3) for v in stiffness.total(stiffness.springs(shape, name))] for name in JOINTS},
            "gears": [_round(v, 3) for v in stiffness.total([stiffness.gears()])],
        },
        "checks": {"screws": count, "gaps_mm": {pair: _round(gap, 3) for pair, gap in gaps.items()}},
        "parts": {
            part.name: {
                "count": part.count, "material": part.material, "use": part.use,
                "size_mm": [round(v, 1) for v in tuple(part.solid.bounding_box().size)],
                "volume_cm3": _round(part.solid.volume / 1e3),
                "mass_g": _round(part.solid.volume / 1e3 * _density(shape, part.material)),
                "print_min": round(part.solid.volume / shape.printing["rate"] / 60.0),
                "wall_mm": _round(prints[part.name]["wall"], 3),
                "overhang_mm2": round(prints[part.name]["overhang"]),
            }
            for part in printed(shape)
        },
    }  # fmt: skip


def _density(shape: Shape, material: str) -> float:
    return shape.printing["sole_density" if material == "rubber" else "density"]


def _round(value: float, digits: int = 5) -> float:
    """Round to significant digits, and what is nothing to 0: the kernel's last bits are not the same everywhere."""
    return 0.0 if abs(value) < 1e-9 else float(f"{value:.{digits}g}")


def as_toml(tables: Mapping[str, Any]) -> str:
    """Return tables as TOML.

    Args:
        tables: Tables of values, lists and tables.
    """
    lines = [_HEAD]

    def write(name: str, table: Mapping[str, Any]) -> None:
        values = {key: value for key, value in table.items() if not isinstance(value, Mapping)}
        if values:
            lines.append(f"[{name}]")
            lines.extend(f"{_key(key)} = {_value(value)}" for key, value in values.items())
            lines.append("")
        for key, value in table.items():
            if isinstance(value, Mapping):
                write(f"{name}.{_key(key)}", value)

    for name, table in tables.items():
        write(name, table)
    return "\n".join(lines).rstrip() + "\n"


def as_readme(told: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """Return the page that names every file beside the properties.

    Args:
        told: The properties.
        pictures: Names of pictures, and what they show.
    """
    lines = [
        "# What `make cad` wrote", "",
        "Every part to print, lying as it is printed, as STEP, STL and 3MF; `properties.toml` has masses, inertias,",
        "stiffness and the hash of what it all was made from. Times are estimates: volume by print.rate of shape.toml.",
        "",
        "| part | of it | files | size [mm] | volume [cm³] | mass [g] | time [min] | thinnest wall [mm] | what it is |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]  # fmt: skip
    for name, part in told["parts"].items():
        size = " x ".join(f"{value:g}" for value in part["size_mm"])
        files = ", ".join(f"[{name}.{kind}]({name}.{kind})" for kind in ("step", "stl", "3mf"))
        lines.append(
            f"| {name} | {part['count']} | {files} | {size} | {part['volume_cm3']:.3g} | {part['mass_g']:.3g} | "
            f"{part['print_min']} | {part['wall_mm']:.3g} | {part['use']} |"
        )
    lines += ["", "| picture | what it shows |", "| --- | --- |"]
    lines += [f"| [{name}.png]({name}.png) | {what} |" for name, what in pictures.items()]
    return "\n".join(lines) + "\n"


def _key(key: str) -> str:
    return key if key.replace("_", "").isalnum() else json.dumps(key)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(each) for each in value) + "]"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, np.floating):
        value = float(value)
    return repr(value)
