"""Renders the pictures of the README from the twin: docs/lamp.png, docs/hop.gif, docs/jumper.png, docs/madzia.png."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.figure import load_figure
from robolamp.lamp import load_lamp
from robolamp.twin.figure_model import build_figure
from robolamp.twin.lamp_model import build
from robolamp.twin.pictures.render import Camera, qpos_of

_DOCS = Path(__file__).parent


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
    subprocess.run([sys.executable, "-m", "robolamp", "render", "hop", "-o", str(_DOCS / "hop.gif")], check=True)


if __name__ == "__main__":
    main()
