"""Programs: expressions flattened for a stack machine, with two interpreters that agree to the bit.

A program is a list of operation codes in reverse prefix order: constants and terminals push, a primitive pops its
arguments (the first one on top) and pushes its value. `Program.run` evaluates one lane in Python, so that a lamp needs
no compiler; `ProgramSet.run` evaluates many lanes with numba. Both do the same IEEE double operations in the same
order; both branches of `ifltz` are evaluated, which changes nothing because expressions have no side effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.expression import Expression
from robolamp.controller.primitives import OPCODES, PRIMITIVES
from robolamp.errors import ExpressionError

_CONSTANT = len(OPCODES)
_TERMINAL = _CONSTANT + 1
_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _IF = (OPCODES[name] for name in ("+", "-", "*", "%", "ifltz"))


@dataclass(frozen=True)
class Program:
    """One controller, ready to run: one expression a joint.

    Attributes:
        terminals: Names of the inputs, in the order that `run` takes them.
        code: Operation codes of all joints, one joint after the other, shape (k,).
        operand: For each code the constant, or the terminal's index, shape (k,).
        ends: Where each joint's codes end, shape (n,).
        stack: Stack cells the deepest joint needs.
    """

    terminals: tuple[str, ...]
    code: NDArray[np.int32]
    operand: NDArray[np.float64]
    ends: NDArray[np.int64]
    stack: int

    def run(self, inputs: Sequence[float]) -> list[float]:
        """Evaluate one lane.

        Args:
            inputs: Terminal values, in the order of `terminals`.

        Returns:
            One value a joint: a joint angle [rad], which may be NaN, infinite or out of reach.
        """
        outputs, stack, start = [], [], 0
        code, operand = self.code.tolist(), self.operand.tolist()
        for end in self.ends.tolist():
            for index in range(start, end):
                op = code[index]
                if op == _CONSTANT:
                    stack.append(operand[index])
                elif op == _TERMINAL:
                    stack.append(float(inputs[int(operand[index])]))
                elif op == _IF:
                    a, b, c = stack.pop(), stack.pop(), stack.pop()
                    stack.append(b if a < 0.0 else c)
                else:
                    a, b = stack.pop(), stack.pop()
                    if op == _ADD:
                        stack.append(a + b)
                    elif op == _SUBTRACT:
                        stack.append(a - b)
                    elif op == _MULTIPLY:
                        stack.append(a * b)
                    else:
                        stack.append(1.0 if b == 0.0 else a / b)
            outputs.append(stack.pop())
            start = end
        return outputs


def compile_program(expressions: Sequence[Expression], terminals: Sequence[str]) -> Program:
    """Flatten expressions into a program.

    Args:
        expressions: One a joint.
        terminals: Names of the inputs that will be supplied.

    Raises:
        ExpressionError: An expression reads a terminal that will not be supplied.
    """
    index_of = {name: index for index, name in enumerate(terminals)}
    code: list[int] = []
    operand: list[float] = []
    ends: list[int] = []
    deepest = 0
    for expression in expressions:
        height = 0
        for token in reversed(expression.tokens):
            if not isinstance(token, str):
                code.append(_CONSTANT)
                operand.append(token)
                height += 1
            elif token in PRIMITIVES:
                code.append(OPCODES[token])
                operand.append(0.0)
                height -= PRIMITIVES[token].arity - 1
            elif token in index_of:
                code.append(_TERMINAL)
                operand.append(float(index_of[token]))
                height += 1
            else:
                raise ExpressionError(f"terminal {token!r} is not supplied; supplied are: {' '.join(terminals)}")
            deepest = max(deepest, height)
        ends.append(len(code))
    return Program(tuple(terminals), np.array(code, np.int32), np.array(operand), np.array(ends, np.int64), deepest)


class ProgramSet:
    """Many programs over the same terminals and joints, for many lanes at once.

    Args:
        programs: At least one; all with the same terminals and number of joints.
    """

    def __init__(self, programs: Sequence[Program]) -> None:
        self.terminals = programs[0].terminals
        self.code = np.concatenate([program.code for program in programs])
        self.operand = np.concatenate([program.operand for program in programs])
        offsets = np.cumsum([0] + [len(program.code) for program in programs[:-1]])
        self.ends = np.stack([program.ends + offset for program, offset in zip(programs, offsets, strict=True)])
        self.starts = np.concatenate([offsets[:, None], self.ends[:, :-1]], axis=1)
        self.stack = max(program.stack for program in programs)

    @property
    def read(self) -> frozenset[str]:
        """Names of the terminals that at least one of them reads."""
        return frozenset(self.terminals[int(index)] for index in np.unique(self.operand[self.code == _TERMINAL]))

    def run(
        self, program: NDArray[np.int64], inputs: NDArray[np.float64], outputs: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Evaluate many lanes.

        Args:
            program: Which program each lane runs, shape (lanes,).
            inputs: Terminal values, shape (lanes, terminals).
            outputs: Written to, shape (lanes, joints) [rad].

        Returns:
            `outputs`.
        """
        from robolamp.controller.kernels import run_lanes  # noqa: PLC0415 (numba loads slowly; a lamp never needs it)

        run_lanes(np.arange(len(program)), *self.arguments(program, inputs, outputs))
        return outputs

    def arguments(
        self, program: NDArray[np.int64], inputs: NDArray[np.float64], outputs: NDArray[np.float64]
    ) -> tuple[Any, ...]:
        """Return what `kernels.run_lanes` takes beside the lanes, for kernels that call it themselves; see `run`."""
        return self.code, self.operand, self.starts, self.ends, program, inputs, outputs, self.stack
