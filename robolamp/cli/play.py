"""`robolamp play`: gestures and hops one after the other, in one run."""

from __future__ import annotations

from robolamp.cli.run.played import HERE, Player


def play(sequence: str, /, *, player: Player = HERE) -> int:
    """Play a sequence of gestures and hops: on the emulated lamp, or with --port on the physical one.

    Its gestures are checked on the twin first, as `robolamp gesture check` does. Before a hop and after one the lamp
    goes through its neutral pose. Ctrl-C, and in a terminal q, Space or Esc, lands the lamp softly; Ctrl-C again turns
    its torque off at once.

    Args:
        sequence: A sequence file, or the name of a shipped one (greeting).
        player: Where and how.
    """
    setup = player.setup

    from robolamp.cli.run.gesture_check import check_sequence  # after the arguments are checked
    from robolamp.pose.sequence import load_sequence

    found = load_sequence(sequence, setup.lamp, setup.assets)
    check_sequence(found, setup)
    return player.play(found, found.goal, found.duration)
