"""Runs the firmware on CPython, which has MicroPython's clock and keyboard interrupt under no name."""

import runpy
import sys
import time
import types

WRAP = 1 << 30  # as on the Pico

time.ticks_us = lambda: time.monotonic_ns() // 1000 % WRAP
time.ticks_add = lambda a, b: (a + b) % WRAP
time.ticks_diff = lambda a, b: (a - b + WRAP // 2) % WRAP - WRAP // 2


class Unbuffered:
    """MicroPython's stdout has no buffer in between."""

    buffer = sys.stdout.buffer.raw
    fileno = sys.stdout.fileno


sys.stdout = Unbuffered()
micropython = types.ModuleType("micropython")
micropython.kbd_intr = lambda _: None
sys.modules["micropython"] = micropython
runpy.run_path(sys.argv[1])
