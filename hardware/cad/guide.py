"""Which pictures the build guide has."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from build123d import Location, Pos

import gauges
from assembly import Placed
from checks import mesh
from description import BODIES, Shape
from exports import placed_mesh
from links import link_places
from pictures import Shown, render

_NAMES = {
    "sole": "sole", "plate": "plate", "FSR 402": "FSR 402 (3)", "pad": "pad (3)", "frame": "frame", "Pico": "Pico",
    "dome": "dome", "cradle": "cradle", "XL330-M288-T": "XL330", "tube": "tube", "elbow": "elbow", "neck": "neck",
    "shade": "shade", "stem": "stem", "LED ball": "bulb", "horn": "horn", "idler": "idler", "screw M2 x 6": "M2 x 6",
    "screw M2 x 8": "M2 x 8",
}  # fmt: skip


PICTURES = {
    "lamp": "the lamp in its neutral pose",
    "exploded": "the whole lamp, taken apart",
    "base": "plate, sensors, frame, Pico (step 1)",
    "dome": "the dome over them (step 2)",
    "lower_arm": "the lower arm with its two servos (step 3)",
    "upper_arm": "the upper arm with its servo (step 4)",
    "head": "neck, shade, stem and bulb (steps 5 and 9)",
    "ankle": "screws of the ankle's horn and idler (step 6)",
    "knee": "the same at the knee (step 7)",
    "neck": "the same at the neck (step 8)",
    "neutral": "both gauges at the lamp in its neutral pose",
}
"""Every picture, and what it shows."""


def write_pictures(shape: Shape, parts: Sequence[Placed], folder: Path, say: Callable[[str], None]) -> None:
    """Render every picture of the build guide.

    Args:
        shape: The lamp's measures.
        parts: The lamp's parts.
        folder: Where the PNG files go.
        say: Takes a line that says what is being done.
    """
    seen = [part for part in parts if not part.ghost]
    neutral = link_places(shape, (0.0, 0.0, 0.0))

    def whole(of: Sequence[Placed]) -> list[Shown]:
        return [Shown(placed_mesh(part, neutral[part.body]), part.color) for part in of]

    def apart(of: Sequence[Placed], upright: bool = True, factor: float = 1.0) -> list[Shown]:
        """Parts of one link pulled apart along its own axes, each kind labelled once."""
        shown, told = [], set()
        for part in of:
            place = Location() if upright else neutral[part.body]
            moved = place * Pos(*(factor * value for value in part.explode))
            label = "" if part.part in told else _NAMES[part.part]
            told.add(part.part)
            shown.append(Shown(placed_mesh(part, moved), part.color, label))
        return shown

    def step(*numbers: int, body: str) -> list[Placed]:
        return [part for part in seen if part.step in numbers and part.body == body]

    def save(name: str, shown: Sequence[Shown], azimuth: float, elevation: float, zoom: float = 1.0) -> None:
        say(f"picture {name}")
        render(shown, folder / f"{name}.png", azimuth, elevation, zoom)

    save("lamp", whole(seen), 125.0, -14.0)
    save("exploded", _exploded(seen, neutral), 115.0, -12.0)
    save("base", apart(step(0, body="base")), 125.0, -24.0)
    save("dome", apart(step(0, 1, body="base"), factor=0.5), 215.0, -30.0)
    save("lower_arm", apart(step(2, body="lower_arm")), 125.0, -14.0)
    save("upper_arm", apart(step(3, body="upper_arm")), 125.0, -14.0)
    save("head", apart(step(4, 8, body="head")), 125.0, -14.0)
    for name, number in (("ankle", 5), ("knee", 6), ("neck", 7)):
        link = BODIES[number - 5 : number - 3]
        near = [part for part in seen if part.body in link and part.step < number and not part.part.startswith("screw")]
        shown = [Shown(placed_mesh(part, neutral[part.body]), part.color) for part in near]
        labels = {"screw": "M2 x 6, 4 at the horn and 2 at the idler", "idler": "idler", "horn": "horn"}
        for part in (part for part in seen if part.step == number):
            out = tuple(float(1.6 * value) for value in part.explode)
            kind = part.part.split()[0]
            shown.append(Shown(placed_mesh(part, neutral[part.body] * Pos(*out)), part.color, labels.pop(kind, "")))
        save(name, shown, 130.0, -16.0)
    held = [Shown(mesh(gauge, 0.1, 0.4), "ghost", name) for name, gauge in gauges.gauges(shape).items()]
    save("neutral", [*whole(seen), *held], 68.0, -8.0)


def _exploded(seen: Sequence[Placed], neutral: dict[str, Location]) -> list[Shown]:
    """The whole lamp, its links apart along the way from foot to head, their parts half apart."""
    away = {"base": (0, 0, 0), "lower_arm": (-30, 0, 70), "upper_arm": (-10, 0, 170), "head": (60, 0, 230)}
    labels = {"frame", "cradle", "XL330-M288-T", "elbow", "neck", "shade", "LED ball", "dome", "plate", "sole", "stem"}
    shown, told = [], set()
    for part in seen:
        place = Pos(*away[part.body]) * neutral[part.body] * Pos(*(0.55 * value for value in part.explode))
        label = _NAMES[part.part] if part.part in labels - told else ""
        told.add(part.part)
        shown.append(Shown(placed_mesh(part, place), part.color, label))
    return shown
