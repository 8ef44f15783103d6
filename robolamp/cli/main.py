"""`robolamp`: finds the verb, runs it, and turns every foreseeable failure into one line and exit code 2."""

from __future__ import annotations

import contextlib
import json
import re
import sys

from cyclopts import App, CycloptsError, UnknownOptionError

from robolamp import __version__
from robolamp.cli.screen.help import Wrapped
from robolamp.cli.screen.streams import let_go_of_output
from robolamp.errors import RobolampError, on_one_line

app = App(
    name="robolamp",
    version=__version__,
    help="A desk lamp that hops: evolve a controller on its twin (MuJoCo model), run it over serial, compare the two.",
    help_format="plaintext",
    help_formatter=Wrapped(),
    result_action="return_value",
    suppress_keyboard_interrupt=False,  # which signal it was is known here
)
_INTERRUPTED = 130  # 128 + SIGINT
_BROKEN_PIPE = 141  # 128 + SIGPIPE, as a shell has it
# Import strings: a verb's libraries (mujoco, numba) are loaded when the verb is called, not for --help.
_VERBS = {
    "dry-run": """Run a controller on the emulated lamp, through real serial ports.

An emulated lamp is a program that answers like the servos and the foot sensor. dry-run drives it as deploy drives a
physical lamp, and writes a log, a truth log (what the lamp really did), and a report that compares the lamp with its
twin, the MuJoCo model of it. Exit code 0: the run ended by itself and the lamp stands; 1: the lamp fell or the run was
stopped; 2: it could not run.""",
    "deploy": """Run a controller on the physical lamp.

It moves the lamp softly to its neutral pose, lets the controller drive, moves softly to rest, and turns torque off.
Then it writes a report that compares the lamp with its twin, the MuJoCo model of it. Stand the lamp upright with room
to hop and a hand near its plug. Ctrl-C lands it softly; a second Ctrl-C turns its torque off at once.""",
    "gesture": """Make the lamp nod, peek or stretch: list, check, play and record gestures.

A gesture is a short motion of a few key frames, in a text file that you can change. `robolamp gesture play curious`
plays one on the emulated lamp, with --port on the physical one.""",
    "play": """Play a sequence: gestures and hops one after the other, in one run.

A sequence is a text file that names gestures and controllers in turn. Torque stays on from the first to the last.""",
    "stop": """Turn every servo's torque off and clear its watchdog: releases a lamp that is frozen.

Hold the lamp: it sinks. --force first ends the program that uses the port. Exit code 0: every servo confirmed; 1: some
did not: switch the supply off.""",
    "monitor": "Show what the servos and the foot sensor report, as a live table, until Ctrl-C.",
    "setup": """Set up the physical lamp: find and number the servos, set zeros, tare the foot, check everything.

hardware/README.md says when to do which step. Torque stays off throughout. With --json each prints one object.""",
    "compare": """Compare a run of the lamp with its twin or with another run, and write a report.

The twin is the MuJoCo model of the lamp. compare answers three questions first: Did the lamp reach its goal? Does the
twin do the same when a replay drives it with the goal angles that the lamp was sent? What does the controller do alone
on the twin? It also compares two logs; for a folder of runs it shows the trend and how well lamp and twin agree over
controllers.

Exit code 0: all differences are inside the tolerances (how far lamp and twin may differ), and nothing says that the
task was not done; 1: outside, not done, or cannot say; 2: could not compare. For a folder 0 or 2.""",
    "calibrate": "Make the twin predict your lamp or servo: record it, fit the twin's numbers, judge, report.",
    "score": "Score a controller on the twin (the lamp's MuJoCo model), over many goals and lamps.",
    "explain": "Show how a controller works: its expressions, simplified; the signals they read; the branches taken.",
    "evolve": """Evolve a controller on the twin, the MuJoCo model of the lamp.

It writes the best controller to OUTPUT/controller.toml and a line for each generation to OUTPUT/progress.jsonl. However
a run was stopped, `robolamp evolve --resume OUTPUT` continues it.""",
    "odometer": """Learn and judge the odometer: how far each hop went, from what servos and foot sensor measure.

A lamp with an odometer gives its controllers three signals: way (how far it has come), way_left and way_stderr (the
standard error of both). sim/lamp/README.md says how it works.""",
    "study": """Run the papers' studies of their searches, draw them, and say which of their claims hold.

Studies of the lamp of 1997 (Gritz & Hahn): population, generations, selection, crossover (its Figures 5 to 8), tuned,
specific, distance, or all of these. Studies of Jumper (EMOT): jumper, head, gep-population. Study of the hop:
representation. Stop it at any time and start it again: it keeps finished runs and continues one that was stopped.""",
    "log": """Show what the log of a run holds, write it as a table, or save what is left of a broken one.""",
    "replay": """Play a run in the browser: the lamp in 3D, its twin (MuJoCo model) as a ghost, a time slider, traces.

It serves the page on this computer alone, until Ctrl-C; with -o it writes the page to a file, which needs no
server.""",
    "render": "Draw a controller at work, or a log's replay, as a strip of pictures or an animation.",
    "new": "Make a folder for your own lamp, to give as --lamp: files for you to change.",
    "emulate": """Run an emulated lamp that any Dynamixel client can talk to, until Ctrl-C.

An emulated lamp is a program that answers like the servos and the foot sensor, on one serial port each; a MuJoCo model
of the lamp moves in real time behind them. The lamp starts upright; each joint is held as if by hand until its torque
is first turned on. docs/emulator.md says what is modelled.""",
}
_WITH_VERBS = ("log", "calibrate", "odometer", "setup", "gesture")
for _order, (_verb, _help) in enumerate(_VERBS.items()):
    _function = "app" if _verb in _WITH_VERBS else _verb.replace("-", "_")
    app.command(f"robolamp.cli.{_verb.replace('-', '_')}:{_function}", name=_verb, help=_help, sort_key=_order)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit the process with its code.

    Args:
        arguments: The words after `robolamp`; None: the process's own.
    """
    words = sys.argv[1:] if arguments is None else arguments
    as_json = "--json" in words
    try:
        _refuse_empty(words)
        code = app(words, exit_on_error=False, print_error=False)
        sys.stdout.flush()  # here, where a failure can still be told
    except UnknownOptionError as error:
        code = _fail(*_misplaced(error), as_json)
    except CycloptsError as error:
        code = _fail(str(error).strip().replace("\n", " "), "command line", as_json)
    except RobolampError as error:
        code = _fail(error.message, error.where, as_json)
    except KeyboardInterrupt as interrupt:
        code = interrupt.args[0] if interrupt.args else _INTERRUPTED
    except BrokenPipeError:  # nobody reads any more, as behind `| head`
        code = _BROKEN_PIPE
    except SystemExit as end:  # rich ends the process over a broken pipe, with the code of a run that went wrong
        code = _BROKEN_PIPE if isinstance(end.__context__, BrokenPipeError) else end.code
    except OSError as error:  # one that nothing below has put into words of its own
        code = _fail(error.strerror or str(error), str(error.filename or "output"), as_json)
    let_go_of_output()
    sys.exit(code if isinstance(code, int) else 0)


def _misplaced(error: UnknownOptionError) -> tuple[str, str]:
    """Return what to say of an option that a verb has not, and where: which verbs beside it have it."""
    option, chain = error.token.keyword or error.token.value, list(error.command_chain or ())
    beside = app
    for verb in chain[:-1]:
        beside = beside[verb]
    has = [
        verb
        for verb in beside
        if len(chain) > 1
        and not verb.startswith("-")
        and any(option in argument.names for argument in beside[verb].assemble_argument_collection())
    ]
    if not has:
        return str(error).strip().replace("\n", " "), "command line"
    return f"is for {' and '.join(has)}, not for {chain[-1]}", option


def _refuse_empty(words: list[str]) -> None:
    """Refuse an argument without a character: as a path it would be the current folder."""
    for before, word in zip(["", *words], words, strict=False):
        if not word or re.fullmatch("--[a-z-]+=", word):
            name = word.rstrip("=") or (before if before.startswith("-") else "")
            raise RobolampError("is empty; expected a value", name or "an argument")


def _fail(message: str, where: str, as_json: bool) -> int:
    if as_json:
        with contextlib.suppress(OSError, ValueError):
            print(json.dumps({"error": message, "where": where}), flush=True)
            return 2
    with contextlib.suppress(OSError, ValueError):  # closed, too: then there is nobody to tell
        print(on_one_line(f"robolamp: {where + ': ' if where else ''}{message}"), file=sys.stderr, flush=True)
    return 2
