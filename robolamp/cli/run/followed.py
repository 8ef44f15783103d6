"""How well the joints followed a motion that was planned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from robolamp.cli.run.drive import Drive
from robolamp.cli.run.outcome import Failure, reported
from robolamp.compare.align import MAX_LAG, JointError, Trace, compare_joint
from robolamp.log.reader import read_run


@dataclass(frozen=True)
class Followed:
    """How well the joints followed a motion that was planned.

    Attributes:
        facts: As `--json` has it; empty where nothing was planned.
        text: For people, with a line feed at its end; empty likewise.
    """

    facts: dict[str, Any]
    text: str


def followed(plan: Drive, failures: list[Failure]) -> Followed:
    """Return how well the joints followed the planned motion, as they measured it.

    Args:
        plan: What was asked for.
        failures: What went wrong so far.
    """
    if not plan.planned:
        return Followed({}, "")
    joints = reported(lambda: _followed(plan), failures, plan.log)
    if joints is None:
        return Followed({}, "")
    lags = {joint.name: joint.lag if joint.lag < MAX_LAG else math.nan for joint in joints}  # longer is none, but sag
    facts = [
        {
            "name": joint.name,
            "lag_ms": lags[joint.name] * 1e3,
            "mae_mrad": {"before": joint.before.mae * 1e3, "after": joint.after.mae * 1e3},
        }
        for joint in joints
    ]
    said = ", ".join(
        f"{joint.name} {joint.before.mae * 1e3:.0f} mrad"
        + f" ({joint.after.mae * 1e3:.0f} with a lag of {joint.lag * 1e3:.0f} ms removed)"
        * math.isfinite(lags[joint.name])
        for joint in joints
    )
    return Followed({"planned": facts}, f"Off the planned motion, on the average: {said}.\n")


def _followed(plan: Drive) -> list[JointError]:
    run = read_run(plan.log)
    rows = run.phase == "run"
    planned, at = run.outputs[rows], run.sampled_at[rows]
    return [
        compare_joint(
            name, Trace.of(run.write_done[rows], planned[:, index]), Trace.of(at[:, index], run.angle[rows, index]),
            int(np.count_nonzero(rows)),
        )
        for index, name in enumerate(run.joints)
    ]  # fmt: skip
