"""The lamp's MuJoCo model, from what the solids say of it; no kernel needed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

MESHES = {
    "base": ("rubber", "enamel", "board", "steel"),
    "lower_arm": ("servo", "enamel", "steel"),
    "upper_arm": ("servo", "enamel", "steel"),
    "head": ("servo", "enamel", "steel", "shade", "bulb"),
}
"""What of each link is seen as one mesh: its parts of one material, but for shade and bulb, which have their own."""

_HEAD = """\
<mujoco model="lamp">
  <!-- A desk lamp on three XL330-M288-T servos. Written by `make cad` from the solids of its parts: change
       hardware/cad, not this file. README.md in this folder gives every number's source. -->
  <compiler angle="radian" autolimits="true" meshdir="meshes"/>

  <option timestep="0.002" integrator="Euler" cone="elliptic" impratio="10">
    <flag eulerdamp="disable"/>
  </option>

  <default>
    <default class="lamp">
      <joint axis="0 1 0"/>
      <geom mass="0"/>
      <default class="visual">
        <geom type="mesh" group="2" contype="0" conaffinity="0" material="enamel"/>
      </default>
      <default class="collision">
        <!-- Parts of the lamp meet the floor (contype 2 of the floor), not one another. -->
        <geom group="3" contype="1" conaffinity="2" condim="4" friction="0.8 0.003 0.0001" solref="0.006 1"
          rgba="0.2 0.5 0.9 0.4"/>
      </default>
    </default>
  </default>

  <asset>
    <material name="enamel" rgba="0.93 0.90 0.82 1" specular="0.6" shininess="0.6" reflectance="0.02"/>
    <material name="steel" rgba="0.62 0.64 0.67 1" specular="0.8" shininess="0.7"/>
    <material name="servo" rgba="0.13 0.14 0.16 1" specular="0.3" shininess="0.3"/>
    <material name="rubber" rgba="0.16 0.16 0.17 1" specular="0.1" shininess="0.1"/>
    <material name="board" rgba="0.16 0.38 0.27 1" specular="0.2" shininess="0.2"/>
    <material name="bulb" rgba="1.0 0.93 0.70 1" emission="0.9"/>
"""

_TAIL = """\
  </worldbody>

  <actuator>
    <!-- Shipped values of calibration/nominal.toml at Position P Gain 800; the twin writes the calibrated ones over
         them. -->
{motors}
  </actuator>

  <sensor>
    <touch name="foot_force" site="foot"/>
  </sensor>

  <keyframe>
    <key name="home" qpos="0 0 0 1 0 0 0 0 0 0" ctrl="0 0 0"/>
  </keyframe>
</mujoco>
"""

_MOTOR = """\
    <dcmotor name="{0}" joint="{0}" input="pos" motorconst="0.37 0.37" resistance="3.4" armature="0.0018"
      damping="0.0045" controller="1.2525 0 0.040265 0 0 5" nsample="20" interp="linear" delay="0.0085"/>"""

FOOT_HEIGHT = 0.008
"""Of the cylinder that stands on the floor [m]: sole, plate, sensors and disc."""

ARM_RADIUS = 0.012
"""Of the capsules round the arms [m]: tubes, cradles and servos in the plane of motion."""

_ARM_START = 0.020  # of the lower arm's capsule above the ankle's axis, where dome and fork end [m]
_SHADE_INSET = 0.002  # of the head's cylinder, from the shade's mouth inwards [m]
_HEAD_SITE = 0.022  # what a controller knows as the head's place: so far behind the shade's mouth [m]
_TOUCH_MARGIN, _TOUCH_HALF, _TOUCH_MIDDLE = 0.005, 0.012, 0.002  # the touch sensor's cylinder round the foot [m]


def as_mjcf(told: Mapping[str, Any]) -> str:
    """Return the model as MJCF; the meshes that it names are beside it, in meshes/.

    The model is the same on its left and its right: where horns, idlers and screws bring a centre of mass sideways
    (0.3 mm at most), cables do so as much, and nobody knows which way.

    Args:
        told: The tables of properties.toml.
    """
    lengths, shade = told["lengths"], told["shade"]
    lines = [_HEAD.rstrip("\n")]
    lines += [f'    <mesh name="{name}" file="{name}.stl" inertia="shell"/>' for name in mesh_names()]
    lines += ["  </asset>", "", "  <worldbody>"]
    below = {"lower_arm": lengths["axis"], "upper_arm": lengths["lower_arm"], "head": lengths["upper_arm"]}
    half = round((shade["end"] - shade["start"]) / 2 - 0.001, 3)
    radius = shade["mouth_radius"] - _SHADE_INSET
    foot, sole = lengths["foot_radius"], FOOT_HEIGHT / 2
    own = {
        "base": [
            '<site name="base" pos="0 0 0"/>',
            f'<geom name="foot" class="collision" type="cylinder" size="{foot:g} {sole:g}" pos="0 0 {sole:g}"/>',
            f'<site name="foot" type="cylinder" size="{foot + _TOUCH_MARGIN:g} {_TOUCH_HALF:g}" '
            f'pos="0 0 {_TOUCH_MIDDLE:g}" group="4"/>',
        ],
        "lower_arm": [_capsule("lower_arm", _ARM_START, lengths["lower_arm"])],
        "upper_arm": [_capsule("upper_arm", 0.0, lengths["upper_arm"])],
        "head": [
            f'<site name="head" pos="0 0 {shade["end"] - _HEAD_SITE:g}"/>',
            f'<geom name="head" class="collision" type="cylinder" size="{radius:g} {half:g}" '
            f'pos="0 0 {shade["end"] - half:g}"/>',
        ],
    }
    joints = dict(zip(below, told["stops"], strict=True))
    for depth, body in enumerate(MESHES):
        indent = "  " * (depth + 2)
        if body == "base":
            lines += [f'{indent}<body name="base" childclass="lamp">', f'{indent}  <freejoint name="root"/>']
        else:
            joint = joints[body]
            low, high = told["stops"][joint]
            lines += [
                "",
                f'{indent}<body name="{body}" pos="0 0 {below[body]:g}" euler="0 {told["neutral"][joint]:g} 0">',
                f'{indent}  <joint name="{joint}" range="{low:g} {high:g}"/>',
            ]
        mass, (x, _, z) = told["bodies"][body]["mass"], told["bodies"][body]["centre"]
        xx, yy, zz, _, xz, _ = told["bodies"][body]["inertia"]
        lines.append(
            f'{indent}  <inertial mass="{mass:g}" pos="{_numbers([x, 0.0, z])}"\n'
            f'{indent}    fullinertia="{_numbers([xx, yy, zz, 0.0, xz, 0.0])}"/>'
        )
        lines += [f"{indent}  {each}" for each in own[body]]
        for name, material in zip(_names(body), MESHES[body], strict=True):
            shown = "" if material in ("enamel", "shade") else f' material="{material}"'
            lines.append(f'{indent}  <geom name="{name}" class="visual" mesh="{name}"{shown}/>')
    lines += ["  " * depth + "</body>" for depth in range(len(MESHES) + 1, 1, -1)]
    return "\n".join(lines) + "\n" + _TAIL.format(motors="\n".join(_MOTOR.format(joint) for joint in told["stops"]))


def mesh_names() -> list[str]:
    """Return the names of the meshes; each is a file."""
    return [name for body in MESHES for name in _names(body)]


def mesh_name(body: str, part: str, color: str) -> str:
    """Return the mesh that shows a part.

    Args:
        body: Its link.
        part: What it is.
        color: Its material in pictures.
    """
    kind = "bulb" if color == "bulb" else part if part in MESHES[body] else color
    if kind == "board" and kind not in MESHES[body]:  # idlers, of another colour than horns in the build guide
        kind = "servo"
    if kind == "servo" and kind not in MESHES[body]:  # the ankle's horn
        kind = "board"
    return _names(body)[MESHES[body].index(kind)]


def _names(body: str) -> list[str]:
    return [kind if kind in ("shade", "bulb") else f"{body}_{kind}" for kind in MESHES[body]]


def _capsule(name: str, start: float, end: float) -> str:
    return (
        f'<geom name="{name}" class="collision" type="capsule" size="{ARM_RADIUS:g}" '
        f'fromto="0 0 {start:g} 0 0 {end:g}"/>'
    )


def _numbers(values: list[float]) -> str:
    return " ".join(f"{value:g}" for value in values)
