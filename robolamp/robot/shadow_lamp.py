"""A lamp that is read and never moved, to show what a controller would command."""

from __future__ import annotations

from robolamp.lamp import Lamp
from robolamp.signals import Command, LampBackend, LampProxy


class ShadowLamp(LampProxy):
    """A lamp backend that passes readings through, and checks goals without sending them. Torque is never turned on.

    Args:
        backend: The lamp that is read.
        lamp: Its description.
    """

    def __init__(self, backend: LampBackend, lamp: Lamp) -> None:
        super().__init__(backend)
        self._lamp = lamp

    def torque(self, on: bool) -> None:
        """Turn torque off; on is not passed on."""
        if not on:
            self._backend.torque(False)

    def command(self, command: Command) -> None:
        """Check goals as the lamp would; nothing is sent.

        Raises:
            SafetyError: A goal is not finite or outside the joint's limits.
        """
        self._lamp.check_goal(command.goal)
