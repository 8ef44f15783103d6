"""The pytest plugin of what mutants.py runs: which tests, in which order, how long they take, which lines they run.

MUTANTS_ORDER names a file with the tests to run, MUTANTS_FAILED, MUTANTS_TIMES and MUTANTS_LINES where to write.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_CALLS = 300  # of a function in a test: later ones are not watched, for time


class _Lines:
    """The lines of the copy's package that each test runs; what a wider fixture runs is its first test's."""

    def __init__(self) -> None:
        self._package = str(Path.cwd() / "robolamp") + "/"
        self._ran: dict[str, set[int]] = defaultdict(set)
        self._calls: Counter[Any] = Counter()
        self.of_tests: dict[str, dict[str, list[int]]] = {}

    def _enter(self, frame: Any, event: str, argument: Any) -> Any:
        name = frame.f_code.co_filename
        if not name.startswith(self._package):
            return None
        self._calls[frame.f_code] += 1
        if self._calls[frame.f_code] > _CALLS:
            return None
        ran = self._ran[name]

        def line(frame: Any, event: str, argument: Any) -> Any:
            ran.add(frame.f_lineno)
            return line

        return line

    def compiled(self, function: Any) -> None:
        """Take note of a compiled function that is called, and of those that it calls."""
        code, ran = function.py_func.__code__, self._ran[function.py_func.__code__.co_filename]
        if code.co_firstlineno in ran:
            return
        ran |= {code.co_firstlineno, *(line for _, _, line in code.co_lines() if line is not None)}
        for name in code.co_names:
            if hasattr(called := function.py_func.__globals__.get(name), "py_func"):
                self.compiled(called)

    @contextlib.contextmanager
    def of(self, test: str) -> Iterator[None]:
        self._ran, self._calls = defaultdict(set), Counter()
        threading.settrace(self._enter)
        sys.settrace(self._enter)
        try:
            yield
        finally:
            sys.settrace(None)
            threading.settrace(None)  # type: ignore[arg-type]
            root = str(Path.cwd()) + "/"
            own = {name: lines for name, lines in self._ran.items() if name.startswith(self._package)}
            self.of_tests[test] = {name.removeprefix(root): sorted(lines) for name, lines in own.items()}


_lines, _times, _failed = _Lines(), Counter[str](), list[str]()


def pytest_configure() -> None:
    """See compiled functions called, too."""
    if "MUTANTS_LINES" in os.environ:
        from numba.core.dispatcher import Dispatcher

        call = Dispatcher.__call__

        def seen(function: Any, *words: Any, **more: Any) -> Any:
            _lines.compiled(function)
            return call(function, *words, **more)

        Dispatcher.__call__ = seen


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of MUTANTS_ORDER, in its order."""
    if "MUTANTS_ORDER" in os.environ:
        rank = {test: index for index, test in enumerate(json.loads(Path(os.environ["MUTANTS_ORDER"]).read_text()))}
        items[:] = sorted((item for item in items if item.nodeid in rank), key=lambda item: rank[item.nodeid])


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """See which lines a test runs."""
    with _lines.of(item.nodeid) if "MUTANTS_LINES" in os.environ else contextlib.nullcontext():
        yield


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note how long a test takes, and the first that fails."""
    _times[report.nodeid] += report.duration
    if report.failed:
        _failed.append(report.nodeid)
        if "MUTANTS_FAILED" in os.environ:
            clock = "realtime" if "realtime" in report.keywords else ""
            Path(os.environ["MUTANTS_FAILED"]).write_text(f"{report.nodeid}\n{clock}")


def pytest_sessionfinish() -> None:
    """Write what was seen."""
    if "MUTANTS_TIMES" in os.environ:
        passed = {test: seconds for test, seconds in _times.items() if test not in _failed}
        Path(os.environ["MUTANTS_TIMES"]).write_text(json.dumps(passed))
    if "MUTANTS_LINES" in os.environ:
        Path(os.environ["MUTANTS_LINES"]).write_text(json.dumps(_lines.of_tests))
