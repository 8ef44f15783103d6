"""`robolamp calibrate report`: a page that shows how good a calibration is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.cli.options import Setup
from robolamp.cli.screen.output import counted, print_json
from robolamp.cli.screen.progress_bar import note
from robolamp.errors import RobolampError
from robolamp.files import spare


def report(
    calibration: str,
    /,
    *recordings: Path,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Draw a calibration: every recording and what the twin predicts for it, errors, parameters, the verdict.

    Args:
        calibration: A calibration file, or a name in calibration/.
        recordings: The folder that `robolamp calibrate record` made, or recordings of a servo on a pendulum bench; the
            fit may have used them or not.
        output: The page to write (HTML, one file).
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object.
    """
    setup = Setup.of(lamp, calibration)
    if not recordings:
        raise RobolampError("none given; expected a recorded session's folder, or recordings", "RECORDINGS")

    from robolamp.calibrate.lamp.session import read_session
    from robolamp.calibrate.manifest import load_manifest
    from robolamp.calibrate.report.calibration_page import write_report  # after the arguments are checked
    from robolamp.calibrate.report.simulations import show_bench, show_session
    from robolamp.calibrate.servo.recordings import read_recordings
    from robolamp.calibrate.servo.soundness import require_sound

    shown, benches = [], []
    for path in recordings:
        manifest = load_manifest(path)
        if manifest is not None and not manifest.servo:
            session = read_session(path, setup.lamp)
            shown += show_session(session, setup.lamp, setup.calibration, setup.assets)
        else:
            benches.append(path)
    notes: list[str] = []
    if benches:
        found = read_recordings(benches, notes.append)
        spare(output, *(recording.path for recording in found))
        require_sound(found)
        shown += show_bench(found, setup.calibration)
    for text in notes if not as_json else []:
        note(text)
    write_report(output, setup.calibration, shown)
    mean = sum(one.mae for one in shown) / len(shown) * 1e3
    if as_json:
        files = [{"file": one.name, "mae_mrad": one.mae * 1e3, "fitted": one.fitted} for one in shown]
        print_json({"report": output, "recordings": files, "mae_mrad": mean, "notes": notes})
    else:
        print(f"{counted(len(shown), 'recording')}, on average {mean:.1f} mrad\nreport {output}")
    return 0
