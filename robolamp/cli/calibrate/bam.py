"""`robolamp calibrate bam`: parameter files of Rhoban/bam, in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.cli.screen.output import print_json
from robolamp.files import spare, suffix_of


def bam(
    file: str,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    servo: str = "XL330-M288-T",
    base: str = "nominal",
    lamp: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Import or export a parameter file of Rhoban/bam.

    Args:
        file: A parameter file of Rhoban/bam (.json), to import; or a calibration file or the name of one, to export.
        output: The calibration file (.toml) or parameter file (.json) to write.
        servo: Servo model that the parameters belong to.
        base: For an import: the calibration that gives the numbers that BAM lacks, such as the lamp's own.
        lamp: Folder of your own lamp, as `robolamp new` makes it.
        as_json: Print one JSON object: file, left_out.
    """
    from robolamp.calibrate.servo.bam import export_bam, import_bam  # tomlkit and the rest load after the arguments

    assets = Assets.of(lamp)
    spare(output, Path(file))
    if suffix_of(Path(file)) == ".json":
        left_out = import_bam(Path(file), output, servo, load_calibration(assets, base))
    else:
        left_out = export_bam(load_calibration(assets, file), output, servo)
    if as_json:
        print_json({"file": output, "left_out": left_out})
    else:
        for line in left_out:
            print(f"left out: {line}" if " = " in line else line)
        print(output)
    return 0
