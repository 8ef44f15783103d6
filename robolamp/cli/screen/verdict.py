"""The three answers of a comparison, as dry-run and deploy show them on the screen."""

from __future__ import annotations

from robolamp.cli.screen.output import counted
from robolamp.compare.comparison import Comparison
from robolamp.compare.report.comparison_page import sentence, three


def told(comparison: Comparison) -> tuple[str, str]:
    """Return the three answers for the screen: the task in a word, and everything after it, a line each.

    Args:
        comparison: Of the run.
    """
    (_, word, why), (_, verdict, reasons), (_, alone, did) = three(comparison)
    lines = [
        f" {why}",
        f"Twin, replaying the goal angles that the lamp was sent: {verdict.lower()}. {reasons} {sentence(comparison)}",
        f"Controller alone on the twin: {alone.lower()}. {did}",
    ]
    if comparison.diagnosis:
        first, others = comparison.diagnosis[0], len(comparison.diagnosis) - 1
        more = f"; {counted(others, 'more cause')} in the report" if others else ""
        lines.append(f"What is different, likeliest: {first.cause} ({first.explains}){more}.")
    if comparison.way is not None:
        lines.append(f"Odometer: {comparison.way.text}")
    return f"{word}.", "\n".join(lines)
