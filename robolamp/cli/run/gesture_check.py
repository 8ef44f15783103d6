"""Whether the lamp can play a gesture where it stands, tried on the twin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robolamp.cli.options import Setup
from robolamp.pose.gesture import PERIOD, Gesture, check_slew
from robolamp.pose.sequence import Sequence
from robolamp.twin.lamp_model import build
from robolamp.twin.standing import Standing, check_standing, stand

_TWICE = 2  # loops that are tried: every other one is as the second


def check_gesture(gesture: Gesture, setup: Setup, start: NDArray[np.float64] | None = None) -> Standing:
    """Try a gesture on the twin.

    Args:
        gesture: The gesture.
        setup: The lamp and its twin's numbers.
        start: Where the joints are at the beginning, shape (n,) [rad]; None: in the neutral pose.

    Raises:
        SafetyError: It would turn a joint too fast, tip the lamp, let its links meet or strain a servo; names the
            moment and the joint.
    """
    check_slew(gesture, setup.lamp, start)
    goals = gesture.motion(start).samples()[: round(_TWICE * gesture.once / PERIOD) + 1]
    standing = stand(build(setup.lamp, setup.calibration, setup.assets), goals, PERIOD)
    check_standing(standing, setup.lamp, gesture.path or gesture.name)
    return standing


def check_sequence(sequence: Sequence, setup: Setup) -> None:
    """Try the gestures of a sequence on the twin, each from where the one before ends.

    Args:
        sequence: The sequence; its hops are not tried.
        setup: The lamp and its twin's numbers.

    Raises:
        SafetyError: As for `check_gesture`.
    """
    start = np.zeros(len(setup.lamp.joints))
    for part in sequence.parts:
        if isinstance(part, Gesture):
            motion = part.motion(start)
            if np.ptp(motion.samples(), axis=0).any():  # a pause, and a way from where it is, need no twin
                check_gesture(part, setup, start)
            start = motion.end
        else:
            start = np.zeros(len(start))  # it comes back to the neutral pose from wherever the controller leaves it
