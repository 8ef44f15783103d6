"""Where the lamp's data is: models, tasks, controllers, calibration, hardware description.

The one module that knows: in a checkout the folders stand beside the package, in a wheel inside it, and a user's own
folder (`--lamp DIR`) comes before both, file by file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from robolamp.errors import FileError

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
        try:
            found = path.is_dir()
        except OSError as error:  # such as a name that is too long
            raise FileError(f"cannot be read: {error.strerror}", str(folder)) from None
        if not found:
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
            if _is_file(root / relative):
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
        path = Path(name)
        try:
            exists = path.is_file()
        except OSError as error:  # such as a name that is too long
            raise FileError(f"cannot be read: {error.strerror}", str(name)) from None
        if exists:
            return path
        if path.parent == Path() and path.suffix in ("", ".toml") and path.stem not in exclude:
            for root in self.roots():
                candidate = root / folder / f"{path.stem}.toml"
                if _is_file(candidate):
                    return candidate
        known = ", ".join(sorted({item.stem for item in self.all(folder)} - {*exclude})) or "none"
        raise FileError(f"no such {kind}; give a file, or one of: {known}", str(name))

    def all(self, folder: str) -> Iterable[Path]:
        """Yield every TOML file of a data folder, the user's own first."""
        for root in self.roots():
            yield from sorted((root / folder).glob("*.toml"))


def _is_file(path: Path) -> bool:
    """Return whether there is a file; a folder in its place is refused, not passed over for a shipped file."""
    if path.is_dir():
        raise FileError("is a folder; expected a file", str(path))
    return path.is_file()
