"""`robolamp calibrate`: the verbs that make a calibration and judge it."""

from __future__ import annotations

import re

from cyclopts import App

app = App(name="calibrate", help_format="plaintext")
# Import strings, as in `main`: scipy and mujoco load when a verb is called.
_STEPS = {
    "record": """Record a lamp for its calibration: the joints swing, drop and hop. Or one servo on a bench (--servo).

Says what to do with your hands before each step, and goes on where it stopped when it is started again with the same
folder. Some 20 minutes for the whole lamp; with --emulate seconds, and no hands.""",
    "lamp": """Fit a whole lamp to a recorded session: joints, arm, foot, floor; what is not told keeps its prior.

Exit code 0: the twin predicts what it was not fitted to; 1: it does not yet; 2: there was nothing to fit.""",
    "report": "Draw a calibration: recordings with the simulation laid over them, errors, parameters, the verdict.",
    "all": """Calibrate an emulated lamp from end to end, and prove it on a hop that was not recorded.

The steps one by one, as for a physical lamp: record, lamp, report.""",
    "fit": """Fit a servo's parameters to recordings of it on a pendulum bench, and write a calibration file.

The ladder of models is climbed as far as the error on recordings left out falls. Some minutes; what the recordings do
not tell is said in words and keeps its prior.""",
    "bam": "Import or export a parameter file of Rhoban/bam.",
    "score": """Say how well a calibration predicts recordings: mean absolute position error, open loop.

Each recording is simulated from its first sample to its last, with its own goals and its voltage as recorded.""",
}
for _order, (_step, _help) in enumerate(_STEPS.items()):
    _name = _step.replace("-", "_")
    _help = re.sub(r"(?<!\n)\n(?!\n)", " ", _help)  # paragraphs are wrapped to the terminal, not here
    app.command(f"robolamp.cli.calibrate_{_name}:{_name}", name=_step, help=_help, sort_key=_order)
