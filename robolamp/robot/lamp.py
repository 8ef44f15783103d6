"""The lamp on its serial ports: the servo bus and the foot sensor as one LampBackend."""

from __future__ import annotations

import contextlib
import math

import numpy as np
from numpy.typing import NDArray

from robolamp.dynamixel.bus import PATIENCE, SETTING_PATIENCE, Bus, Port
from robolamp.dynamixel.servos import Servos, answer_wire_time, request_wire_time
from robolamp.dynamixel.state import ServoState
from robolamp.errors import BusError, SafetyError
from robolamp.foot.sensor import ByteSource, FootSensor
from robolamp.lamp import Lamp
from robolamp.robot.frame import JointFrame
from robolamp.robot.preflight import check_foot, check_servos, check_state, notices
from robolamp.signals import Clock, Command, Health, Observation

WATCHDOG = 0.2
"""Silence on the bus after which each servo stops by itself [s]: ten ticks at 50 Hz (Bus Watchdog(98))."""

_SUSPECT = 0.8  # share of WATCHDOG after which the servos are asked: their clocks are not ours

_CONDITION_TICKS = 5
"""Readings in a row without a servo's torque and error flags after which that is a fault; one may be noise."""

_DAMAGES = ("bus: bytes that nobody asked for", "foot: frames lost", "foot: damaged bytes", "foot: frames repeated")

_ROUNDING = 1e-9  # rad: a goal on its limit may be this far outside by rounding


class RobotLamp:
    """A lamp behind two serial ports, physical or emulated.

    Args:
        lamp: Its description.
        bus_port: Port of the servo bus: a device path, or an SDK-like port object.
        foot_port: Port of the foot sensor: a device path, or an open source of bytes; None: there is none.
        clock: Stamps the observations and measures timeouts.
        patience: How long an answer may be late before it is a gap [s].
        opening: The same outside the loop, while the lamp is opened and its torque turned on [s].
        duty: The most of the supply that the motors get, above 0 to 1: less for careful first runs.
        fix: Whether `open` mends settings that are wrong and that software may mend.

    Attributes:
        notices: What `open` found that is not wrong, but could be better.
        mended: What `open` mended.
        left_on: Joints whose servos did not confirm the last torque(False): they may still hold.
    """

    def __init__(
        self,
        lamp: Lamp,
        bus_port: str | Port,
        foot_port: str | ByteSource | None,
        clock: Clock,
        *,
        patience: float = PATIENCE,
        opening: float = SETTING_PATIENCE,
        duty: float = 1.0,
        fix: bool = False,
    ) -> None:
        labels = {joint.id: joint.name for joint in lamp.joints}
        self.notices: list[str] = []
        self.mended: list[str] = []
        self._opening = opening
        self._duty = duty
        self._fix = fix
        self.left_on: tuple[str, ...] = ()
        self._lamp = lamp
        self._clock = clock
        self._frame = JointFrame(lamp)
        self._bus = Bus(bus_port, lamp.bus_baud, clock, labels=labels, patience=patience)
        self._foot: FootSensor | None = None
        if foot_port is not None:
            self._foot = FootSensor(foot_port, lamp.foot_baud, clock, tare=lamp.foot_tare, scale=lamp.foot_scale)
        self._servos: Servos | None = None
        self._firmware: list[int] = []
        self._measured = np.full(len(lamp.joints), -math.inf)  # when each angle last came [s]
        self._asking = request_wire_time(len(lamp.joints), lamp.bus_baud)
        self._torque = False
        self._spoke = -math.inf  # when the bus last carried a packet of ours [s]
        self._silence = 0.0  # longest time without one since the watchdogs were last known to be armed [s]
        self._unknown = np.zeros(len(lamp.joints), np.int64)  # readings in a row without a servo's condition
        self._noted = (0,) * len(_DAMAGES)  # how often each was last known to have happened

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, from the foot up."""
        return self._lamp.names

    @property
    def transport(self) -> str:
        """How a tick's reading is made, in words; empty before `open`."""
        return "" if self._servos is None else str(self._servos.transport)

    @property
    def answer_wire_time(self) -> float:
        """How long a tick's questions and answers are on the line [s]; NaN before `open`."""
        if self._servos is None:
            return math.nan
        return answer_wire_time(self._servos.transport, len(self.joints), self._lamp.bus_baud)

    @property
    def clock(self) -> Clock:
        """The clock that observations are stamped with."""
        return self._clock

    def open(self) -> None:
        """Open both ports and check that the lamp may be moved; nothing moves.

        Written are the servos' health blocks (RAM) and, only with `fix`, settings that are wrong.

        Raises:
            BusError: A port does not exist, a servo or the foot sensor does not answer.
            SafetyError: A servo is another model, or its settings, state or angle are not fit to move.
        """
        with self._bus.patient(self._opening):
            self._open()

    def _open(self) -> None:
        try:
            self._bus.open()
            if self._foot is not None:
                self._foot.open()
            models, identities = check_servos(self._lamp, self._bus)
            ids = [joint.id for joint in self._lamp.joints]
            servos = Servos(self._bus, ids, models)
            self.mended = check_state(self._lamp, self._bus, servos, fix=self._fix)
            if self._foot is not None:
                check_foot(self._foot, self._clock, self._lamp.contact_on)
            self.notices = notices(identities, models, [self._bus.label(servo) for servo in ids])
            self._firmware = [identity.firmware for identity in identities]
            servos.prepare(self._firmware)
        except BaseException:
            self._shut()
            raise
        self._servos = servos
        self._damage()  # what came before is not of the run
        self.observe()  # from here on, ages count from a real reading

    def torque(self, on: bool) -> None:
        """Turn torque on (goal := present first, then its Bus Watchdog) or off (each servo on its own).

        Raises:
            BusError: A servo could not be turned on; all are off again. Turning off never raises.
        """
        if on:
            try:
                with self._bus.patient(self._opening):
                    gains = [joint.position_p_gain for joint in self._lamp.joints]
                    self._ready().torque_on(gains, WATCHDOG, self._duty)
            except BaseException:
                self.torque(False)
                raise
            self._spoke = self._clock.now()
            self._silence = 0.0
            self._torque = True
            return
        self._torque = False
        if self._servos is not None:
            if self._bus.gone:
                with contextlib.suppress(BusError):  # it may be back
                    self._bus.close()
                    self._bus.open()
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
        self._measured[present] = began + self._asking  # an angle is no older than its age
        if not faults:
            self._spoke = began
            faults = self._amiss(state, present)
        faults += self._feel() + self._damage()
        now = self._clock.now()
        sign = self._frame.sign
        return Observation(
            time=now,
            angle=angle,
            velocity=sign * state.velocity,
            current=sign * state.current,
            angle_age=now - self._measured,
            foot_force=math.nan if self._foot is None else self._foot.force,
            foot_age=math.inf if self._foot is None else self._foot.age,
            health=Health(
                state.voltage, state.temperature, sign * state.pwm, state.torque, state.hardware_error, state.error
            ),
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

    def reconnect(self) -> bool:
        """Open the servo port again after it went away, once; torque is left as it is.

        Returns:
            Whether every servo answers again. Until `torque(True)` each may be stopped by its watchdog.
        """
        if self._servos is None:
            return False
        self._bus.close()
        try:
            self._bus.open()
            if any(self._bus.ping(joint.id) is None for joint in self._lamp.joints):
                return False
            self._servos.prepare(self._firmware)
        except BusError:
            return False
        return True

    def close(self) -> None:
        """Turn torque off and close both ports; may be called twice."""
        if self._servos is not None:
            self.torque(False)
            self._servos = None
        self._shut()

    def _shut(self) -> None:
        self._bus.close()
        if self._foot is not None:
            self._foot.close()

    def _amiss(self, state: ServoState, present: NDArray[np.bool_]) -> list[str]:
        """Return what is wrong with a reading of the servos."""
        if state.fine:
            self._unknown[:] = 0
            return []
        self._unknown = np.where(present & (state.torque < 0), self._unknown + 1, 0)
        said = (
            ("no answer", ~present),
            ("answered only when asked again", state.asked_again & present),
            ("a goal did not arrive", state.goal_lost),
            ("condition unknown", self._unknown >= _CONDITION_TICKS),
        )
        faults = [f"{self.joints[index]}: {text}" for text, where in said for index in np.flatnonzero(where)]
        alert = np.flatnonzero((state.error > 0) & (state.hardware_error <= 0))
        return faults + [f"{self.joints[index]}: error byte {state.error[index]:#04x}" for index in alert]

    def _feel(self) -> list[str]:
        """Take what the foot sensor has sent, and return what is wrong with it."""
        if self._foot is None:
            return []
        faults: list[str] = []
        try:
            self._foot.poll()
        except BusError as error:
            faults.append(f"foot: {error.message}")
        newest = self._foot.newest
        if newest is not None and newest.saturated:
            faults.append("foot: saturated")
        if newest is not None and newest.disconnected:
            faults.append("foot: load cell not connected")
        return faults

    def _damage(self) -> list[str]:
        """Return what has gone wrong on the lines since the last call, though nothing may be missing for it."""
        counts = (self._bus.stray, 0, 0, 0)
        if self._foot is not None:
            decoder = self._foot.decoder
            counts = (self._bus.stray, decoder.lost, decoder.discarded, decoder.repeated)
        new = [text for text, count, before in zip(_DAMAGES, counts, self._noted, strict=True) if count > before]
        self._noted = counts
        return new

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
