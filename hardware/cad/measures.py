"""Measures of what is bought, and of what fits round it; no kernel needed.

The XL330's are those of the maker's drawing "XL,XC-330" (28 May 2020) as public transcriptions and a public STEP give
them: body 20 x 34 x 23 mm, horn and rear idler 16 mm across and 3 mm high, each with four 1.6 mm holes on a circle of
12 mm; frame holes 16 x 30 mm, with 2 mm lead-ins of 3.5 mm (horn's face) and 4.5 mm (back).
"""

from __future__ import annotations

import math

# XL330, in its own frame: the axis is y, the horn at +y, the long side along z.
CASE_WIDTH, CASE_DEPTH = 20.0, 23.0
CASE_NEAR, CASE_FAR = 9.5, 24.5  # from the axis to either end
CASE_MIDDLE = (CASE_FAR - CASE_NEAR) / 2  # of the case, from the axis
HORN_RADIUS, HORN_HEIGHT = 8.0, 3.0
HORN_FACE = CASE_DEPTH / 2 + HORN_HEIGHT
HORN_CIRCLE = 6.0  # radius, of the four holes
FRAME_HOLES = ((8.0, -7.5), (-8.0, -7.5), (8.0, 22.5), (-8.0, 22.5))  # x and z, on either face
SERVO_MASS, HORN_MASS, IDLER_MASS = 18.0, 0.9, 1.0  # g; the first with its horn (e-manual); the others estimated

# Screws: pan-head, thread-forming, for plastic (the servo's own). Heads after JIS B 1122; an M2 x 8 weighs about 0.2 g.
SCREW_HEAD_RADIUS, SCREW_HEAD = 1.9, 1.4
FRAME_SCREW, HORN_SCREW = 8.0, 6.0  # lengths
SCREW_HOLE = 1.05  # radius, through a printed part
SCREW_PILOT = 0.85  # radius, to cut its thread in
DRIVER_RADIUS = 2.2
STEEL = 7.85  # g/cm3
ALUMINIUM = 2.70  # g/cm3

# What holds a servo (joint.py) and follows from it.
CRADLE_GAP = 0.2  # between case and cradle at the far end
CRADLE_HALF_WIDTH = 10.5
SOCKET = 10.0  # length of the end piece with the sockets of the tubes
SWEEP = math.hypot(CRADLE_HALF_WIDTH, 9.9)  # radius that the corners of servo and cradle sweep about the axis

CABLE_MASS = 2.5  # g: an X3P of 180 mm with its plugs; estimated
PICO_MASS = 4.0  # g: a Pico (3 g) with resistors, capacitors and wires
FSR_MASS = 0.35  # g
PICO = (21.0, 51.0, 1.0)
FSR_RADIUS, FSR_HEIGHT = 9.15, 0.45
