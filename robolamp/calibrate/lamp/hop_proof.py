"""The proof of a calibration: a hop that it has never seen, predicted by the twin before and after."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from robolamp.assets import Assets
from robolamp.calibrate.lamp.floor_fit import flights_in, flights_of, matched, way
from robolamp.calibrate.lamp.session import LampRecording
from robolamp.calibrate.lamp.simulation import simulate
from robolamp.calibration import Calibration
from robolamp.lamp import Lamp
from robolamp.twin.lamp_model import build


@dataclass(frozen=True)
class Proof:
    """How well a calibration predicts one hop from its goals alone.

    Attributes:
        mae: Mean absolute error of the joints [rad].
        travel: How far the base went in the twin [m].
        travelled: How far it truly went [m]; NaN where not measured.
        time_error: Largest error of a take-off or landing [s]; infinite where the twin misses a flight.
    """

    mae: float
    travel: float
    travelled: float
    time_error: float

    @property
    def travel_error(self) -> float:
        """Error of the hop's length, relative."""
        return abs(self.travel - self.travelled) / max(abs(self.travelled), 0.01)


def prove(recording: LampRecording, lamp: Lamp, calibration: Calibration, assets: Assets) -> Proof:
    """Predict a hop.

    Args:
        recording: The hop.
        lamp: The lamp's description.
        calibration: The twin's numbers.
        assets: Where the model is.
    """
    shot = simulate(recording, [build(lamp, calibration, assets, clamped=recording.clamped)])
    error = np.abs(shot.angle[0] - recording.run.angle[recording.rows])
    seen = flights_in(recording, lamp.flight_time)
    late = [
        abs(predicted - real)
        for flight, pair in zip(seen, matched(seen, flights_of(shot, 0, lamp.flight_time)), strict=True)
        for real, predicted in zip(flight, pair, strict=True)
    ]
    return Proof(
        mae=float(np.nanmean(error)),
        travel=way(shot, 0),
        travelled=math.nan if recording.travel is None else recording.travel,
        time_error=(max(late) if np.isfinite(late).all() else math.inf) if late else 0.0,
    )
