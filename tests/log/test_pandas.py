"""A run at the prompt: a line that says what it is, and a pandas table."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest

from robolamp.log.reader import Run, read_run
from robolamp.log.run_table import columns_of
from robolamp.log.writer import LogWriter

from .ticks import JOINTS, make_tick

CONTEXT = {"backend": "twin", "controller_name": "nod", "goal_m": "0.3"}


@pytest.fixture
def run(tmp_path: Path) -> Run:
    with LogWriter(tmp_path / "run.mcap", context=CONTEXT, joints=JOINTS) as log:
        for number in range(50):
            log.tick(make_tick(number))
    return read_run(tmp_path / "run.mcap")


def test_a_run_says_what_it_is_in_a_line(run: Run) -> None:
    lasts = run.write_done[-1] - run.began[0]
    said = f"twin, 50 ticks in {lasts:.1f} s; nod to 0.3 m; {', '.join(JOINTS)}"
    assert repr(run) == f"<Run {str(run.path)!r}: {said}>"
    assert repr(replace(run, truncated=True)).endswith("; ends early>")
    assert "twin, 50 ticks" in repr(replace(run, context={"backend": "twin"}))
    assert len(repr(replace(run, context={}))) < 200 + len(str(run.path))


def test_a_run_as_a_pandas_table(run: Run) -> None:
    table = run.to_pandas()
    columns = columns_of(run)
    assert list(table.columns) == list(columns)
    assert table.shape == (50, len(columns))
    for joint, goals in zip(JOINTS, run.goal.T, strict=True):
        np.testing.assert_array_equal(table[f"{joint}_goal_rad"].to_numpy(), goals)
    assert table.attrs == run.context
    assert isinstance(table.set_index("write_done_s")["knee_goal_rad"], pandas.Series)


def test_without_pandas_it_says_so(run: Run) -> None:
    code = (
        "import sys; sys.modules['pandas'] = None\n"
        "from robolamp.errors import RobolampError; from robolamp.log.reader import read_run\n"
        f"run = read_run({str(run.path)!r})\n"
        "try: run.to_pandas()\nexcept RobolampError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "to_pandas: needs pandas: pip install pandas\n"
