"""`robolamp`: finds the verb, runs it, and turns every foreseeable failure into one line and exit code 2."""

from __future__ import annotations

import json
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
app.command("robolamp.cli.dry_run:dry_run", name="dry-run")
app.command("robolamp.cli.deploy:deploy", name="deploy")
app.command("robolamp.cli.emulate:emulate", name="emulate")
app.command("robolamp.cli.evolve:evolve", name="evolve")
app.command("robolamp.cli.score:score", name="score")
app.command("robolamp.cli.compare:compare", name="compare")
app.command("robolamp.cli.render:render", name="render")


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
