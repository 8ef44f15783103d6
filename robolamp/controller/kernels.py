"""The many-lane interpreter, compiled by numba. Without fastmath, so that it agrees with `Program.run` to the bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.envelope import bounded
from robolamp.controller.primitives import OPCODES
from robolamp.jit import njit

_CONSTANT = len(OPCODES)
_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _IF = (OPCODES[name] for name in ("+", "-", "*", "%", "ifltz"))
_bounded = njit(nogil=True, fastmath=False, error_model="numpy")(bounded)


@njit(nogil=True, fastmath=False, error_model="numpy")
def run_lanes(
    lanes: NDArray[np.int64],
    code: NDArray[np.int32],
    operand: NDArray[np.float64],
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    program: NDArray[np.int64],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    depth: int,
) -> None:
    """Evaluate lanes' programs, each on its row of inputs.

    Args:
        lanes: Which lanes.
        code: Operation codes of all programs, shape (k,).
        operand: Constants and terminal indices, shape (k,).
        starts: First code of each program's joints, shape (programs, joints).
        ends: End of the codes of each program's joints, shape (programs, joints).
        program: Each lane's program, shape (lanes,).
        inputs: Terminal values, shape (lanes, terminals).
        outputs: Written to, shape (lanes, joints).
        depth: Stack cells needed.
    """
    stack = np.empty(depth)
    for lane in lanes:
        own = program[lane]
        for joint in range(starts.shape[1]):
            top = 0
            for index in range(starts[own, joint], ends[own, joint]):
                op = code[index]
                if op == _CONSTANT:
                    stack[top] = operand[index]
                    top += 1
                elif op > _CONSTANT:
                    stack[top] = inputs[lane, int(operand[index])]
                    top += 1
                elif op == _IF:
                    top -= 2
                    stack[top - 1] = stack[top] if stack[top + 1] < 0.0 else stack[top - 1]
                else:
                    top -= 1
                    a, b = stack[top], stack[top - 1]
                    if op == _ADD:
                        stack[top - 1] = a + b
                    elif op == _SUBTRACT:
                        stack[top - 1] = a - b
                    elif op == _MULTIPLY:
                        stack[top - 1] = a * b
                    elif b == 0.0:
                        stack[top - 1] = 1.0
                    else:
                        stack[top - 1] = a / b
            outputs[lane, joint] = stack[0]


@njit(nogil=True, fastmath=False, error_model="numpy")
def bound_lanes(
    lanes: NDArray[np.int64],
    wanted: NDArray[np.float64],
    goal: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    step: NDArray[np.float64],
    interventions: NDArray[np.int64],
) -> None:
    """Keep the goals of many lanes to `bounded`, the lamp's envelope.

    Args:
        lanes: Which lanes.
        wanted: What the controllers ask for, shape (lanes, joints).
        goal: Goals as sent last; written to, shape (lanes, joints).
        lower: Smallest goals, shape (joints,).
        upper: Largest goals, shape (joints,).
        step: Largest change of a goal in a control period, shape (joints,).
        interventions: What had to be changed so far; written to, shape (lanes,).
    """
    for lane in lanes:
        for joint in range(wanted.shape[1]):
            goal[lane, joint], lost, limited, slewed = _bounded(
                wanted[lane, joint], goal[lane, joint], lower[joint], upper[joint], step[joint]
            )
            interventions[lane] += int(lost) + int(limited) + int(slewed)


# In one call: the way from Python into a kernel costs as much as the kernel does for a lane or two.
@njit(nogil=True, fastmath=False, error_model="numpy")
def command_lanes(lanes: NDArray[np.int64], run: tuple[Any, ...], bound: tuple[Any, ...]) -> None:
    """Evaluate lanes' programs and bound what they ask for.

    Args:
        lanes: Which lanes.
        run: What `run_lanes` takes beside them.
        bound: What `bound_lanes` takes beside them.
    """
    run_lanes(lanes, *run)
    bound_lanes(lanes, *bound)
