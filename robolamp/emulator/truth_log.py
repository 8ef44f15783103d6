"""The truth log: what really happened to an emulated lamp, for judging a run. Nothing of it passes through the ports.

Topics: `/truth/joints` (sensor_msgs/JointState: true angles [rad] and velocities [rad/s], motor torques [Nm] as effort)
and `/truth/base` (robolamp_msgs/Truth), 250 times a second.
"""

from __future__ import annotations

from pathlib import Path

from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.log.schemas import JOINT_STATE, TRUTH, TRUTH_BASE_TOPIC, TRUTH_JOINTS_TOPIC, joint_state
from robolamp.log.writer import LogWriter

PERIOD = 0.004
"""Time between messages [s]."""


class TruthLog:
    """Writes what a lamp truly does, from its clock's time 0 on.

    Args:
        path: The MCAP file.
        lamp: The lamp to watch.
        start: The monotonic clock at the lamp's time 0 [s].
        context: What is emulated, kept as the file's metadata.
        epoch: Nanoseconds since the epoch at a virtual clock's 0; None: the clock is the monotonic one.

    Raises:
        FileError: The file cannot be made.
    """

    def __init__(
        self, path: Path, lamp: EmulatedLamp, start: float, context: dict[str, str], *, epoch: int | None = None
    ) -> None:
        virtual = epoch is not None
        self._writer = LogWriter(path, context=context, joints=lamp.lamp.names, epoch=epoch, lossless=virtual)
        self._start = start
        self._next = 0.0
        self._force = 0.0
        lamp.watch(self._step)

    @property
    def path(self) -> Path:
        """The file."""
        return self._writer.path

    @property
    def error(self) -> str:
        """Why the file ended early; empty while all is well."""
        return self._writer.error

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()

    def shift(self, seconds: float) -> None:
        """Notice that the lamp's clock stood still for a while.

        Args:
            seconds: How long [s].
        """
        self._start += seconds

    def _step(self, lamp: EmulatedLamp) -> None:
        plant = lamp.plant
        self._force = max(self._force, plant.force)
        if plant.time < self._next - plant.timestep / 2:
            return
        self._next = plant.time + PERIOD
        at = self._start + plant.time
        truth = plant.truth()
        joints = joint_state(
            lamp.lamp.names,
            plant.angle.tolist(),
            plant.velocity.tolist(),
            plant.torque.tolist(),
            log_time=self._writer.log_time(at),
        )
        base = {
            "base_x": truth.base_x,
            "base_z": truth.base_z,
            "pitch": truth.lean,
            "clearance": truth.clearance,
            "force": self._force,
            "fallen": truth.fallen,
        }
        self._writer.message(TRUTH_JOINTS_TOPIC, JOINT_STATE, joints, at)
        self._writer.message(TRUTH_BASE_TOPIC, TRUTH, base, at)
        self._force = 0.0
