"""The manifest of a recording session: which steps are done, so that an interrupted one goes on where it stopped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import tomlkit

from robolamp.errors import FileError
from robolamp.files import Table, is_file, read_toml, sha256, write_atomic

NAME = "manifest.toml"
"""Of the manifest in a session's folder."""


@dataclass(frozen=True)
class Entry:
    """One recording that was made.

    Attributes:
        step: Name of the procedure's step.
        file: The log, in the session's folder.
        sha256: Of the log.
        clamped: Whether the base was clamped.
        travel: How far the lamp went, as measured with a ruler [m]; None where it does not go.
    """

    step: str
    file: str
    sha256: str
    clamped: bool
    travel: float | None = None


@dataclass(frozen=True)
class Manifest:
    """A session.

    Attributes:
        lamp_sha256: Of the lamp's description.
        source: What was recorded: "lamp", or "emulator" and the name of its reality.
        by: Who did it; may be empty.
        date: When it began, as 2026-11-22.
        mass: Of the whole lamp, as weighed [kg]; None where it was not.
        entries: What was recorded, in order.
        servo: Model of the servo, where one alone was recorded on a bench; else empty.
    """

    lamp_sha256: str
    source: str
    by: str
    date: str
    mass: float | None = None
    entries: tuple[Entry, ...] = field(default=())
    servo: str = ""

    def done(self, step: str) -> Entry | None:
        """Return the entry of a step; None while there is none."""
        return next((entry for entry in self.entries if entry.step == step), None)

    def with_entry(self, entry: Entry) -> Manifest:
        """Return the manifest with one more recording, in place of an earlier one of the same step."""
        others = tuple(other for other in self.entries if other.step != entry.step)
        return replace(self, entries=(*others, entry))

    def write(self, folder: Path) -> None:
        """Write the manifest into a session's folder.

        Raises:
            FileError: It cannot be written.
        """
        document = tomlkit.document()
        document.add(tomlkit.comment("What `robolamp calibrate record` has recorded here; it goes on from this."))
        head: Mapping[str, object] = {
            "schema": 1, "lamp_sha256": self.lamp_sha256, "source": self.source, "by": self.by, "date": self.date,
        }  # fmt: skip
        for key, value in head.items():
            document.add(key, tomlkit.item(value))
        if self.servo:
            document.add("servo", tomlkit.item(self.servo))
        if self.mass is not None:
            document.add("mass", tomlkit.item(self.mass))
            document["mass"].comment("kg")
        rows = tomlkit.aot()
        for entry in self.entries:
            row = tomlkit.table()
            row.update({"step": entry.step, "file": entry.file, "sha256": entry.sha256, "clamped": entry.clamped})
            if entry.travel is not None:
                row["travel"] = entry.travel
                row["travel"].comment("m")
            rows.append(row)
        if self.entries:
            document.add("recording", rows)
        write_atomic(folder / NAME, tomlkit.dumps(document))


def load_manifest(folder: Path) -> Manifest | None:
    """Read a session's manifest; None where the folder has none.

    Raises:
        FileError: It is malformed.
    """
    path = folder / NAME
    if not is_file(path):
        return None
    root = Table(read_toml(path), str(path))
    root.integer("schema", 1, 1)
    entries = []
    for table in root.tables("recording") if "recording" in root else []:
        travel = table.number("travel", -10.0, 10.0, "m", default=None)
        entry = Entry(
            step=table.text("step"),
            file=table.text("file"),
            sha256=table.text("sha256"),
            clamped=table.flag("clamped"),
            travel=travel,
        )
        if Path(entry.file).name != entry.file:
            raise table.fail("file", f"{entry.file!r} is not the name of a file in this folder")
        table.done()
        entries.append(entry)
    manifest = Manifest(
        root.text("lamp_sha256"),
        root.text("source"),
        root.text("by"),
        root.text("date"),
        root.number("mass", 0.01, 100.0, "kg", default=None),
        tuple(entries),
        root.text("servo", default=""),
    )
    root.done()
    return manifest


def check_recordings(manifest: Manifest, folder: Path) -> None:
    """Check that every recording of a manifest is there, and is the one that was made.

    Raises:
        FileError: One is missing, or was changed since.
    """
    for entry in manifest.entries:
        path = folder / entry.file
        if not path.is_file():
            raise FileError(f"is missing, though {NAME} lists it; remove its entry to record it again", str(path))
        if sha256(path) != entry.sha256:
            raise FileError(f"is not the file that {NAME} lists; remove one of the two", str(path))
