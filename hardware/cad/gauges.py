"""Gauges for the neutral pose: flat plates that the lamp's links lie against when every joint is at 0.

One stands on the dome, inside the lamp's bend, and sets both arms; the other lies along the upper arm and the shade.
"""

from __future__ import annotations

import numpy as np
from build123d import Part
from numpy.typing import NDArray

import base
import head
import measures
from description import Shape
from joint import TUBE_Y, block, prism_y
from links import link_places

THICKNESS = 3.0
_MARGIN = 1.5  # that an edge stays away from the ends of a tube


def _turn(pitch: float) -> NDArray[np.float64]:
    """Return the matrix that takes a link's x and z to those of the link below."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, s], [-s, c]])


def gauges(shape: Shape) -> dict[str, Part]:
    """Return the gauges where they lie in the neutral pose, in the base's frame.

    Args:
        shape: The lamp's measures.
    """
    neutral, arms = shape.neutral, shape.arms
    lower = _turn(neutral["ankle"])
    upper = lower @ _turn(neutral["knee"])
    top = upper @ _turn(neutral["neck"])
    ankle = np.array([0.0, shape.foot["axis"]])
    knee = ankle + lower @ np.array([0.0, arms["lower"]])
    neck = knee + upper @ np.array([0.0, arms["upper"]])
    held = measures.CASE_FAR + measures.CRADLE_GAP + measures.SOCKET
    elbow = shape.fork_reach("knee") + measures.SOCKET
    side = arms["spacing"] / 2 + arms["tube"] / 2  # of the front tubes

    def on(origin: NDArray[np.float64], turn: NDArray[np.float64], x: float, z: float) -> tuple[float, float]:
        x, z = origin + turn @ np.array([x, z])
        return float(x), float(z)

    low = [on(ankle, lower, side, held + _MARGIN), on(ankle, lower, side, arms["lower"] - held - _MARGIN)]
    high = [on(knee, upper, side, elbow + _MARGIN), on(knee, upper, side, arms["upper"] - held - _MARGIN)]
    low_y, high_y = TUBE_Y - THICKNESS / 2, TUBE_Y + THICKNESS / 2
    roof = base.levels(shape)["roof"]
    middle = 0.5 * shape.foot["radius"]
    # A strip of 22 mm along the upper arm, a leg down to the dome, and a tongue to the lower arm.
    down = upper @ np.array([1.0, 0.0]) * 22.0
    inner = (high[1][0] + down[0], high[1][1] + down[1])
    arms_gauge = [(middle - 12.0, roof), (middle + 12.0, roof), inner, high[1], high[0], low[1], low[0]]

    keys, begin = shape.shade, head.start(shape)
    slope = (keys["mouth_radius"] - keys["neck_radius"]) / (keys["end"] - begin)

    def cone(share: float) -> tuple[float, float]:
        z = begin + share * (keys["end"] - begin)
        radius = keys["neck_radius"] + slope * (z - begin)
        return on(neck, top, float(np.sqrt(radius**2 - low_y**2)), z)

    foot = on(knee, upper, side, arms["upper"] - held - _MARGIN)
    back = on(knee, upper, side, elbow + _MARGIN)
    corner = on(neck, top, keys["neck_radius"] + 14.0, begin - 4.0)
    edge = [cone(share) for share in np.linspace(0.95, 0.15, 9)]
    shade_gauge = [foot, back, (back[0] + down[0], back[1] + down[1]), *edge, corner]
    places = link_places(shape, (0.0, 0.0, 0.0))
    room = Part()  # for what is thicker than the tubes
    wide = measures.CRADLE_HALF_WIDTH + _MARGIN
    for body, begin in (("lower_arm", held), ("upper_arm", elbow)):
        length = arms[body.removesuffix("_arm")]
        for span in ((-wide, begin + _MARGIN), (length - held - _MARGIN, length + wide)):
            room += places[body] * block((-20.0, wide), (low_y - 1.0, high_y + 1.0), span)
    return {
        "gauge_arms": prism_y(arms_gauge, low_y, high_y) - room,
        "gauge_shade": prism_y(shade_gauge, low_y, high_y) - room,
    }
