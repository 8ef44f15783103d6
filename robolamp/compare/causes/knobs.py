"""Knobs: numbers in which a lamp may differ from its twin, how to change a twin by each, and how to name the cause.

Sizes are differences from the calibration, in the unit that `Knob.unit` names; 0 is the calibrated twin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from robolamp.lamp import Lamp
from robolamp.twin.bend import Bend

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """How a changed twin differs from the calibrated one.

    Attributes:
        bend: How its model differs.
        late: How much later than it was sent a goal arrives [s].
        asked: How much later than its stamp an angle is sampled, since the question is held up, too [s].
        resistance: Of the supply [Ohm].
        drain: By how much the supply falls [V/s].
        zero: True angle less the reported one, shape (n,) [rad]; empty: none.
        slope: Of the desk, downhill ahead positive [rad].
        foot_gain: Foot sensor reading, times this.
        foot_offset: Added to each reading [N].
        foot_drift: By how much that grows from the log's begin on [N/s].
    """

    bend: Bend = field(default_factory=Bend)
    late: float = 0.0
    asked: float = 0.0
    resistance: float = 0.0
    drain: float = 0.0
    zero: tuple[float, ...] = ()
    slope: float = 0.0
    foot_gain: float = 1.0
    foot_offset: float = 0.0
    foot_drift: float = 0.0


@dataclass(frozen=True)
class Kind:
    """A kind of difference.

    Attributes:
        unit: Of its size: "1" for a share.
        trials: Sizes that are tried first.
        low: Smallest size that is believed.
        high: Largest.
        worth: Size below which it is not worth a word: about a tenth of what `sim/tasks/spread.toml` calls usual.
        change: Makes the change of a size: (size, joint index, number of joints) -> Change.
        more: Cause, the size positive; `{joint}` and `{size}` are filled in.
        less: Cause, the size negative; of what cannot be less than in the twin, only from one run to another.
        remedy: What settles it.
        each: Whether every joint has one of its own.
        moving: Whether only motion tells it: standing still any size does.
    """

    unit: str
    trials: tuple[float, ...]
    low: float
    high: float
    worth: float
    change: Callable[[float, int, int], Change]
    more: str
    less: str
    remedy: str
    each: bool = False
    moving: bool = False


@dataclass(frozen=True)
class Knob:
    """One thing that may differ: a kind, at a joint where it has one.

    Attributes:
        kind: Name of the kind, a key of KINDS.
        joint: Its joint; empty for the lamp as a whole.
        index: The joint's place; 0 for the lamp as a whole.
        of: Number of joints.
    """

    kind: str
    joint: str
    index: int
    of: int

    @property
    def name(self) -> str:
        """Return "strength knee" or "delay"."""
        return f"{self.kind} {self.joint}".strip()

    @property
    def about(self) -> Kind:
        """The kind."""
        return KINDS[self.kind]

    @property
    def bounds(self) -> tuple[float, float]:
        """The smallest and the largest size that is believed."""
        return self.about.low, self.about.high

    def change(self, size: float) -> Change:
        """Return the change of a size."""
        return self.about.change(size, self.index, self.of)

    def within(self, size: float) -> float:
        """Return the nearest size that is believed."""
        return min(max(size, self.about.low), self.about.high)

    def cause(self, size: float, than: str = "modelled") -> str:
        """Return the cause's name for a difference of this size from the reference.

        Of a size at the end of what is believed only that it is no less is known.
        """
        text = self.about.more if size > 0 else self.about.less
        low, high = (bound - math.copysign(_END * abs(bound), bound) for bound in self.bounds)
        bound = "more than " if size >= high or size <= low < 0.0 else ""
        return text.format(joint=self.joint, size=bound + self.amount(abs(size)), than=than)

    def remedy(self) -> str:
        """Return the remedy."""
        return self.about.remedy.format(joint=self.joint)

    def amount(self, size: float) -> str:
        """Return a size with its unit, as a person reads it."""
        scale, unit, form = _SHOWN[self.about.unit]
        return f"{size * scale:{form}} {unit}"


_END = 1e-3  # share of a bound by which a size at it may be off by rounding

_SHOWN = {
    "1": (100.0, "%", ".0f"),
    "s": (1e3, "ms", ".1f"),
    "rad": (1e3, "mrad", ".1f"),
    "Ohm": (1.0, "Ohm", ".2f"),
    "V": (1.0, "V", ".2f"),
    "V/s": (60.0, "V a minute", ".2f"),
    "N": (1.0, "N", ".2f"),
    "N/s": (60.0, "N a minute", ".2f"),
}


def _one(size: float, joint: int, of: int) -> Array:
    values = np.ones(of)
    values[joint] += size
    return values


def _zero(size: float, joint: int, of: int) -> Change:
    return Change(zero=tuple(size if index == joint else 0.0 for index in range(of)))


SLOW_LINE = "set the USB adapter's latency timer to 1 ms and plug it in without a hub; run nothing else on the computer"
"""What settles a line that holds packets up."""

_RECORD = "`robolamp calibrate record` and `robolamp calibrate lamp`"

# The ends of what is believed: beyond them something else is wrong, and a text says "more than". "Preflight" is what
# refuses to start a lamp, so that no log has more.
KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        # Published torque constants of one model are 0.29 to 0.40 Nm/A (calibration/nominal.toml: 0.37); the rest is
        # for heat, wear and a wrong gear train (XL330-M077: 0.41 of the M288's stall torque, by their e-manuals).
        "strength": Kind(
            "1", (-0.1, 0.1), -0.6, 0.5, 0.01,
            lambda size, joint, of: Change(Bend(strength=_one(size, joint, of))),
            "the {joint}'s motor is {size} stronger than {than}", "the {joint}'s motor is {size} weaker than {than}",
            f"{_RECORD} settle joint.{{joint}}.torque_constant; look for a warm or worn servo", each=True, moving=True,
        ),
        # Published dry friction of one model is 0.005 to 0.013 Nm (nominal.toml: 0.009), i.e. up to 1.4 times; chosen:
        # four times, which takes a rubbing cable or a tight screw.
        "friction": Kind(
            "1", (-0.3, 0.5), -0.9, 3.0, 0.03,
            lambda size, joint, of: Change(Bend(friction=_one(size, joint, of))),
            "the {joint} has {size} more friction than {than}", "the {joint} has {size} less friction than {than}",
            f"{_RECORD} settle the friction of joint.{{joint}}; look for a rubbing cable or a tight screw", each=True,
            moving=True,
        ),
        # Preflight: a joint may stand 0.17 rad outside its limits (safety.preflight_angle of lamp.toml). Standing still
        # stiction bears what the neck weighs at any of these.
        "zero": Kind(
            "rad", (-0.02, 0.02), -0.17, 0.17, 0.003,
            _zero,
            "the {joint} stands {size} further forward than it reports",
            "the {joint} stands {size} further back than it reports",
            "`robolamp setup zero` sets joint.{joint}.zero in hardware/lamp.toml; check that its horn sits firmly",
            each=True, moving=True,
        ),
        # Nothing acts before it is asked: servo and line take 12.5 ms (nominal.toml; published fits: up to 16). Later:
        # the realities' limit of a line.
        "delay": Kind(
            "s", (-0.004, 0.004, 0.015), -0.016, 0.05, 0.0005,
            lambda size, joint, of: Change(late=size),
            "goal angles take effect {size} later than {than}", "goal angles take effect {size} earlier than {than}",
            "`robolamp calibrate record` and `robolamp calibrate lamp` settle the servos' delay; on a slow line, set "
            "the adapter's latency timer to 1 ms", moving=True,
        ),
        # Realities' limit: two and a half ticks; an FTDI adapter's timer is 16 ms.
        "latency": Kind(
            "s", (0.001, 0.003), 0.0, 0.05, 0.0003,
            lambda size, joint, of: Change(late=size, asked=size),
            "the line to the servos delays everything by {size}",
            "the line to the servos delays everything by {size} less than {than}",
            SLOW_LINE,
        ),
        # Preflight: Min and Max Voltage Limit, 3.5 and 7.0 V of an XL330 at 5 V (e-manual).
        "supply": Kind(
            "V", (-0.3, 0.3), -2.0, 2.0, 0.05,
            lambda size, joint, of: Change(Bend(supply=size)),
            "the supply gives {size} more than {than}", "the supply gives {size} less than {than}",
            "measure the supply at the servos; change lamp.supply_voltage in the calibration",
        ),
        # Over 1 Ohm one stalled servo (1.47 A, e-manual) takes 5 V down to the 3.5 V at which servos shut down.
        "resistance": Kind(
            "Ohm", (0.1, 0.3), 0.0, 1.0, 0.01,
            lambda size, joint, of: Change(resistance=size),
            "the supply sags under load, as through {size}", "the supply sags less under load, as through {size} less",
            "use thicker or shorter cables and a supply that holds 5 V at 4 A",
        ),
        # From 5 to 3.5 V in the 7.5 s of a run.
        "drain": Kind(
            "V/s", (0.02, 0.06), 0.0, 0.2, 0.001,
            lambda size, joint, of: Change(drain=size),
            "the supply falls by {size} over time", "the supply falls by {size} less than {than} over time",
            "charge the battery, or use a mains supply",
        ),
        # Preflight: the lamp of 2.3 N may show 0.4 N (contact_on) to 10 N standing.
        "foot gain": Kind(
            "1", (-0.1, 0.1), -0.8, 4.0, 0.01,
            lambda size, joint, of: Change(foot_gain=1.0 + size),
            "the foot sensor reads {size} too much", "the foot sensor reads {size} too little",
            "`robolamp setup foot` with a known weight",
        ),
        # The same.
        "foot offset": Kind(
            "N", (-0.2, 0.2), -1.7, 8.0, 0.01,
            lambda size, joint, of: Change(foot_offset=size),
            "the foot sensor reads {size} too much at any load", "the foot sensor reads {size} too little at any load",
            "`robolamp setup foot` tares it",
        ),
        # Chosen: the lamp's own weight in 10 s; a warming load cell drifts by a hundredth of that.
        "foot drift": Kind(
            "N/s", (-0.05, 0.05), -0.2, 0.2, 0.002,
            lambda size, joint, of: Change(foot_drift=size),
            "the foot sensor's zero rises by {size}", "the foot sensor's zero falls by {size}",
            "let it warm up, keep draughts off, then `robolamp setup foot`",
        ),
        # Rubber on wood: 0.6 to 1.0 (nominal.toml: 0.8); chosen: from ice, 0.08, to sticky, 1.6.
        "floor": Kind(
            "1", (-0.35, -0.15, 0.15, 0.35), -0.9, 1.0, 0.02,
            lambda size, joint, of: Change(Bend(floor_friction=1.0 + size)),
            "the floor grips {size} better than {than}", "the floor is {size} slipperier than {than}",
            "clean foot and desk; `robolamp calibrate record` and `robolamp calibrate lamp` settle lamp.floor_friction",
            moving=True,
        ),
        # Chosen: half of the lamp more is a second shade, and what stands still holds the foot's force against it.
        "mass": Kind(
            "1", (-0.05, 0.05), -0.4, 0.5, 0.005,
            lambda size, joint, of: Change(Bend(mass=1.0 + size)),
            "the lamp is {size} heavier than {than}", "the lamp is {size} lighter than {than}",
            "weigh it; change lamp.mass_scale in the calibration",
        ),
        # Chosen: 6 degrees, down which a lamp that hops walks off the desk.
        "slope": Kind(
            "rad", (-0.01, 0.01), -0.1, 0.1, 0.001,
            lambda size, joint, of: Change(slope=size),
            "the desk slopes down ahead by {size}", "the desk slopes up ahead by {size}",
            "put a spirit level on the desk",
        ),
    }
)  # fmt: skip
"""Every kind of knob."""


def knobs(lamp: Lamp) -> list[Knob]:
    """Return every knob of a lamp."""
    names, n = lamp.names, len(lamp.names)
    return [
        Knob(kind, joint, index, n)
        for kind, about in KINDS.items()
        for index, joint in enumerate(names if about.each else ("",))
    ]
