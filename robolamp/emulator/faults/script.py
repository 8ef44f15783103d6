"""Fault scripts: what goes wrong on an emulated bus, when, and how often.

TOML, every key optional but `name`:

name = "rough"
seed = 1                     # of all chances

[instruction]                # packets to the servos; [status]: packets from them; [foot]: the sensor's frames
dropped = 0.01               # chance that one does not arrive, 0 to 1
corrupted = 0.01             # ... arrives with one bit turned over
duplicated = 0.01            # ... arrives twice
truncated = 0.01             # ... arrives without its end
late = 0.01                  # ... arrives late
late_by = 0.005              # s

[[event]]                    # at an exact moment
what = "silent"              # one of EVENTS
at = 3.0                     # s since the emulator started
lasts = 0.5                  # s
servo = 2                    # its id at the start
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from robolamp.errors import FileError
from robolamp.files import Table, read_toml

DAMAGES = ("dropped", "corrupted", "duplicated", "truncated", "late")
"""What can happen to a packet."""

STREAMS = ("instruction", "status", "foot")
"""Packets to the servos, packets from them, frames of the foot sensor."""

PORTS = ("servo", "foot")
"""Ports that can be unplugged."""

EVENTS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(DAMAGES, ("stream", "packets")),
    "silent": ("servo", "lasts"),
    "reboot": ("servo",),
    "id_lost": ("servo", "id"),
    "overload": ("servo",),
    "sag": ("volts", "lasts"),
    "unplugged": ("port", "lasts"),
    "foot_silent": ("lasts",),
    "foot_stuck": ("lasts",),
    "foot_rubbish": ("lasts",),
}
"""What an event may be, and the keys it has beside `what` and `at` (a damage may have `packet` in place of `at`)."""

_LATEST = 0.1  # s: a line that is later than this is one that was unplugged
_SHORTEST, _LONGEST = 0.001, 1e6  # s


@dataclass(frozen=True)
class Rates:
    """Chances of each damage to a packet, 0 to 1; their sum is at most 1.

    Attributes:
        dropped: It does not arrive.
        corrupted: It arrives with one bit turned over.
        duplicated: It arrives twice.
        truncated: It arrives without its end.
        late: It arrives late.
        late_by: By how much [s].
    """

    dropped: float = 0.0
    corrupted: float = 0.0
    duplicated: float = 0.0
    truncated: float = 0.0
    late: float = 0.0
    late_by: float = 0.005

    @property
    def any(self) -> bool:
        """Whether there is any chance of damage."""
        return any(getattr(self, damage) for damage in DAMAGES)


@dataclass(frozen=True)
class Event:
    """One fault at an exact moment.

    Attributes:
        what: One of EVENTS.
        at: Since the emulator started [s].
        packet: For a damage: the first packet of its stream that is hit, counted from 1; 0: the first after `at`.
        packets: For a damage: how many in a row.
        stream: For a damage: one of STREAMS.
        servo: Id at the start of the servo that is hit.
        lasts: How long [s].
        id: The id that a servo has after it lost its own.
        volts: By how much the supply sags [V].
        port: The port that is unplugged, one of PORTS.
    """

    what: str
    at: float = 0.0
    packet: int = 0
    packets: int = 1
    stream: str = "instruction"
    servo: int = 0
    lasts: float = 0.0
    id: int = 1
    volts: float = 0.0
    port: str = "servo"


@dataclass(frozen=True)
class Faults:
    """A fault script.

    Attributes:
        name: The script's name.
        seed: Of all chances.
        rates: Chances of damage, by stream.
        events: Faults at exact moments, in the order of the file.
    """

    name: str
    seed: int = 0
    rates: Mapping[str, Rates] = field(default_factory=dict)
    events: tuple[Event, ...] = ()

    @property
    def unplugs(self) -> bool:
        """Whether a port is ever unplugged."""
        return any(event.what == "unplugged" for event in self.events)


def load_faults(path: Path, ids: tuple[int, ...], *, foot: bool = True) -> Faults:
    """Read a fault script.

    Args:
        path: The file.
        ids: The servos' ids at the start.
        foot: Whether there is a foot sensor to fail.

    Raises:
        FileError: The file cannot be read; a key is unknown or outside its range; no such servo.
    """
    root = Table(read_toml(path), str(path))
    faults = Faults(
        name=root.text("name"),
        seed=root.integer("seed", 0, 2**32 - 1, default=0),
        rates={stream: _rates(root.table(stream)) for stream in STREAMS if stream in root},
        events=tuple(_event(table, ids) for table in root.tables("event")) if "event" in root else (),
    )
    for stream in STREAMS:
        root.table(stream, default={})  # known, if absent
    root.done()
    if not foot and ("foot" in faults.rates or any(_of_foot(event) for event in faults.events)):
        raise FileError("names the foot sensor; expected faults of servos alone: there is no lamp", str(path))
    return faults


def _of_foot(event: Event) -> bool:
    return "foot" in (event.what.partition("_")[0], event.stream, event.port)


def _rates(table: Table) -> Rates:
    chances = {damage: table.number(damage, 0.0, 1.0, default=0.0) for damage in DAMAGES}
    rates = Rates(**chances, late_by=table.number("late_by", 0.0, _LATEST, "s", default=Rates.late_by))
    table.done()
    total = sum(chances.values())
    if total > 1.0:
        raise table.fail("dropped", f"all chances together are {total:g}; expected no more than 1")
    return rates


def _event(table: Table, ids: tuple[int, ...]) -> Event:
    what = table.text("what", EVENTS)
    keys = EVENTS[what]
    values: dict[str, float | int | str] = {}
    if "stream" in keys and "packet" in table:
        values["packet"] = table.integer("packet", 1, 2**31)
    else:
        values["at"] = table.number("at", 0.0, _LONGEST, "s")
    if "stream" in keys:
        values["stream"] = table.text("stream", STREAMS, default="instruction")
        values["packets"] = table.integer("packets", 1, 2**31, default=1)
    if "lasts" in keys:
        values["lasts"] = table.number("lasts", _SHORTEST, _LONGEST, "s")
    if what == "late":
        values["lasts"] = table.number("late_by", 0.0, _LATEST, "s", default=Rates.late_by)
    if "servo" in keys:
        values["servo"] = table.integer("servo", 0, 252)
        if values["servo"] not in ids:
            raise table.fail("servo", f"{values['servo']} is not one of {', '.join(map(str, ids))}")
    if "id" in keys:
        values["id"] = table.integer("id", 0, 252, default=1)
    if "volts" in keys:
        values["volts"] = table.number("volts", 0.0, 20.0, "V")
    if "port" in keys:
        values["port"] = table.text("port", PORTS, default="servo")
    table.done()
    return Event(what, **values)  # type: ignore[arg-type]
