"""`robolamp log`: shows what a log holds, writes it as a table, saves what is left of a broken one."""

from __future__ import annotations

import datetime
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from robolamp.cli.screen.output import counted, print_json
from robolamp.errors import FileError, on_one_line

if TYPE_CHECKING:
    from robolamp.log.summary import Summary

_SHOWN = 5  # gaps, faults and events that are listed; --json has all
_TEXTS = ("controller", "gesture", "sequence", "lamp", "calibration")  # of the context: whole files

app = App(name="log", help_format="plaintext", result_action="return_value")
Json = Annotated[bool, Parameter(name="--json", negative="")]


@app.command
def info(log: Path, /, *, text: str | None = None, as_json: Json = False) -> int:
    """Show what a log holds: duration, ticks, gaps, faults, events, context, and whether it is whole.

    Args:
        log: The log (.mcap): of a lamp, of its twin, or the truth log of an emulated lamp.
        text: Print only one text that the run was made with: controller, gesture, sequence, lamp or calibration.
        as_json: Print one JSON object, with every gap, fault and event, and everything the run was made with.
    """
    from robolamp.log.summary import summarise

    summary = summarise(_file(log))
    if text is not None:
        if text not in summary.context:
            has = ", ".join(sorted(summary.context)) or "no context"
            raise FileError(f"has no {text!r}; it has {has}", str(log))
        if as_json:
            print_json({text: summary.context[text]})
        else:
            sys.stdout.write(summary.context[text].rstrip("\n") + "\n")
    elif as_json:
        print_json(_as_dict(summary))
    else:
        print(_told(summary))
    return 0


@app.command
def export(
    log: Path, /, *, output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None, as_json: Json = False
) -> int:
    """Write a log as a table, one row for each tick: CSV, or Parquet with `pip install 'robolamp[parquet]'`.

    A tick is one turn of the loop: read, compute, send. The columns' names say their units; docs/logs.md lists them.
    For a twin's log the rows are the twin's ticks.

    Args:
        log: The log (.mcap).
        output: The table: .csv or .parquet; by default a .csv beside the log, with its name.
        as_json: Print one JSON object.
    """
    from robolamp.log.mcap_stream import read_contents
    from robolamp.log.reader import prefix_in, run_of
    from robolamp.log.run_table import check_format
    from robolamp.log.run_table import export as write_table

    table = output or log.with_suffix(".csv")
    check_format(table)
    contents = read_contents(_file(log))
    run = run_of(contents, prefix_in(contents))
    columns = write_table(run, table)
    if as_json:
        print_json({"table": table, "rows": run.index.size, "columns": columns, "truncated": run.truncated})
    else:
        print(f"{table}: {counted(run.index.size, 'row')}, {counted(len(columns), 'column')}")
    return 0


@app.command
def recover(
    log: Path, /, *, output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None, as_json: Json = False
) -> int:
    """Write what is left of a log that was cut off or damaged as a whole log, which any MCAP reader opens.

    It keeps every undamaged chunk, also those behind a damaged place. If only the writer was killed, robolamp's own
    verbs need no recovery: they read the log as it is.

    Args:
        log: The log (.mcap).
        output: The log to write; by default LOG.recovered.mcap beside the log.
        as_json: Print one JSON object.
    """
    from robolamp.log.recover import recover as write_recovered

    found = write_recovered(_file(log), output or log.with_suffix(".recovered.mcap"))
    if as_json:
        print_json(
            {"log": found.file, "messages": found.messages, "left_out": found.unknown, "damage": list(found.damage)}
        )
        return 0
    for line in found.damage or ["nothing was wrong with it"]:
        print(f"{log}: {line}")
    lost = f"; {counted(found.unknown, 'message')} of lost topics left out" if found.unknown else ""
    print(f"{found.file}: {counted(sum(found.messages.values()), 'message')}{lost}")
    return 0


def _file(log: Path) -> Path:
    if not log.name:
        raise FileError("is a folder; expected a log (.mcap)", str(log))
    return log


def _as_dict(summary: Summary) -> dict[str, object]:
    return {
        "log": summary.path,
        "bytes": summary.size,
        "truncated": summary.truncated,
        "damage": summary.damage,
        "begin_unix_s": summary.begin * 1e-9,
        "duration_s": summary.duration,
        "ticks": summary.ticks,
        "phases": summary.phases,
        "control_period_s": summary.control_period,
        "missed_ticks": summary.missed_ticks,
        "clock_steps": [{"tick": tick, "by_s": by} for tick, by in summary.clock_steps],
        "gaps": [{"at_s": at, "length_s": length} for at, length in summary.gaps],
        "hops": summary.hops,
        "faults": summary.faults,
        "interventions": summary.interventions,
        "events": [{"at_s": at, "level": level, "text": text} for at, level, text in summary.events],
        "voltage_V": list(summary.voltage),
        "max_temperature_degC": summary.temperature,
        "max_current_A": summary.current,
        "topics": summary.topics,
        "context": summary.context,
    }


def _told(summary: Summary) -> str:
    context = summary.context
    begin = datetime.datetime.fromtimestamp(summary.begin * 1e-9).astimezone()
    lines = [
        ("log", f"{summary.path}, {summary.size / 1e6:.2f} MB, {'' if not summary.truncated else 'not '}whole"),
        *(("", line) for line in summary.damage),
        ("of", _origin(context)),
        ("from", f"{begin:%Y-%m-%d %H:%M:%S %z}, {summary.duration:.2f} s"),
    ]
    if summary.ticks:
        phases = ", ".join(f"{name} {count}" for name, count in summary.phases.items())
        rate = f"{1 / summary.control_period:g} Hz"
        lines += [
            ("ticks", f"{summary.ticks} at {rate} ({phases}), {summary.missed_ticks} missed"),
            *_listed("clock", [f"clock was set by {by:+.2f} s at tick {tick}" for tick, by in summary.clock_steps]),
            *_listed("gap", [f"{length * 1e3:.0f} ms at {at:.2f} s" for at, length in summary.gaps]),
            ("hops", f"{summary.hops}; the envelope intervened {counted(summary.interventions, 'time')}"),
            ("supply", f"{_span(*summary.voltage)} V, largest current {_number(summary.current)} A, "
                       f"hottest servo {_number(summary.temperature)} °C"),
            *_listed("fault", [f"{text} ({counted(count, 'tick')})" for text, count in summary.faults.items()]),
            *_listed("event", [f"{at:7.2f} s  {level}: {text}" for at, level, text in summary.events]),
        ]  # fmt: skip
    lines += [("topics", ", ".join(f"{name} {count}" for name, count in sorted(summary.topics.items())))]
    lines += [(name, context[name]) for name in ("versions", "command") if context.get(name)]
    texts = [name for name in _TEXTS if context.get(name)]
    if texts:
        lines += [("texts", f"{', '.join(texts)}: print one with --text")]
    return "\n".join(f"{title:<9}{on_one_line(line)}" for title, line in lines)


def _origin(context: dict[str, str]) -> str:
    names = [f"{key} {context[f'{key}_name']!r}" for key in _TEXTS if f"{key}_name" in context]
    goal = [f"goal {context['goal_m']} m"] if "goal_m" in context else []
    return ", ".join([context.get("backend", "unknown"), *names, *goal])


def _listed(title: str, lines: list[str]) -> list[tuple[str, str]]:
    listed = [(title if not index else "", line) for index, line in enumerate(lines[:_SHOWN])]
    more = len(lines) - _SHOWN
    return [*listed, ("", f"and {more} more; --json has them all")] if more > 0 else listed


def _span(low: float, high: float) -> str:
    return f"{_number(low)} to {_number(high)}"


def _number(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "unknown"
