"""`robolamp calibrate`: the verbs that make a calibration and judge it."""

from __future__ import annotations

import re

from cyclopts import App

app = App(name="calibrate", help_format="plaintext")
# Import strings, as in `main`: scipy and mujoco load when a verb is called.
_STEPS = {
    "record": """Record a lamp for its calibration: the joints swing, drop and hop. Or one servo on a bench (--servo).

It tells you what to do before each step. Started again with the same folder, it continues where it stopped. Takes some
20 minutes for the whole lamp; with --emulate it takes seconds and nothing to do.""",
    "lamp": """Fit the twin (MuJoCo model) of a whole lamp to its recordings: joints, arm, foot and floor.

A value that the recordings do not determine keeps its prior, the value of --base. Exit code 0: the twin predicts what
it was not fitted to; 1: it does not yet; 2: there was nothing to fit.""",
    "report": "Draw a calibration: recordings and what the twin predicts for them, errors, parameters, the verdict.",
    "all": """Calibrate an emulated lamp from end to end, and test the result on a hop that was left out of the fit.

Does the same steps as for a physical lamp: record, lamp, report.""",
    "fit": """Fit a servo's parameters to recordings of it on a pendulum bench, and write a calibration file.

It tries models of more and more terms, as long as the error falls on recordings that were left out of the fit. It names
each parameter that the recordings do not determine; that one keeps its prior, the value of --base. Takes some
minutes.""",
    "bam": "Import or export a parameter file of Rhoban/bam.",
    "score": """Say how well a calibration predicts recordings: mean absolute position error, open loop.

It simulates each recording from its first sample to its last, with the recorded goal angles and voltage.""",
}
for _order, (_step, _help) in enumerate(_STEPS.items()):
    _name = _step.replace("-", "_")
    _help = re.sub(r"(?<!\n)\n(?!\n)", " ", _help)  # paragraphs are wrapped to the terminal, not here
    app.command(f"robolamp.cli.calibrate.{_name}:{_name}", name=_step, help=_help, sort_key=_order)
