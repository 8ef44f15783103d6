"""The stages of a deployment: watch, move carefully, move; each wants the log of the one before."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from robolamp.errors import SafetyError
from robolamp.lamp import Lamp, same_lamp
from robolamp.log.reader import read_run


@dataclass(frozen=True)
class Stage:
    """How far a run may go.

    Attributes:
        name: Its name.
        before: The stage whose log it wants; empty: none.
        powered: Whether torque goes on at all.
        duty: The most of the supply that the motors get (Goal PWM(100)). In position mode this limits torque; Current
            Limit(38) does not act there.
        slew: Share of the joints' slew limits that goals may use.
    """

    name: str
    before: str
    powered: bool
    duty: float
    slew: float

    def lamp(self, lamp: Lamp) -> Lamp:
        """Return the lamp with this stage's slew limits."""
        joints = tuple(dataclasses.replace(joint, slew=joint.slew * self.slew) for joint in lamp.joints)
        return dataclasses.replace(lamp, joints=joints)


STAGES: Mapping[str, Stage] = MappingProxyType(
    {
        "shadow": Stage("shadow", "", False, 1.0, 1.0),
        "gentle": Stage("gentle", "shadow", True, 0.5, 0.25),
        "full": Stage("full", "gentle", True, 1.0, 1.0),
    }
)
"""By name. Estimates, both of gentle: half the supply and a quarter of the speed."""

BY_HAND = Stage("by hand", "", False, 1.0, 1.0)
"""A person moves the lamp, whose torque stays off."""

SOFT = Stage("soft", "", True, 0.3, 1.0)
"""A person moves the lamp, whose servos hold its weight and no more: it needs a fifth of their stall torque (measured
on the twin), and a hand overcomes a third."""


def check_before(stage: Stage, after: Path | None, texts: Mapping[str, str], lamp: Lamp) -> None:
    """Check that the stage before this one was run to its end, with the same controller (or gesture) on the same lamp.

    Args:
        stage: The stage that is to run.
        after: The log of the one before.
        texts: Of the controller file, or of what else drives, as a log keeps them.
        lamp: The lamp's description.

    Raises:
        SafetyError: There is no such log, or it is of something else.
        FileError: The log cannot be read.
    """
    if not stage.before:
        return
    wanted = f"--stage {stage.name} wants --after LOG, the log of a finished {stage.before} run, or --force"
    if after is None:
        raise SafetyError(wanted, "--after")
    run = read_run(after)
    found = run.context.get("stage", "")
    if found != stage.before:
        raise SafetyError(f"is the log of {found or 'no'} stage; {wanted}", str(after))
    other = [kind for kind, text in texts.items() if run.context.get(kind) != text]
    if other:
        raise SafetyError(f"is of another {other[0]} ({run.context.get('controller_name', '?')}); {wanted}", str(after))
    if not same_lamp(lamp, run.context.get("lamp", "")):
        raise SafetyError(f"is of another lamp, or {lamp.path.name} was changed since; {wanted}", str(after))
    if not any(text == "torque off; finished" for _, _, text in run.events):
        raise SafetyError(f"is of a run that did not finish; {wanted}", str(after))
