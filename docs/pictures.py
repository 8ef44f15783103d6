"""Renders the pictures of README and docs from the twin: lamp.png, hop.gif, jumper.png, madzia.png, gestures.png."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.figure import load_figure
from robolamp.lamp import load_lamp
from robolamp.pose.gesture_file import all_gestures
from robolamp.twin.figure_model import build_figure
from robolamp.twin.lamp_model import build
from robolamp.twin.pictures.render import Camera, qpos_of

_DOCS = Path(__file__).parent
_NAMES = 90  # width of the column with the gestures' names [px]
_COLOURS = 64  # of their sheet: a third of the size in true colours, and nobody sees it


def main() -> None:
    """Render them."""
    assets = Assets()
    lamp = load_lamp(assets)
    twin = build(lamp, load_calibration(assets), assets)
    with Camera(twin, 960, 540) as camera:
        picture = camera.shoot(qpos_of(twin, (0.0, 0.0, 0.0), np.zeros(len(lamp.joints))), "portrait")
    Image.fromarray(picture).save(_DOCS / "lamp.png", optimize=True)
    for name, file in (("jumper", "jumper.png"), ("spider", "madzia.png")):
        figure = build_figure(load_figure(assets, name), assets)
        data = mujoco.MjData(figure.model)
        mujoco.mj_resetDataKeyframe(figure.model, data, 0)
        if figure.goal is not None:
            data.qpos[figure.goal] = 0.45  # near enough to be seen
        with Camera(figure, 960, 540) as camera:
            Image.fromarray(camera.shoot(data.qpos, "portrait")).save(_DOCS / file, optimize=True)
    _render("hop", _DOCS / "hop.gif")
    with tempfile.TemporaryDirectory() as folder:
        strips = {}
        for path in all_gestures(assets):
            strip = Path(folder) / f"{path.stem}.png"
            _render(path.stem, strip)
            with Image.open(strip) as picture:
                strips[path.stem] = picture.reduce(2)
    _sheet(strips).quantize(_COLOURS).save(_DOCS / "gestures.png", optimize=True)


def _render(name: str, to: Path) -> None:
    subprocess.run([sys.executable, "-m", "robolamp", "render", name, "-o", str(to)], check=True)


def _sheet(strips: dict[str, Image.Image]) -> Image.Image:
    """Return the strips one below the other, each with its name."""
    width, height = max(strip.width for strip in strips.values()), next(iter(strips.values())).height
    sheet = Image.new("RGB", (_NAMES + width, height * len(strips)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for row, (name, strip) in enumerate(strips.items()):
        sheet.paste(strip, (_NAMES, row * height))
        draw.text((4, row * height + height / 2), name, fill="black", font=font, anchor="lm")
    return sheet


if __name__ == "__main__":
    main()
