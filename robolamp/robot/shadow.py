"""A lamp that is read and never moved, to show what a controller would command."""

from __future__ import annotations

from robolamp.errors import SafetyError
from robolamp.lamp import Lamp
from robolamp.signals import Clock, Command, LampBackend, Observation

_ROUNDING = 1e-9  # rad: a goal on its limit may be this far outside by rounding


class ShadowLamp:
    """A lamp backend that passes readings through, and checks goals without sending them. Torque is never turned on.

    Args:
        backend: The lamp that is read.
        lamp: Its description.
    """

    def __init__(self, backend: LampBackend, lamp: Lamp) -> None:
        self._backend = backend
        self._lamp = lamp

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, from the foot up."""
        return self._backend.joints

    @property
    def clock(self) -> Clock:
        """The clock that observations are stamped with."""
        return self._backend.clock

    def open(self) -> None:
        """Open the lamp.

        Raises:
            BusError: A port does not exist or does not answer, or a servo is missing.
            SafetyError: The lamp is in no state to be moved.
        """
        self._backend.open()

    def torque(self, on: bool) -> None:
        """Turn torque off; on is not passed on."""
        if not on:
            self._backend.torque(False)

    def observe(self) -> Observation:
        """Read every sensor once."""
        return self._backend.observe()

    def command(self, command: Command) -> None:
        """Check goals as the lamp would; nothing is sent.

        Raises:
            SafetyError: A goal is not finite or outside the joint's limits.
        """
        for joint, value in zip(self._lamp.joints, command.goal, strict=True):
            if not joint.lower - _ROUNDING <= value <= joint.upper + _ROUNDING:  # NaN is outside too
                raise SafetyError(
                    f"goal {value:g} rad of {joint.name} is not from {joint.lower:g} to {joint.upper:g} rad",
                    str(self._lamp.path),
                )

    def close(self) -> None:
        """Let go of the lamp."""
        self._backend.close()
