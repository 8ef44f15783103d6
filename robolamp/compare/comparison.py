"""A comparison: a lamp's run, its reference (the twin's replay or another run), and all results."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robolamp.calibration import Calibration
from robolamp.compare.align import JointError
from robolamp.compare.causes.ranking import Account
from robolamp.compare.causes.words import Finding
from robolamp.compare.divergence import BANDS, Parting, Plain, Spectrum
from robolamp.compare.replays.controller_replay import ControlReplay
from robolamp.compare.replays.goal_replay import Replay
from robolamp.compare.replays.trajectory import Side
from robolamp.compare.travel.landing import Landing
from robolamp.compare.travel.measured_way import MeasuredWay
from robolamp.compare.travel.sensed_flights import Hop
from robolamp.compare.verdicts.controller_alone import Alone
from robolamp.compare.verdicts.ensemble import Spread
from robolamp.compare.verdicts.task_verdict import NOT_DONE, Task
from robolamp.compare.verdicts.tolerances import Tolerances
from robolamp.compare.verdicts.twin_verdict import INSIDE, Verdict
from robolamp.log.reader import Run
from robolamp.twin.lamp_model import TwinModel


@dataclass(frozen=True)
class Comparison:
    """A lamp's run against the twin's replay of it, or against another run.

    Attributes:
        run: The lamp's run.
        lamp: What the lamp did.
        other: What it is compared with: the twin's replay, or another run ("the reference").
        reference: The other run; None: the twin's replay.
        replay: The twin's replay of the lamp's run.
        joints: Their difference, joint by joint, over phase "run" (over everything where it is missing or cut short).
        plain: The differences of velocities, currents and force.
        spectra: Where in frequency each joint's error lies.
        flights: The hops of both.
        parting: When the two part for good.
        control: The result of running the logged controller again.
        calibration: What the twin was calculated with.
        tolerances: What was allowed.
        task: Whether the lamp did its task.
        judged: Whether the reference explains it.
        spread: How far replays that start a hair apart are from each other.
        alone: What its controller does alone on the twin; this is not the replay.
        landing: Where it landed, as far as known.
        way: How far it came by its odometer; None: it has none.
        diagnosis: Probable causes, the strongest first.
        account: How knobs explain the difference: how much they leave unexplained, or why no cause could be found.
        report: The HTML report.
        twin_log: The replay as a log, topics "/twin/..."; None where two runs were compared.
    """

    run: Run
    lamp: Side
    other: Side
    reference: Run | None
    replay: Replay
    joints: tuple[JointError, ...]
    plain: Plain
    spectra: tuple[Spectrum, ...]
    flights: tuple[Hop, ...]
    parting: Parting
    control: ControlReplay
    calibration: Calibration
    tolerances: Tolerances
    task: Task
    judged: Verdict
    spread: Spread
    alone: Alone
    landing: Landing
    way: MeasuredWay | None
    diagnosis: tuple[Finding, ...]
    account: Account
    report: Path
    twin_log: Path | None

    @property
    def verdict(self) -> str:
        """Return "inside" or "outside" the tolerances, or "cannot say"."""
        return self.judged.word

    @property
    def good(self) -> bool:
        """Whether the verdict is inside, and nothing says that the task was not done."""
        return self.verdict == INSIDE and self.task.word != NOT_DONE

    @property
    def twin(self) -> TwinModel:
        """The compiled lamp."""
        return self.replay.twin

    @property
    def who(self) -> str:
        """Return what the other side's keys begin with: "twin", or "other" for a lamp."""
        return "twin" if self.other.name == "twin" else "other"

    def parts(self) -> dict[str, Any]:
        """Return the three answers as `--json` has them, here and in dry-run and deploy."""
        alone = self.alone
        return {
            "task": self.task.word,
            "task_why": list(self.task.why),
            "verdict": self.verdict,
            "verdict_why": list(self.judged.why),
            "hops_flown": self.landing.flown,
            "way_m": None if self.way is None else self.way.length,
            "way_stderr_m": None if self.way is None else self.way.stderr,
            "way_error_m": None if self.way is None else self.way.error,
            "twin_alone_m": alone.travel,
            "twin_alone_least_m": alone.least,
            "twin_alone_most_m": alone.most,
            "twin_alone_hops": None if alone.why else alone.hops,
            "twin_alone_fell": None if alone.why else alone.fell,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return what `robolamp compare --json` prints; NaN where a value is not known."""
        return {
            **self.parts(),
            "exceeded": list(self.judged.exceeded),
            "against": "twin" if self.reference is None else str(self.reference.path),
            "names": [self.lamp.name, self.other.name],
            "joints": [self._joint(index, joint) for index, joint in enumerate(self.joints)],
            "hops": self.lamp.hops,
            f"{self.who}_hops": self.other.hops,
            "flights": [_flight(hop, self.who) for hop in self.flights],
            "fell": self.lamp.fell,
            f"{self.who}_fell": self.other.fell,
            "travel_m": self.lamp.travel,
            f"{self.who}_travel_m": self.other.travel,
            "foot_force_mae_n": self.plain.force,
            "horizon_s": self.spread.horizon,
            "parted_s": self.parting.time,
            "parted_first_s": self.parting.first,
            "together_again_s": self.parting.last,
            "parted_joint": self.parting.joint or None,
            "parted_when": list(self.parting.just_then),
            "controller_exact": self.control.exact,
            "controller_differs_from_tick": self.control.first if self.control.exact is False else None,
            "ticks": int(self.run.index.size),
            "missed_ticks": self.run.missed_ticks,
            "truncated": self.run.truncated,
            "calibration": self.calibration.name,
            "diagnosis": findings(self.diagnosis),
            "unexplained_share": self.account.unexplained,
            "no_causes_why": self.account.missing or None,
            "report": self.report,
            "twin_log": self.twin_log,
        }

    def _joint(self, index: int, joint: JointError) -> dict[str, Any]:
        bands = [f"from_{low:g}_hz" for low in BANDS]
        return {
            "name": joint.name,
            "lag_ms": joint.lag * 1e3,
            "drift_ppm": joint.drift * 1e6,
            "mae_mrad": {"before": joint.before.mae * 1e3, "after": joint.after.mae * 1e3},
            "rmse_mrad": {"before": joint.before.rmse * 1e3, "after": joint.after.rmse * 1e3},
            "bias_mrad": joint.after.bias * 1e3,
            "worst_mrad": joint.after.worst * 1e3,
            "worst_at_s": joint.after.worst_at,
            "velocity_mae_rad_s": float(self.plain.velocity[index]),
            "current_mae_a": float(self.plain.current[index]),
            "error_rms_mrad": dict(zip(bands, (self.spectra[index].bands * 1e3).tolist(), strict=True)),
            "samples": joint.samples,
            "of": joint.of,
        }


def findings(diagnosis: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return findings as `--json` has them."""
    return [
        {
            "cause": each.cause,
            "evidence": each.evidence,
            "remedy": each.remedy,
            "knob": each.knob or None,
            "size": each.size,
            "unit": each.unit or None,
            "share": each.share,
        }
        for each in diagnosis
    ]


def _flight(hop: Hop, who: str) -> dict[str, Any]:
    def of(flight: Any, name: str) -> float:
        return getattr(flight, name) if flight else math.nan

    return {
        "off_s": of(hop.lamp, "off"),
        "on_s": of(hop.lamp, "on"),
        "flight_s": of(hop.lamp, "time"),
        "apex_m": of(hop.lamp, "apex"),
        f"{who}_off_s": of(hop.twin, "off"),
        f"{who}_on_s": of(hop.twin, "on"),
        f"{who}_flight_s": of(hop.twin, "time"),
        f"{who}_apex_m": of(hop.twin, "apex"),
        "off_late_ms": hop.off_late * 1e3,
        "on_late_ms": hop.on_late * 1e3,
    }
