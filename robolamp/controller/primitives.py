"""The functions that controller expressions are built from, closed over the floats (Koza 1992, section 6.1.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from robolamp.errors import ExpressionError


def protected_divide(a: float, b: float) -> float:
    """Return a / b, and 1 where b is 0 (Koza 1992, "protected division")."""
    return 1.0 if b == 0.0 else a / b


def if_less_than_zero(a: float, b: float, c: float) -> float:
    """Return b where a < 0, else c (so c where a is NaN)."""
    return b if a < 0.0 else c


@dataclass(frozen=True)
class Primitive:
    """A function of a fixed number of floats.

    Attributes:
        name: How it is written.
        arity: Number of arguments.
        function: The one-lane implementation; the many-lane one is in `program`.

    Raises:
        ExpressionError: The function is not closed: it does not give a float at zero or for negative arguments.
    """

    name: str
    arity: int
    function: Callable[..., float]

    def __post_init__(self) -> None:
        for probe in (0.0, -1.5, 2.5):
            try:
                value = self.function(*[probe] * self.arity)
            except (ArithmeticError, TypeError, ValueError) as error:
                raise ExpressionError(f"primitive {self.name}: not closed at {probe:g} ({error})") from None
            if not isinstance(value, float):
                raise ExpressionError(f"primitive {self.name}: gives {value!r} at {probe:g}, not a float")


# The position in this tuple is the operation code of a program.
_ALL = (
    Primitive("+", 2, lambda a, b: a + b),
    Primitive("-", 2, lambda a, b: a - b),
    Primitive("*", 2, lambda a, b: a * b),
    Primitive("%", 2, protected_divide),
    Primitive("ifltz", 3, if_less_than_zero),
)
PRIMITIVES: Mapping[str, Primitive] = {primitive.name: primitive for primitive in _ALL}
"""Every primitive by name, in the order of operation codes."""
OPCODES: Mapping[str, int] = {primitive.name: code for code, primitive in enumerate(_ALL)}
"""Operation code of each primitive."""
