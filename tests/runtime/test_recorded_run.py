"""A run is recorded whatever lamp it is of, and the lamp is closed whatever happens."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from contract.backends import twin

from robolamp.errors import BusError, FileError
from robolamp.log.reader import read_run
from robolamp.runtime.recorded_run import Audience, RunLog, record_run
from robolamp.runtime.stop import StopRequest
from robolamp.signals import LampBackend, Tick

from .fake import LAMP, FakeLamp, Wave

CONTEXT = {"backend": "twin", "lamp": LAMP.source, "control_period": "0.02", "terminals": "t"}


class Paced(Wave):
    control_period = 0.02


class Servos:
    """What a lamp tells of its servos."""

    notices, mended, answer_wire_time = ["one servo is warm"], ["knee: a delay"], 0.0012

    def settings(self) -> dict[str, dict[str, int]]:
        return {"knee": {"Position P Gain": 640}}


def recorded(backend: LampBackend, path: Path, **more: object) -> list[str]:
    heard: list[str] = []
    ticks: list[Tick] = []

    @contextlib.contextmanager
    def audience() -> Iterator[Audience]:
        heard.append("there")
        yield Audience(ticks.append, lambda level, text: heard.append(text))
        heard.append("gone")

    result = record_run(
        backend, Paced(), LAMP, RunLog(path, CONTEXT, 0), duration=0.4, stop=StopRequest(), audience=audience, **more
    )  # fmt: skip
    assert result.ended == "finished"
    assert result.ticks == len(ticks) == read_run(path).index.size
    return heard


@pytest.mark.parametrize("kind", ["fake", "twin"])
def test_any_lamp_is_recorded(kind: str, tmp_path: Path) -> None:
    with contextlib.nullcontext(FakeLamp()) if kind == "fake" else twin() as lamp:
        heard = recorded(lamp, tmp_path / "log.mcap")
        assert not lamp.observe().health.torque.any()
    assert heard == ["there", "torque on", "run", "landing", "torque off; finished", "gone"]
    run = read_run(tmp_path / "log.mcap")
    assert [text for _, _, text in run.events] == heard[1:-1]
    assert (run.phase == "run").sum() == 20


def test_the_log_keeps_what_the_servos_are_set_to(tmp_path: Path) -> None:
    heard = recorded(FakeLamp(), tmp_path / "log.mcap", inspected=Servos())
    assert heard[1:3] == ["mended: knee: a delay", "one servo is warm"]
    run = read_run(tmp_path / "log.mcap")
    assert run.answer_wire == 0.0012
    assert "640" in run.context["servo_settings"]
    assert [(level, text) for _, level, text in run.events][:2] == [("warning", heard[1]), ("info", heard[2])]


def test_a_lamp_that_cannot_be_recorded_is_closed(tmp_path: Path) -> None:
    class Closing(FakeLamp):
        closed, refuses = False, False

        def open(self) -> None:
            if self.refuses:
                raise BusError("no answer")

        def close(self) -> None:
            super().close()
            self.closed = True

    lamp = Closing()
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="cannot be written"):
        recorded(lamp, tmp_path / "file" / "log.mcap")
    assert lamp.closed
    assert not lamp.goals
    lamp = Closing()
    lamp.refuses = True
    with pytest.raises(BusError, match="no answer"):
        recorded(lamp, tmp_path / "log.mcap")
    assert lamp.closed
    assert not (tmp_path / "log.mcap").exists()


def test_a_log_that_ends_early_is_told_of_and_the_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[tuple[str, str]] = []
    path = tmp_path / "log.mcap"

    def encode(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("robolamp.log.writer.LogWriter._encode", encode)
    result = record_run(
        FakeLamp(), Paced(), LAMP, RunLog(path, CONTEXT, 0), duration=0.4, stop=StopRequest(),
        audience=lambda: contextlib.nullcontext(Audience(event=lambda *event: heard.append(event))),
    )  # fmt: skip
    assert (result.ended, result.log_error) == ("finished", "No space left on device")
    assert result.faults == {"log: No space left on device": 1}
    assert heard.count(("error", f"logging stopped, the run goes on: {path}: No space left on device")) == 1
