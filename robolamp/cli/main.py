"""`robolamp`: finds the verb, runs it, and turns every foreseeable failure into one line and exit code 2."""

from __future__ import annotations

import json
import re
import sys

from cyclopts import App, CycloptsError

from robolamp import __version__
from robolamp.errors import RobolampError

app = App(
    name="robolamp",
    version=__version__,
    help="A desk lamp that hops: evolve a controller on its MuJoCo twin, run it over serial, compare the two.",
    help_format="plaintext",
    result_action="return_value",
)
# Import strings: a verb's libraries (mujoco, numba) are loaded when the verb is called, not for --help.
_VERBS = {
    "dry-run": """Run a controller on the emulated lamp, through real serial ports.

The same loop as deploy, with a log, the truth, and a report that compares the lamp with its twin. Exit code 0: the run
ended by itself and the lamp stands; 1: it fell or was stopped; 2: it could not run.""",
    "deploy": """Run a controller on the physical lamp.

Soft start, hop, soft landing, torque off; then a report that compares the lamp with its twin. Stand the lamp upright
with room to hop and a hand near its plug. Ctrl-C lands it softly; a second Ctrl-C turns its torque off at once.""",
    "compare": """Compare a run of the lamp with its twin, and write a report.

The twin replays the log's goals. Exit code 0: inside the tolerances; 1: outside; 2: could not compare.""",
    "score": "Score a controller on the twin, over many goals and lamps.",
    "evolve": """Evolve a controller on the twin.

The controller is written to OUTPUT/controller.toml, the course of the run to OUTPUT/progress.jsonl.""",
    "render": "Draw a controller at work, or a log's replay, as a strip of pictures or an animation.",
    "emulate": """Run an emulated lamp that any Dynamixel client can talk to, until Ctrl-C.

Servos and foot sensor are behind a serial port each; the lamp's physics runs behind them in real time. It starts
upright, each joint held as if by hand until its torque is first turned on. docs/emulator.md says what is modelled.""",
}
for _order, (_verb, _help) in enumerate(_VERBS.items()):
    _function = _verb.replace("-", "_")
    _help = re.sub(r"(?<!\n)\n(?!\n)", " ", _help)  # paragraphs are wrapped to the terminal, not here
    app.command(f"robolamp.cli.{_function}:{_function}", name=_verb, help=_help, sort_key=_order)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit the process with its code.

    Args:
        arguments: The words after `robolamp`; None: the process's own.
    """
    words = sys.argv[1:] if arguments is None else arguments
    try:
        code = app(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        code = _fail(str(error).strip().replace("\n", " "), "command line", "--json" in words)
    except RobolampError as error:
        code = _fail(error.message, error.where, "--json" in words)
    except KeyboardInterrupt:
        code = 130
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str, where: str, as_json: bool) -> int:
    if as_json:
        print(json.dumps({"error": message, "where": where}), flush=True)
    else:
        print(f"robolamp: {where + ': ' if where else ''}{message}", file=sys.stderr, flush=True)
    return 2
