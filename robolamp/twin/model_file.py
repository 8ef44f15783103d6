"""MuJoCo model files, as lamps and figures are compiled from them."""

from __future__ import annotations

from pathlib import Path

import mujoco

from robolamp.errors import FileError
from robolamp.files import read_bytes


def load_spec(path: Path, timestep: float | None) -> mujoco.MjSpec:
    """Return the specification in a model file, to be changed and compiled.

    Args:
        path: The file.
        timestep: Physics step [s]; None: the model's own.

    Raises:
        FileError: It is missing, or no model.
    """
    log = mujoco.MjLogConfig.get()  # no MUJOCO_LOG.TXT in the working directory: warning counters tell the same
    log.logto_file = log.logto_console = False
    mujoco.MjLogConfig.set(log)
    read_bytes(path)  # refuses what MuJoCo would read without end
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise FileError(f"not a MuJoCo model: {' '.join(str(error).split())}", str(path)) from None
    if timestep is not None:
        spec.option.timestep = timestep
    return spec
