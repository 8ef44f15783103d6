"""Where the lamp's data is: models, tasks, controllers, calibration, hardware description.

The one module that knows: in a checkout the folders stand beside the package, in a wheel inside it, and a user's own
folder (`--lamp DIR`) comes before both, file by file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from robolamp.errors import FileError
from robolamp.files import is_file, kind_of, suffix_of

_PACKAGE = Path(__file__).resolve().parent


def shipped() -> Path:
    """Return the folder that holds the shipped sim/, hardware/ and calibration/."""
    checkout = _PACKAGE.parent
    return checkout if (checkout / "sim" / "lamp" / "lamp.xml").is_file() else _PACKAGE / "_assets"


@dataclass(frozen=True)
class Assets:
    """Finds data files in a user's own folder first, then among the shipped ones.

    Attributes:
        own: The user's folder (laid out like a checkout: sim/, hardware/, calibration/), or None.
    """

    own: Path | None = None

    @classmethod
    def of(cls, folder: Path | str | None) -> Assets:
        """Return the assets for `--lamp FOLDER` (None: the shipped ones alone).

        Raises:
            FileError: The folder does not exist.
        """
        if folder is None:
            return cls()
        path = Path(folder)
        if kind_of(path) != "a folder":
            raise FileError("is not a folder; `--lamp` expects one laid out like robolamp's own", str(folder))
        return cls(path)

    def roots(self) -> tuple[Path, ...]:
        """The folders searched, first one first."""
        return (shipped(),) if self.own is None else (self.own, shipped())

    def path(self, relative: str) -> Path:
        """Return the first existing file of that path.

        Args:
            relative: The path inside a root, as "sim/lamp/scene.xml".

        Raises:
            FileError: No root has it, or something there is no file.
        """
        for root in self.roots():
            if is_file(root / relative):
                return root / relative
        raise FileError(f"{relative} not found", " or ".join(str(root) for root in self.roots()))

    def named(self, name: str | Path, folder: str, kind: str, exclude: tuple[str, ...] = ()) -> Path:
        """Return a TOML file given by path, or by the name of one in a data folder.

        Args:
            name: A path to a file, or a bare name such as "hop".
            folder: The data folder names are looked up in, as "sim/lamp/controllers".
            kind: What it is, for the message, as "controller".
            exclude: Names of that folder's files that are of another kind.

        Raises:
            FileError: Neither a file nor a known name; the message lists the known ones. Or a folder has that name.
        """
        path, bare = Path(name), bare_name(name)
        there = kind_of(path)
        if there == "file":
            return path
        if bare and bare not in exclude:
            for item in self.all(folder):
                if item.stem == bare and is_file(item):
                    return item
        known = ", ".join(sorted({item.stem for item in self.all(folder)} - {*exclude})) or "none"
        found = f"is {there}, " if there else ""
        raise FileError(f"{found}no such {kind}; give a file, or one of: {known}", str(name))

    def all(self, folder: str) -> Iterable[Path]:
        """Yield everything in a data folder that is named as a TOML file, the user's own first."""
        for root in self.roots():
            if (root / folder).is_dir():
                yield from sorted(item for item in (root / folder).iterdir() if suffix_of(item) == ".toml")


def bare_name(name: str | Path) -> str:
    """Return the name of a data file, whose points are its own ("limbo-22.5cm"), without .toml; empty for a path.

    Args:
        name: A name, or a path.
    """
    path = Path(name)
    if path.parent != Path():
        return ""
    return path.stem if suffix_of(path) == ".toml" else path.name
