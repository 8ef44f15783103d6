"""The live view: what it says, and that a terminal that goes away never ends a run."""

from __future__ import annotations

import io
import os
import sys

import numpy as np
import pytest

from robolamp.assets import Assets
from robolamp.cli.screen.live_view import LiveView
from robolamp.lamp import load_lamp
from robolamp.signals import Health, Observation, Tick

LAMP = load_lamp(Assets())


def tick(index: int) -> Tick:
    zero = np.zeros(3)
    seen = Observation(0.0, zero, zero, zero, zero, 2.0, 0.0, Health.unknown(3))
    return Tick(index, "run", 0.02 * index, 0.0, 0.0, 0.0, seen, zero)


def watch(view: LiveView) -> None:
    with view:
        view.event("info", "run")
        for index in range(11):
            view.tick(tick(index))
        view.event("error", "torque off")


class Dead(io.StringIO):
    """A stream that fails as a terminal that was closed."""

    def __init__(self, error: Exception, terminal: bool, alive: int) -> None:
        super().__init__()
        self.error, self.terminal, self.alive = error, terminal, alive

    def isatty(self) -> bool:
        return self.terminal

    def write(self, text: str) -> int:
        self.alive -= 1
        if self.alive < 0:
            raise self.error
        return len(text)


@pytest.mark.parametrize("alive", [0, 1, 3])
@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize(
    "error", [OSError(5, "Input/output error"), BrokenPipeError(), ValueError("I/O operation on closed file")]
)
def test_a_dead_stderr_is_met_in_silence(
    monkeypatch: pytest.MonkeyPatch, error: Exception, terminal: bool, alive: int
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Dead(error, terminal, alive))
    out, err = sys.stdout, sys.stderr
    watch(LiveView(LAMP, 0.3, 1.0, False))
    assert sys.stdout is out
    assert sys.stderr is err


def test_a_pipe_without_a_reader_is_met_in_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pipe()
    os.close(read)
    stream = os.fdopen(write, "w", buffering=1)
    monkeypatch.setattr(sys, "stderr", stream)
    watch(LiveView(LAMP, 0.3, 1.0, False))
    with pytest.raises(BrokenPipeError):
        stream.close()


def test_an_event_is_one_line_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    text = "[/b] knee: " + "no answer " * 20 + "[red]"
    with LiveView(LAMP, 0.3, 1.0, False) as view:
        view.event("warning", text)
    assert capsys.readouterr().err == f"  {text}\n"
