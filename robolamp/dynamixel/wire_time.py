"""How long what a tick sends and hears is on the line: one count of bytes, for everyone who reckons with it.

Instruction packets have 10 bytes around their parameters, status packets 11 around their data, and a block of a fast
reply 4 (https://emanual.robotis.com/docs/en/dxl/protocol2/, "Instruction Packet", "Status Packet", "Sync Read",
"Fast Sync Read", "Sync Write"). Bytes stuffed are not counted.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from robolamp.dynamixel.fast_sync_read import FastReply
from robolamp.dynamixel.health_block import LENGTHS
from robolamp.dynamixel.port import line_time

STATE = (124, 23)
"""Address and length of Present PWM ... Present Temperature, the same in every model."""

CONDITION = (64, 7)
"""Address and length of Torque Enable ... Hardware Error Status, the same in every model."""

_INSTRUCTION, _STATUS = 10, 11  # bytes around parameters, and around data
_ADDRESS = 2  # the first parameter of a write
_SPAN = 4  # address and length, the first parameters of a sync instruction
_GOAL = 1 + 4  # id and Goal Position(116)


class Transport(StrEnum):
    """How a reading is made."""

    FAST = "fast sync read of the health block"
    BLOCK = "sync read of the health block"
    DIRECT = "two sync reads"


Part = Literal["question", "reading", "goals", "tick", "switch"]


def wire_time(part: Part, n: int, baud: int, transport: Transport = Transport.DIRECT) -> float:
    """Return how long a part of a tick is on the line [s], without pauses.

    Args:
        part: "question": the first one of a reading; when it ends, the servos look at their encoders. "reading": its
            questions and answers; of lengths that take turns, the mean. "goals": the sync write of goals, at whose end
            servos take them. "tick": a reading and goals. "switch": a write of one byte to one servo, as Torque Enable.
        n: How many servos it is for, one for a switch.
        baud: Of the line [1/s].
        transport: How the reading is made; the slowest unless given, which a servo that lost its health block needs.
    """
    question = _INSTRUCTION + _SPAN + n
    goals = _INSTRUCTION + _SPAN + n * _GOAL
    block = sum(LENGTHS) / len(LENGTHS)
    if part == "question":
        count = float(question)
    elif part == "goals":
        count = float(goals)
    elif part == "switch":
        count = float(_INSTRUCTION + _ADDRESS + 1)
    elif transport is Transport.FAST:
        count = question + FastReply.HEAD + n * (FastReply.block(0) + block)
    elif transport is Transport.BLOCK:
        count = question + n * (_STATUS + block)
    else:
        longer = 0.5  # every other reading of STATE is longer by a byte
        count = 2 * question + n * (2 * _STATUS + STATE[1] + longer + CONDITION[1])
    if part == "tick":
        count += goals
    return line_time(count, baud)
