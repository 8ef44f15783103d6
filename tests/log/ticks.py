"""Ticks to log in tests."""

from __future__ import annotations

import numpy as np

from robolamp.signals import Health, Interventions, Observation, Tick

JOINTS = ("ankle", "knee", "neck")


def make_tick(index: int, n: int = 3, period: float = 0.02) -> Tick:
    start = 100.0 + index * period
    angle = 0.1 * index + np.arange(n)
    if index % 5 == 4:
        angle[1 % n] = np.nan
    return Tick(
        index=index,
        phase="run" if index >= 2 else "start",
        scheduled=start,
        began=start + 0.0001,
        read_done=start + 0.0010,
        write_done=start + 0.0020,
        observation=Observation(
            time=start + 0.0009,
            angle=angle,
            velocity=np.full(n, 0.5),
            current=np.full(n, -0.12),
            angle_age=np.full(n, 0.0003),
            foot_force=2.06,
            foot_age=float("inf") if index == 0 else 0.001,
            health=Health(
                np.full(n, 5.0), np.full(n, 31.0), np.full(n, 0.25), np.ones(n, np.int64), np.full(n, -1, np.int64)
            ),
            faults=("knee: no answer",) if index % 5 == 4 else (),
        ),
        goal=0.1 * index + np.arange(n) + 0.01,
        inputs=np.arange(4.0) + index if index >= 2 else np.empty(0),
        outputs=np.arange(n) * 0.1 if index >= 2 else np.empty(0),
        interventions=Interventions(1, 2, index),
        hops=index // 10,
        contact=index % 2 == 0,
    )
