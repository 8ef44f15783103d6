"""Builds the lamp's parts from shape.toml, checks them, and writes files to print, pictures, properties and model.

    python hardware/cad/build.py            # what `make cad` does
    python hardware/cad/build.py --check    # builds and checks, and compares with the files that are there

It works on the lamp that its folder belongs to: in a folder of your own (`robolamp new mylamp`) on that one. There it
writes hardware/cad/exported, sim/lamp/lamp.xml and sim/lamp/meshes, and lowers limits of hardware/lamp.toml that a stop
would meet. Either everything is written or nothing is. Exit code 2: what shape.toml describes cannot be built, and one
line says why.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
LAMP = HERE.parents[1]
sys.path.insert(0, str(HERE))
sys.dont_write_bytecode = True  # this folder is data, and is shipped as it is

_LOWERED = 0.2  # rad: the most by which the knee's stop comes down; arms of 90 mm take 0.15


def main(words: list[str] | None = None) -> int:
    """Build the lamp.

    Args:
        words: Command line; None: the process's own.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; compare with the files that are there")
    parser.add_argument("--no-pictures", action="store_true", help="leave the pictures as they are")
    asked = parser.parse_args(words)
    from description import ShapeError, read_shape

    try:
        shape = read_shape(HERE / "shape.toml")  # before the kernel, which takes seconds to load
        try:
            import build123d  # noqa: F401
        except ModuleNotFoundError:
            raise ShapeError("build123d is not installed; expected: pip install 'robolamp[cad]' (1 GB)") from None
        from checks import Unbuildable
    except ShapeError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        return _build(shape, check=asked.check, pictures=not (asked.no_pictures or asked.check))
    except (ShapeError, Unbuildable) as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{error.filename}: {error.strerror}; expected a folder as of `robolamp new`", file=sys.stderr)
        return 2


def _say(line: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {line}", flush=True)


def _build(shape: Any, *, check: bool, pictures: bool) -> int:
    import assembly
    import checks
    import exports
    import guide
    import limits
    import model
    import properties

    begun = time.monotonic()
    checks.check_masses(shape)
    shape, gaps = _fitted(shape)
    lamp = LAMP / "hardware/lamp.toml"
    description = limits.fitted(lamp, shape.stops)
    parts = assembly.placed(shape)
    _say("parts of a link apart")
    checks.check_links(shape)
    checks.check_gauges(shape)
    _say("parts on their way into place")
    checks.check_insertion(shape)
    _say("screws within reach")
    count = checks.check_screws(shape)
    _say("walls and bed")
    prints = checks.check_prints(shape)
    told = properties.properties(shape, parts, prints, gaps, count)
    if check:
        return _compare(told)
    with tempfile.TemporaryDirectory(dir=HERE) as name:
        folder = Path(name)
        new, meshes = folder / "exported", folder / "meshes"
        new.mkdir()
        meshes.mkdir()
        for part in assembly.printed(shape):
            exports.write_part(part, new)
        exports.write_meshes(parts, meshes)
        (new / "properties.toml").write_text(properties.as_toml(told), encoding="utf-8")
        (new / "README.md").write_text(properties.as_readme(told, guide.PICTURES), encoding="utf-8")
        (folder / "lamp.xml").write_text(model.as_mjcf(told), encoding="utf-8")
        (folder / "lamp.toml").write_text(description, encoding="utf-8")
        old = HERE / "exported"
        if pictures:
            guide.write_pictures(shape, parts, new, _say)
        elif old.is_dir():
            for picture in old.glob("*.png"):
                shutil.copyfile(picture, new / picture.name)
        if description != lamp.read_text(encoding="utf-8"):
            _say(f"{lamp}: limits and rests come inside the stops")
        _replace(
            {
                new: old,
                meshes: LAMP / "sim/lamp/meshes",
                folder / "lamp.xml": LAMP / "sim/lamp/lamp.xml",
                folder / "lamp.toml": lamp,
            }
        )
    mass = sum(body["mass"] for body in told["bodies"].values())
    minutes = sum(part["print_min"] * part["count"] for part in told["parts"].values())
    _say(
        f"{len(told['parts'])} parts to print, {minutes / 60:.1f} h, {1000 * mass:.0f} g with everything; "
        f"{time.monotonic() - begun:.0f} s"
    )
    return 0


def _fitted(shape: Any) -> tuple[Any, dict[str, float]]:
    """Return the shape with the knee's upper stop where no link meets another, and the smallest gaps.

    Shorter arms bring the head down into the base before the knee is bent as far as shape.toml allows: then the stop
    comes sooner, by `_LOWERED` at most, and this says so.
    """
    import checks

    asked = shape.stops["knee"][1]
    while True:
        _say(f"links apart in every pose, knee to {shape.stops['knee'][1]:+.2f} rad")
        try:
            return shape, checks.check_poses(shape)
        except checks.LinksMeet as error:
            low, high = shape.stops["knee"]
            if not error.far or high - 0.05 < asked - _LOWERED - 1e-9:
                raise
            shape = dataclasses.replace(shape, stops={**shape.stops, "knee": (low, round(high - 0.05, 3))})
            _say(f"{error}: the knee's upper stop comes down from {asked:g} rad")


def _replace(found: dict[Path, Path]) -> None:
    """Put what was written in the place of what was there, or nothing of it."""
    begun: list[tuple[Path, Path, Path]] = []
    try:
        for new, old in found.items():
            old.parent.mkdir(parents=True, exist_ok=True)
            aside = new.with_name(f"{new.name}-before")
            begun.append((new, old, aside))
            if old.exists():
                old.rename(aside)
            new.rename(old)
    except OSError:
        for new, old, aside in reversed(begun):
            if not new.exists():
                old.rename(new)
            if aside.exists():
                aside.rename(old)
        raise


def _compare(told: dict[str, Any]) -> int:
    """Say where the committed properties differ from what the solids say now."""
    from checks import differences

    file = HERE / "exported" / "properties.toml"
    found = differences(tomllib.loads(file.read_text(encoding="utf-8")), told)
    for line in found:
        print(f"{file}: {line}")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
