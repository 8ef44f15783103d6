"""Where a run's controller comes from: evolved, tuned (a person's with other numbers), or written by hand."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from robolamp.controller.controller_file import BY_HAND, EVOLVED, TUNED, Controller
from robolamp.controller.expression import Expression


def marks(seeds: Sequence[Controller]) -> str:
    """Return marks by which a resumed run recognises the seeds that were not evolved; run.toml keeps them.

    Args:
        seeds: What a run begins with.
    """
    # A file of 0.1.0 does not say: without provenance it was written.
    written = [each for each in seeds if each.origin in (BY_HAND, TUNED) or not each.provenance]
    tuned = {True: f"/{TUNED}", False: ""}
    return " ".join(
        f"{_shape(each.expressions)}/{_whole(each.expressions)}{tuned[each.origin == TUNED]}" for each in written
    )


def origin_of(expressions: Sequence[Expression], marks: str) -> str:
    """Return how expressions were made, one of `robolamp.controller.controller_file.ORIGINS`.

    Args:
        expressions: A controller's.
        marks: Of the seeds.
    """
    known = {shape: more for shape, *more in (mark.split("/") for mark in marks.split())}
    more = known.get(_shape(expressions))
    if more is None:
        return EVOLVED
    whole, *tuned = more
    return TUNED if tuned or whole != _whole(expressions) else BY_HAND


def _shape(expressions: Sequence[Expression]) -> str:
    tokens = [[token if isinstance(token, str) else "?" for token in each.tokens] for each in expressions]
    return _digest("\n".join(" ".join(each) for each in tokens))


def _whole(expressions: Sequence[Expression]) -> str:
    return _digest("\n".join(map(str, expressions)))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
