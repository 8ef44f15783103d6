"""Runs command lines one after the other in a process of bounded memory; prints what each said, as JSON lines."""

from __future__ import annotations

import contextlib
import io
import json
import resource
import signal
import sys

from robolamp.cli.main import main

SECONDS = 20
ROOM = 3 << 30  # of address space beyond what the libraries take [bytes]


def _stop(*_: object) -> None:
    raise TimeoutError


def run(words: list[str]) -> dict[str, object]:
    out, err = io.StringIO(), io.StringIO()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.alarm(SECONDS)
    code: object = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main(words)
    except SystemExit as ended:
        code = ended.code
    except BaseException as error:  # what a user would see as a traceback, or would wait for in vain
        code = f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return {"words": words, "code": code, "out": out.getvalue(), "err": err.getvalue(), "kilobytes": more}


if __name__ == "__main__":
    import robolamp.calibrate.servo.servo_fit
    import robolamp.compare.compare_logs
    import robolamp.emulator.emulated_lamp
    import robolamp.evolve.evolution  # noqa: F401 (what the verbs load, before memory is measured)

    signal.signal(signal.SIGALRM, _stop)
    with open("/proc/self/statm", encoding="ascii") as statm:  # noqa: PTH123
        taken = int(statm.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + ROOM, taken + ROOM))
    for line in sys.stdin:
        print(json.dumps(run(json.loads(line))), flush=True)
