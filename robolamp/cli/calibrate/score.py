"""`robolamp calibrate score`: how well a calibration predicts recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.screen.output import counted, print_json
from robolamp.cli.screen.progress_bar import bar, note


def score(
    file: str,
    recordings: Annotated[list[Path], Parameter(negative="")],
    /,
    *,
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Say how well a calibration predicts recordings of a servo on a pendulum bench: mean absolute position error.

    It simulates each recording in MuJoCo from its first sample to its last, open loop, with the recorded goal angles
    and supply voltage.

    Args:
        file: A calibration file, or the name of one in calibration/.
        recordings: Recordings, or folders of them: of `robolamp calibrate record --servo` (.mcap), .json of Rhoban/bam,
            .csv.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object: recordings (file, mae_mrad, seen), mae_mrad, mae_unseen_mrad, notes.
    """
    from robolamp.calibrate.servo.model_scores import mean_error, score_recordings
    from robolamp.calibrate.servo.recordings import read_recordings  # mujoco and numba load after the arguments
    from robolamp.calibrate.servo.soundness import require_sound

    calibration = load_calibration(Assets.of(lamp), file)
    notes: list[str] = []
    found = read_recordings(recordings, notes.append)
    require_sound(found)
    for text in notes if not as_json else []:
        note(text)
    with bar("simulating", quiet=as_json) as share:
        scores = score_recordings(found, calibration, share=share)
    unseen = mean_error([each for each in scores if each.seen is False])
    if as_json:
        print_json(
            {
                "calibration": calibration.name,
                "recordings": [
                    {"file": each.recording.name, "mae_mrad": each.mae * 1e3, "seen": each.seen} for each in scores
                ],
                "mae_mrad": mean_error(scores) * 1e3,
                "mae_unseen_mrad": unseen * 1e3,
                "notes": notes,
            }
        )
        return 0
    width = max(len(each.recording.name) for each in scores)
    for each in scores:
        seen = "   (fitted to it)" if each.seen else ""
        print(f"{each.recording.name:<{width}}  {each.mae * 1e3:7.1f} mrad{seen}")
    print(f"{'mean of ' + counted(len(scores), 'recording'):<{width}}  {mean_error(scores) * 1e3:7.1f} mrad")
    return 0
