"""A comparison: a lamp's run, the twin's replay of it, and what came of laying the one over the other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robolamp.calibration import Calibration
from robolamp.compare.align import JointError
from robolamp.compare.diagnosis import Finding
from robolamp.compare.replay import Replay
from robolamp.compare.tolerances import Tolerances
from robolamp.log.reader import Run, Truth


@dataclass(frozen=True)
class Comparison:
    """A lamp's run against the twin's replay of it.

    Attributes:
        run: The lamp's run.
        replay: The twin's.
        truth: What the emulated lamp truly did, or None.
        joints: Their difference, joint by joint, over phase "run" (over everything where it is missing or cut short).
        lamp_travel: How far the lamp's base came [m]; NaN where no truth is known.
        twin_travel: How far the twin's did [m].
        calibration: What the twin was calculated with.
        tolerances: What was allowed.
        exceeded: What is outside its tolerance, one sentence each; empty where nothing is.
        diagnosis: Probable causes, the strongest first.
        report: The HTML report.
        twin_log: The replay as a log, topics "/twin/...".
    """

    run: Run
    replay: Replay
    truth: Truth | None
    joints: tuple[JointError, ...]
    lamp_travel: float
    twin_travel: float
    calibration: Calibration
    tolerances: Tolerances
    exceeded: tuple[str, ...]
    diagnosis: tuple[Finding, ...]
    report: Path
    twin_log: Path

    @property
    def verdict(self) -> str:
        """Return "inside" or "outside" the tolerances."""
        return "outside" if self.exceeded else "inside"

    @property
    def hops(self) -> int:
        """Hops that the lamp counted."""
        return int(self.run.hops[-1])

    @property
    def twin_hops(self) -> int:
        """Hops that the twin's foot sensor gives, counted by the same code."""
        return self.replay.ticks[-1].hops

    @property
    def fell(self) -> bool | None:
        """Whether the lamp fell; None where no truth is known."""
        if self.truth is None:
            return None
        # After the last tick torque is off, and a lamp that then sinks to the floor has not fallen.
        during = self.run.at(self.truth.log_time) <= self.run.write_done[-1]
        return bool(self.truth.fallen[during].any())

    @property
    def twin_fell(self) -> bool:
        """Whether the twin fell in phase "run" or after."""
        return bool(self.replay.outcome.fallen[0])

    def as_dict(self) -> dict[str, Any]:
        """Return what `robolamp compare --json` prints; NaN where a value is not known."""
        return {
            "verdict": self.verdict,
            "exceeded": list(self.exceeded),
            "joints": [
                {
                    "name": joint.name,
                    "lag_ms": joint.lag * 1e3,
                    "mae_mrad": {"before": joint.before.mae * 1e3, "after": joint.after.mae * 1e3},
                    "rmse_mrad": {"before": joint.before.rmse * 1e3, "after": joint.after.rmse * 1e3},
                    "bias_mrad": joint.after.bias * 1e3,
                    "worst_mrad": joint.after.worst * 1e3,
                    "worst_at_s": joint.after.worst_at - float(self.run.scheduled[0]),
                    "samples": joint.samples,
                }
                for joint in self.joints
            ],
            "hops": self.hops,
            "twin_hops": self.twin_hops,
            "fell": self.fell,
            "twin_fell": self.twin_fell,
            "travel_m": self.lamp_travel,
            "twin_travel_m": self.twin_travel,
            "ticks": int(self.run.index.size),
            "missed_ticks": self.run.missed_ticks,
            "truncated": self.run.truncated,
            "calibration": self.calibration.name,
            "diagnosis": [
                {"cause": finding.cause, "evidence": finding.evidence, "remedy": finding.remedy}
                for finding in self.diagnosis
            ],
            "report": self.report,
            "twin_log": self.twin_log,
        }
