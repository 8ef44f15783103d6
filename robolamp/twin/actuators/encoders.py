"""Encoders that are off: by a constant, and by a sine over each turn, as where a magnet sits beside its axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robolamp.jit import njit
from robolamp.lamp import Lamp
from robolamp.twin.bend import Bend

Array = NDArray[np.float64]

_OFFSET, _AMPLITUDE, _PHASE, _SIGN = range(4)  # columns of `Encoders.table`


@dataclass(frozen=True)
class Encoders:
    """How the encoders of a lamp's joints are off.

    Attributes:
        table: A joint a row, shape (n, 4): constant [rad]; amplitude of the sine [rad], its phase where the joint is
            at 0 [rad], and the sense of the joint against its shaft.
    """

    table: Array

    @classmethod
    def of(cls, lamp: Lamp, bend: Bend) -> Encoders:
        """Return those of a bent lamp."""
        n = len(lamp.joints)
        zero, sign = np.array([(joint.zero, float(joint.sign)) for joint in lamp.joints]).T
        offset, amplitude, phase = (
            np.broadcast_to(values, n)
            for values in (bend.encoder_offset, bend.encoder_nonlinearity, bend.encoder_phase)
        )
        return cls(np.stack([offset, amplitude, zero + phase, sign], axis=1))

    @classmethod
    def exact(cls, n: int) -> Encoders:
        """Return those of n joints that are not off."""
        return cls(np.zeros((n, 4)))


@njit(nogil=True, error_model="numpy")
def misreading(encoder: Array, angle: float) -> float:
    """Return what an encoder reads beyond the angle at its horn [rad].

    Args:
        encoder: Its row of `Encoders.table`.
        angle: At the horn [rad].
    """
    if encoder[_AMPLITUDE] == 0.0:
        return encoder[_OFFSET]
    sign = encoder[_SIGN]
    return encoder[_OFFSET] + sign * encoder[_AMPLITUDE] * np.sin(encoder[_PHASE] + sign * angle)
