"""Layout: expressions over many lines, each branch of an `ifltz` on a line of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robolamp.controller.expression import Expression, Token, subtree_end
from robolamp.controller.primitives import PRIMITIVES

_STEP = 2  # columns that an argument is indented by; a condition that takes lines of its own, twice that


@dataclass(frozen=True)
class Line:
    """One line of a laid out expression.

    Attributes:
        text: What is written, indented.
        begins: Where a branch begins on this line: the token of its `ifltz`, and which argument it is (1: taken where
            the condition is negative, 2: otherwise). None elsewhere.
    """

    text: str
    begins: tuple[int, int] | None


def lay_out(expression: Expression, width: int) -> tuple[Line, ...]:
    """Return an expression's text over as many lines as it needs; joined, they parse to the same expression.

    Args:
        expression: What to write.
        width: Columns to stay within, unless it is nested too deeply for that.
    """
    lines: list[Line] = []
    _add(expression.tokens, 0, 0, None, width, lines)
    return tuple(lines)


def _add(
    tokens: Sequence[Token], start: int, indent: int, begins: tuple[int, int] | None, width: int, lines: list[Line]
) -> None:
    """Append the lines of the subtree at `start`; `width` leaves room for the brackets that follow it."""
    text = _inline(tokens, start, width - indent)
    if text is not None:
        lines.append(Line(" " * indent + text, begins))
        return
    name = str(tokens[start])
    head, argument, index = f"{' ' * indent}({name}", start + 1, 0
    text = _inline(tokens, argument, width - len(head) - 1)
    if text is not None:
        head, argument, index = f"{head} {text}", subtree_end(tokens, argument), 1
    lines.append(Line(head, begins))
    arity = PRIMITIVES[name].arity
    while index < arity:
        branch = (start, index) if name == "ifltz" and index else None
        deeper = indent + _STEP * (2 if name == "ifltz" and not index else 1)
        _add(tokens, argument, deeper, branch, width - (index + 1 == arity), lines)
        argument, index = subtree_end(tokens, argument), index + 1
    lines[-1] = Line(f"{lines[-1].text})", lines[-1].begins)


def _inline(tokens: Sequence[Token], start: int, room: int) -> str | None:
    """Return the text of a subtree if it goes on one line: it branches nowhere and fits, or cannot be split."""
    own = tokens[start : subtree_end(tokens, start)]
    if "ifltz" in own:
        return None
    text = str(Expression(tuple(own)))
    return text if len(text) <= room or len(own) == 1 else None
