"""Where the process begins: Ctrl-C while the command line is still being loaded ends it quietly, too."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and exit the process with its code."""
    try:
        from robolamp.cli.main import main as run  # noqa: PLC0415

        run()
    except KeyboardInterrupt:
        sys.exit(130)
