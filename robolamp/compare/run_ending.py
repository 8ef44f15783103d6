"""How a run ended, by its log: whole, or cut before, while or after the controller drove."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robolamp.log.reader import Run

EARLY_ENDS = ("guard: ", "stopped: ", "torque off at once: ", "torque may still be on: ")
"""How the events begin that tell of a run which did not end as it should."""
_KILLED = "the log ends early: the process that wrote it was killed"


@dataclass(frozen=True)
class Ending:
    """How a run ended.

    Attributes:
        drove: How long the controller drove [s].
        cut: Why it did not drive to its end; empty: it did.
        after: What went wrong once it had; empty: nothing.
    """

    drove: float
    cut: str = ""
    after: str = ""

    @property
    def wrong(self) -> str:
        """Return what went wrong, in a sentence; empty: nothing."""
        if not self.cut:
            return f"ended after the controller's part ({self.after})" if self.after else ""
        return (
            f"cut while the controller drove ({self.cut})" if self.drove else f"the controller never drove ({self.cut})"
        )


def ending_of(run: Run) -> Ending:
    """Return how a run ended.

    The loop says in an event why it stops, and in another that the landing begins; a log without events, as of a
    replay, has its phases.

    Args:
        run: The log.
    """
    rows = np.flatnonzero(run.phase == "run")
    drove = rows.size * run.control_period if rows.size else 0.0
    texts = [text for _, _, text in run.events]
    said = next((place for place, text in enumerate(texts) if text.startswith(EARLY_ENDS)), None)
    landing = texts.index("landing") if "landing" in texts else len(texts)
    why = "" if said is None else texts[said]
    if said is not None and said < landing:
        return Ending(drove, cut=why)
    if not rows.size:
        return Ending(0.0, cut=_KILLED if run.truncated else "the log holds nothing of the controller")
    if rows[-1] == run.index.size - 1:
        return Ending(drove, cut=_KILLED if run.truncated else "the log ends there")
    complete = any(text.startswith("torque off; ") for text in texts)
    return Ending(drove, after=why or (_KILLED if run.truncated and not complete else ""))
