"""Foot sensor of the lamp: samples the force 500 times a second and sends each as a frame over USB (README.md).

For a Raspberry Pi Pico with MicroPython: copy main.py, frames.py and sensor.py to it. It starts by itself.
"""

import select
import sys
import time

import micropython
from frames import PERIOD, Frames
from machine import ADC
from sensor import Fsr


def run(sensor, stream, writable):
    """Send frames for ever.

    Args:
        sensor: An object with sample().
        stream: Where frames go.
        writable: Says whether the stream takes one now; a frame that nobody takes is lost, and its number with it.
    """
    frames = Frames()
    due = time.ticks_us()
    clock = 0  # unwrapped [us]: ticks_us() may wrap before 2^32
    last = due
    while True:
        while time.ticks_diff(due, time.ticks_us()) > 0:
            pass
        now = time.ticks_us()
        clock += time.ticks_diff(now, last)
        last = now
        force, status = sensor.sample()
        frame = frames.build(clock, force, status)
        if writable():
            stream.write(frame)
        skipped = time.ticks_diff(time.ticks_us(), due) // PERIOD
        frames.sequence += skipped
        due = time.ticks_add(due, PERIOD * (skipped + 1))


def main():
    """Set up the converter and the port, and send."""
    micropython.kbd_intr(-1)  # a byte 3 from the host is no Ctrl-C
    poller = select.poll()
    poller.register(sys.stdout, select.POLLOUT)
    run(Fsr([ADC(26), ADC(27), ADC(28)]), sys.stdout.buffer, lambda: poller.poll(0))


main()
