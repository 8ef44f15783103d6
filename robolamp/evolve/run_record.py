"""What a run was started with: run.toml in its folder, written once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from robolamp.errors import FileError
from robolamp.evolve.platform import machine
from robolamp.files import Table, is_file, read_toml, sha256, write_atomic

NAME = "run.toml"
"""The file's name in a run's folder."""


def write_record(record: Mapping[str, Any], folder: Path) -> None:
    """Write what a run is started with, and on which machine.

    Args:
        record: seed, tuning, command, reuse, marks of the seeds, lamp, terms, and hashes; of the lamp's runs, the
            calibration.
        folder: The run's folder.

    Raises:
        FileError: It cannot be written.
    """
    document = tomlkit.document()
    document.add(tomlkit.comment("What this run was started with; robolamp evolve --resume reads it."))
    document.update({"schema": 1, **record, "machine": machine()})
    write_atomic(folder / NAME, tomlkit.dumps(document))


def read_record(folder: Path) -> dict[str, Any]:
    """Return what a run was started with: its run.toml.

    Raises:
        FileError: There is none, or it is malformed.
    """
    path = folder / NAME
    if not is_file(path):
        raise FileError("holds no run; expected a folder made by robolamp evolve -o", str(folder))
    root = Table(read_toml(path), str(path))
    root.integer("schema", 1, 1)
    record: dict[str, Any] = {name: root.integer(name, 0, 2**63) for name in ("seed", "tuning")}
    record["reuse"] = root.flag("reuse")
    record["seeds"] = root.text("seeds", default=None)  # 0.1.0 did not write it
    texts = (
        "command",
        "lamp",
        "task_sha256",
        "terms",
        "terms_sha256",
        "twin_sha256",
        *(("calibration", "calibration_sha256") if "calibration" in root else ()),
    )
    record |= {name: root.text(name) for name in texts}
    record["machine"] = {name: str(value) for name, value in root.table("machine").raw().items()}
    root.done()
    return record


def check_unchanged(path: Path, expected: str) -> None:
    """Refuse a file that has changed since a run began.

    Args:
        path: The file.
        expected: Its SHA-256 then.

    Raises:
        FileError: It has changed, or cannot be read.
    """
    if sha256(path) != expected:
        raise FileError("has changed since the run began; put it back, or begin another run", str(path))
