"""Goals reach the servos with the last byte of their packet: later than handed over, on slow lines more so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from robolamp.compare.replays.goal_replay import replay
from robolamp.log.reader import read_run

from .lamps import ASSETS, CALIBRATION, LAMP, write_run

BYTES = 10 + 4 + 3 * 5  # a sync write of three goals (e-manual, "Sync Write")


@pytest.mark.parametrize("baud", [57_600, 115_200])
def test_the_twin_gets_goals_when_their_packet_is_through(tmp_path, baud):
    run = read_run(write_run(tmp_path)[0])
    slow, quick = (
        replay(run, dataclasses.replace(LAMP, bus_baud=rate), CALIBRATION, ASSETS) for rate in (baud, 4_000_000)
    )
    late = BYTES * 10 * (1 / baud - 1 / 4_000_000)
    time = quick.time[100:-100]
    for joint in range(3):
        shifted = np.interp(time - late, quick.time, quick.angle[:, joint])
        off = np.abs(np.interp(time, slow.time, slow.angle[:, joint]) - shifted).mean()
        assert off < 0.05 * np.abs(quick.angle[100:-100, joint] - shifted).mean()
