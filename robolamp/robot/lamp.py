"""The lamp on its serial ports: the servo bus and the foot sensor as one LampBackend."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.bus import PATIENCE, Bus, Port
from robolamp.dynamixel.servos import Servos, ServoState
from robolamp.errors import BusError, SafetyError
from robolamp.foot.sensor import ByteSource, FootSensor
from robolamp.lamp import Lamp
from robolamp.robot.frame import JointFrame
from robolamp.robot.preflight import check_foot, check_servos, check_state
from robolamp.signals import Clock, Command, Health, Observation

WATCHDOG = 0.2
"""Silence on the bus after which each servo stops by itself [s]: ten ticks at 50 Hz (Bus Watchdog(98))."""

_SUSPECT = 0.8  # share of WATCHDOG after which the servos are asked: their clocks are not ours

_CONDITION_TICKS = 5
"""Readings in a row without a servo's torque and error flags after which that is a fault; one may be noise."""

_ROUNDING = 1e-9  # rad: a goal on its limit may be this far outside by rounding


class RobotLamp:
    """A lamp behind two serial ports, physical or emulated.

    Args:
        lamp: Its description.
        bus_port: Port of the servo bus: a device path, or an SDK-like port object.
        foot_port: Port of the foot sensor: a device path, or an open source of bytes.
        clock: Stamps the observations and measures timeouts.
        patience: How long an answer may be late before it is a gap [s].

    Attributes:
        left_on: Joints whose servos did not confirm the last torque(False): they may still hold.
    """

    def __init__(
        self,
        lamp: Lamp,
        bus_port: str | Port,
        foot_port: str | ByteSource,
        clock: Clock,
        *,
        patience: float = PATIENCE,
    ) -> None:
        labels = {joint.id: joint.name for joint in lamp.joints}
        self.left_on: tuple[str, ...] = ()
        self._lamp = lamp
        self._clock = clock
        self._frame = JointFrame(lamp)
        self._bus = Bus(bus_port, lamp.bus_baud, clock, labels=labels, patience=patience)
        self._foot = FootSensor(foot_port, lamp.foot_baud, clock)
        self._servos: Servos | None = None
        self._measured = np.full(len(lamp.joints), -math.inf)  # when each angle last came [s]
        self._torque = False
        self._spoke = -math.inf  # when the bus last carried a packet of ours [s]
        self._silence = 0.0  # longest time without one since the watchdogs were last known to be armed [s]
        self._unknown = np.zeros(len(lamp.joints), np.int64)  # readings in a row without a servo's condition

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, from the foot up."""
        return self._lamp.names

    @property
    def clock(self) -> Clock:
        """The clock that observations are stamped with."""
        return self._clock

    def open(self) -> None:
        """Open both ports and check that the lamp may be moved; nothing moves, nothing is written.

        Raises:
            BusError: A port does not exist, a servo or the foot sensor does not answer.
            SafetyError: A servo is another model, or its settings, state or angle are not fit to move.
        """
        try:
            self._bus.open()
            self._foot.open()
            models = check_servos(self._lamp, self._bus)
            servos = Servos(self._bus, [joint.id for joint in self._lamp.joints], models)
            check_state(self._lamp, self._bus, servos)
            check_foot(self._foot, self._clock)
        except BaseException:
            self._bus.close()
            self._foot.close()
            raise
        self._servos = servos
        self.observe()  # from here on, ages count from a real reading

    def torque(self, on: bool) -> None:
        """Turn torque on (goal := present first, then its Bus Watchdog) or off (each servo on its own).

        Raises:
            BusError: A servo could not be turned on; all are off again. Turning off never raises.
        """
        if on:
            try:
                self._ready().torque_on([joint.position_p_gain for joint in self._lamp.joints], WATCHDOG)
            except BaseException:
                self.torque(False)
                raise
            self._spoke = self._clock.now()
            self._silence = 0.0
            self._torque = True
            return
        self._torque = False
        if self._servos is not None:
            self.left_on = tuple(self.joints[index] for index in self._servos.torque_off())

    def observe(self) -> Observation:
        """Read servos and foot sensor once; what is missing is a gap, with a fault that names it."""
        faults: list[str] = []
        began = self._clock.now()
        self._silence = max(self._silence, began - self._spoke)  # before this reading feeds the watchdogs again
        try:
            state = self._ready().read()
        except BusError as error:
            state = ServoState.unknown(len(self.joints))
            faults.append(f"bus: {error.message}")
        angle = self._frame.joint_angle(state.position)
        present = np.isfinite(angle)
        self._measured[present] = began  # the first block's reading follows: an angle is no older than its age
        if not faults:
            self._spoke = began
            faults += [f"{self.joints[index]}: no answer" for index in np.flatnonzero(~present)]
            self._unknown = np.where(present & (state.torque < 0), self._unknown + 1, 0)
            lasting = np.flatnonzero(self._unknown >= _CONDITION_TICKS)
            faults += [f"{self.joints[index]}: condition unknown" for index in lasting]
        try:
            self._foot.poll()
        except BusError as error:
            faults.append(f"foot: {error.message}")
        newest = self._foot.newest
        if newest is not None and newest.saturated:
            faults.append("foot: saturated")
        if newest is not None and newest.disconnected:
            faults.append("foot: load cell not connected")
        now = self._clock.now()
        sign = self._frame.sign
        return Observation(
            time=now,
            angle=angle,
            velocity=sign * state.velocity,
            current=sign * state.current,
            angle_age=now - self._measured,
            foot_force=self._foot.force,
            foot_age=self._foot.age,
            health=Health(state.voltage, state.temperature, sign * state.pwm, state.torque, state.hardware_error),
            faults=tuple(faults),
        )

    def command(self, command: Command) -> None:
        """Send goals to all servos at once.

        Raises:
            SafetyError: A goal is not finite or outside the joint's limits, or the servos' watchdog has stopped them;
                nothing was sent.
            BusError: The port is gone.
        """
        goal = self._checked(command.goal)
        servos = self._ready()
        now = self._clock.now()
        silence = max(self._silence, now - self._spoke)
        if self._torque and silence > _SUSPECT * WATCHDOG:
            tripped = ", ".join(self.joints[index] for index in servos.watchdog_tripped())
            if tripped:
                raise SafetyError(
                    f"the Bus Watchdog has stopped {tripped}: nothing was sent for {silence:.2f} s "
                    f"(allowed: {WATCHDOG:g})",
                    self._bus.name,
                )
        self._silence = 0.0
        servos.write_goals(self._frame.servo_angle(goal))
        self._spoke = now

    def close(self) -> None:
        """Turn torque off and close both ports; may be called twice."""
        if self._servos is not None:
            self.torque(False)
            self._servos = None
        self._bus.close()
        self._foot.close()

    def _ready(self) -> Servos:
        if self._servos is None:
            raise BusError("the lamp is not open", self._bus.name)
        return self._servos

    def _checked(self, goal: NDArray[np.float64]) -> NDArray[np.float64]:
        for joint, value in zip(self._lamp.joints, goal, strict=True):
            if not joint.lower - _ROUNDING <= value <= joint.upper + _ROUNDING:  # NaN is outside too
                raise SafetyError(
                    f"goal {value:g} rad of {joint.name} is not from {joint.lower:g} to {joint.upper:g} rad",
                    str(self._lamp.path),
                )
        return goal
