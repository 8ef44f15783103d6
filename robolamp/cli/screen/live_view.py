"""What a person sees while a lamp runs: progress, hops, force, faults, a line that rewrites itself."""

from __future__ import annotations

import math
from collections.abc import Callable

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from robolamp.lamp import Lamp
from robolamp.signals import Tick

_EVERY = 5  # ticks between drawings: ten a second at 50 Hz
_BAR, _FULL_FORCE = 24, 8.0  # characters, and the force that fills them: about four times the lamp's weight [N]
_PHASES = {"start": "soft start", "landing": "soft landing"}  # in "run" it is what drives
_TITLE = 12  # characters


class _Console(Console):
    """One that tells of a broken pipe like of any other failure, instead of ending the process."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


class LiveView:
    """Draws a run in the terminal; where there is none, prints its events as lines.

    A terminal that goes away must not end a run: from then on nothing is drawn, and nothing here ever raises.

    Args:
        lamp: The lamp.
        goal: Commanded distance [m]; NaN: there is none.
        duration: Length of the run phase [s].
        quiet: Draw nothing (for `--json`).
        keys: Whether stop keys are listened to.
        doing: What it does in phase "run".
    """

    def __init__(
        self, lamp: Lamp, goal: float, duration: float, quiet: bool, *, keys: bool = False, doing: str = "hopping"
    ) -> None:
        self._console = _Console(stderr=True, quiet=quiet, highlight=False)
        self._lamp, self._goal, self._duration, self._doing = lamp, goal, duration, doing
        self._keys = "q, Space, Esc or Ctrl-C" if keys else "Ctrl-C"
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._drawing = self._console.is_terminal and not quiet
        self._elapsed = 0.0  # time that the controller has driven [s]
        self._driven: float | None = None  # when it last did [s]; None: it does not
        self._faults = 0

    def __enter__(self) -> LiveView:
        if self._drawing:
            self._guarded(self._live.start)
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawing:
            self._guarded(self._live.stop)

    def tick(self, tick: Tick) -> None:
        """Take a tick; draws some of them, after the goals were sent."""
        driven = tick.scheduled if tick.phase == "run" else None
        if driven is not None and self._driven is not None:
            self._elapsed += driven - self._driven
        self._driven = driven
        self._faults += len(tick.observation.faults)
        if self._drawing and tick.index % _EVERY == 0:
            self._guarded(lambda: self._live.update(self._picture(tick), refresh=True))

    def event(self, level: str, text: str) -> None:
        """Take an event; warnings and errors stay on the screen."""
        if level != "info" or not self._drawing:
            style = {"warning": "yellow", "error": "red"}.get(level, "dim")
            self._guarded(lambda: self._console.print(Text(f"  {text}", style=style), soft_wrap=True))

    def _guarded(self, show: Callable[[], object]) -> None:
        try:
            show()
        except Exception:  # the terminal is gone or cannot show the characters, and rich stumbles over that in turn
            self._console.quiet = True

    def _picture(self, tick: Tick) -> Table:
        grid = Table.grid(padding=(0, 2))
        grid.add_column(width=_TITLE)
        grid.add_column()
        elapsed = min(self._elapsed, self._duration)
        filled = round(_BAR * elapsed / self._duration)
        share = "█" * filled + "░" * (_BAR - filled)
        way = "" if math.isnan(self._goal) else f" to {self._goal:.2f} m"
        doing = _PHASES.get(tick.phase, self._doing)[:_TITLE]
        grid.add_row(doing, f"{share} {elapsed:4.1f} of {self._duration:.1f} s{way}")
        force = tick.observation.foot_force
        pushed = round(_BAR * min(max(force, 0.0) / _FULL_FORCE, 1.0)) if math.isfinite(force) else 0
        pressed = "▮" * pushed + "·" * (_BAR - pushed)
        grid.add_row("foot", f"{pressed} {force:5.2f} N{'' if tick.contact else '  in the air'}")
        angles = "  ".join(
            f"{name} {angle:+.2f}" for name, angle in zip(self._lamp.names, tick.observation.angle, strict=True)
        )
        grid.add_row("joints", f"{angles} rad")
        grid.add_row("hops", f"{tick.hops}   interventions {tick.interventions.total}   faults {self._faults}")
        if tick.way is not None:
            grid.add_row(
                "way", f"{tick.way.length * 100:5.1f} cm by the odometer, give or take {tick.way.stderr * 100:.1f}"
            )
        grid.add_row("to stop", f"{self._keys} lands it softly; Ctrl-C again: torque off at once")
        return grid
