"""`robolamp replay`: plays a run in the browser."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.cli.options import Setup
from robolamp.cli.screen.output import print_json
from robolamp.errors import FileError, RobolampError
from robolamp.files import spare, write_atomic
from robolamp.player.server import PageServer


def replay(
    log: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    truth: Path | None = None,
    calibration: str = "nominal",
    lamp: Path | None = None,
    port: int = 0,
    browse: bool = True,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Play a run in the browser: the lamp in 3D with its twin as a ghost, and the traces of both beside it.

    Args:
        log: The log of the run (.mcap).
        output: Write the page to this file (.html) and end; it needs no server and can be sent to somebody.
        truth: The truth log of an emulated lamp, which says where the base was; by default truth.mcap beside the log,
            if there is one. Without it the base is drawn where the twin's was.
        calibration: Calibration, the twin's numbers: a file, or a name in calibration/.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        port: Port of the page on this computer; 0: any that is free.
        browse: Open the browser; without it, only print the page's address.
        as_json: Print one JSON object.
    """
    if not 0 <= port <= 65535:
        raise RobolampError(f"{port} is no port; expected 0 to 65535", "--port")
    if output is not None and log.name:
        spare(output, log, truth, log.with_suffix(".truth.mcap"), log.with_name("truth.mcap"))
    html = _page(log, truth, Setup.of(lamp, calibration)).encode(errors="replace")  # no text: file names
    if output is not None:
        write_atomic(output, html)
        if as_json:
            print_json({"page": output, "bytes": len(html)})
        else:
            print(output)
        return 0
    try:
        server = PageServer(html, port)
    except OSError as error:
        raise RobolampError(f"port {port} cannot be used: {error.strerror or error}", "--port") from None
    with server:
        if as_json:
            print_json({"url": server.url})
        else:
            print(f"{server.url}   (Ctrl-C ends it)", flush=True)
        if browse and not webbrowser.open(server.url):
            print("robolamp: no browser here; open the address in one", file=sys.stderr)
        server.serve_forever()
    return 0


def show(log: Path, setup: Setup, page: Path) -> None:
    """Write a run's page and open it in the browser, without waiting; does nothing where there is no display.

    Args:
        log: The log of the run.
        setup: The lamp, and its twin's calibration.
        page: The file to write (.html).

    Raises:
        FileError: The log cannot be read, or the page not be written.
    """
    displayed = sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if displayed and sys.stdout.isatty():
        write_atomic(page, _page(log, None, setup).encode())
        webbrowser.open(page.absolute().as_uri())


def _page(path: Path, truth_path: Path | None, setup: Setup) -> str:
    from robolamp.compare.logged_motion import truth_of
    from robolamp.compare.replay_scene import playback_of
    from robolamp.compare.replays.goal_replay import replay as drive_twin
    from robolamp.log.mcap_stream import read_contents
    from robolamp.log.reader import prefix_in, run_of
    from robolamp.player.player_page import page

    if not path.name:
        raise FileError("is a folder; expected a log (.mcap)", str(path))
    contents = read_contents(path)
    run = run_of(contents, prefix_in(contents))
    truth = truth_of(run, truth_path)
    return page(playback_of(run, drive_twin(run, setup.lamp, setup.calibration, setup.assets), truth))
