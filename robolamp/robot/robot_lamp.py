"""The lamp on its serial ports: the servo bus and the foot sensor as one LampBackend."""

from __future__ import annotations

import contextlib
import math

import numpy as np
from numpy.typing import NDArray

from robolamp.controller.foot_window import FootWindow
from robolamp.dynamixel.bus import PATIENCE, SETTING_PATIENCE, Bus, Port
from robolamp.dynamixel.registers import MODELS, VOLTAGE_UNIT, HardwareError, Name
from robolamp.dynamixel.servo_state import ServoState
from robolamp.dynamixel.servos import Servos
from robolamp.dynamixel.wire_time import wire_time
from robolamp.errors import BusError, SafetyError
from robolamp.foot.sensor import ByteSource, FootSensor
from robolamp.lamp import Lamp
from robolamp.robot.joint_frame import JointFrame
from robolamp.robot.preflight import preflight
from robolamp.robot.roll_call import check_alone
from robolamp.signals import ASKED_AGAIN, Clock, Command, Health, Observation, ServoTraits

WATCHDOG = 0.2
"""Silence on the bus after which each servo stops by itself [s]: ten ticks at 50 Hz (Bus Watchdog(98))."""

_SUSPECT = 0.8  # share of WATCHDOG after which the servos are asked: their clocks are not ours

_CONDITION_TICKS = 5
"""Answers in a row without a servo's torque and error flags after which that is a fault; one may be noise."""

_DAMAGES = ("bus: bytes that nobody asked for", "foot: frames lost", "foot: damaged bytes", "foot: frames repeated")


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
        self._window = FootWindow(1, lamp.contact_on, lamp.contact_off)
        self._servos: Servos | None = None
        self._measured = np.full(len(lamp.joints), -math.inf)  # when each angle last came [s]
        self._asking = wire_time("question", len(lamp.joints), lamp.bus_baud)
        self._torque = False
        self._spoke = -math.inf  # when the bus last carried a packet of ours [s]
        self._silence = 0.0  # longest time without one since the watchdogs were last known to be armed [s]
        self._unknown = np.zeros(len(lamp.joints), np.int64)  # answers in a row without a servo's condition
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
        return wire_time("reading", len(self.joints), self._lamp.bus_baud, self._servos.transport)

    @property
    def clock(self) -> Clock:
        """The clock that observations are stamped with."""
        return self._clock

    @property
    def traits(self) -> ServoTraits:
        """What its servos are like."""
        return servo_traits(self._lamp)

    def open(self) -> None:
        """Open both ports and check that the lamp may be moved; nothing moves.

        Written are the servos' health blocks and Status Return Level as it is (RAM) and, only with `fix`, settings that
        are wrong, and lamp.toml where that makes its zeros and signs wrong.

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
            self._check(fix=self._fix)
        except BaseException:
            self._servos = None
            self._shut()
            raise
        self._damage()  # what came before is not of the run
        self.observe()  # from here on, ages count from a real reading

    def _check(self, *, fix: bool = False, holding: bool = False) -> None:
        """Run the whole preflight, and take the servos for the run.

        Raises:
            BusError, SafetyError: As `preflight`.
        """
        passed = preflight(self._lamp, self._bus, self._foot, self._clock, fix=fix, holding=holding)
        self.mended, self.notices = [*self.mended, *passed.mended], list(passed.notices)
        for joint in self._lamp.joints:
            check_alone(self._bus, joint.id, MODELS[joint.servo])
        passed.servos.prepare(passed.firmware)
        self._servos = passed.servos

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

    def settings(self) -> dict[str, dict[str, int]]:
        """Return what the servos are set to, by joint and register, in counts; without those that do not answer."""
        found = zip(self.joints, self._ready().settings(), strict=True)
        return {joint: {str(name): value for name, value in known.items()} for joint, known in found if known}

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
        mean, contact = self._window.take()
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
                state.voltage,
                state.temperature,
                sign * state.pwm,
                state.torque,
                state.hardware_error,
                state.error,
                np.where(state.goal_known, np.where(state.goal_lost, 0, 1), -1),
            ),
            faults=tuple(faults),
            foot_mean=float(mean[0]),
            foot_contact=float(contact[0]),
        )

    def command(self, command: Command) -> None:
        """Send goals to all servos at once.

        Raises:
            SafetyError: A goal is not finite or outside the joint's limits, or the servos' watchdog has stopped them;
                nothing was sent.
            BusError: The port is gone.
        """
        self._lamp.check_goal(command.goal)
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
        servos.write_goals(self._frame.servo_angle(command.goal))
        self._spoke = now

    def reconnect(self) -> bool:
        """Open ports that went away again, once, and run the whole preflight as `open` does; torque is left as it is.

        Returns:
            True: the lamp is back and fit, everything answers. Until `torque(True)` each servo may be stopped by its
            watchdog.

        Raises:
            BusError: It is not there yet; the message says what is missing.
            SafetyError: It is back, and not fit to be moved: another model, settings, state, angle, or foot.
        """
        self._ready()
        self._bus.close()
        self._bus.open()
        silent = [self._bus.label(joint.id) for joint in self._lamp.joints if self._bus.ping(joint.id) is None]
        if silent:
            said = "does not answer" if len(silent) == 1 else "do not answer"
            raise BusError(f"{', '.join(silent)} {said} to a ping", self._bus.name)
        if self._foot is not None and self._foot.gone:
            self._foot.close()
            self._foot.open()
        self._check(holding=True)
        self._damage()
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
        """Return faults in a reading of the servos."""
        if state.fine:
            self._unknown[:] = 0
            return []
        self._unknown = np.where(state.torque < 0, self._unknown + present, 0)  # no answer at all tells nothing of it
        said = (
            ("no answer", ~present),
            (ASKED_AGAIN, state.asked_again & present),
            ("a goal did not arrive", state.goal_lost),
            ("condition unknown", present & (self._unknown >= _CONDITION_TICKS)),
        )
        faults = [f"{self.joints[index]}: {text}" for text, where in said for index in np.flatnonzero(where)]
        alert = np.flatnonzero((state.error > 0) & (state.hardware_error <= 0))
        return faults + [f"{self.joints[index]}: error byte {state.error[index]:#04x}" for index in alert]

    def _feel(self) -> list[str]:
        """Read what the foot sensor has sent, and return its faults."""
        if self._foot is None:
            return []
        faults: list[str] = []
        try:
            for frame in self._foot.poll():
                self._window.add(self._foot.newtons(frame))
        except BusError as error:
            faults.append(f"foot: {error.message}")
        newest = self._foot.newest
        if newest is not None and newest.saturated:
            faults.append("foot: saturated")
        if newest is not None and newest.disconnected:
            faults.append("foot: load cell not connected")
        return faults

    def _damage(self) -> list[str]:
        """Return faults on the lines since the last call, including those that cost no reading."""
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


def servo_traits(lamp: Lamp) -> ServoTraits:
    """Return what a run must know of a lamp's servos.

    Args:
        lamp: Names their models, and gives the baud rate of their bus.
    """
    lowest = [(MODELS[joint.servo][Name.MIN_VOLTAGE_LIMIT].initial or 0) * VOLTAGE_UNIT for joint in lamp.joints]
    tick = wire_time("tick", len(lamp.joints), lamp.bus_baud)
    return ServoTraits(np.array(lowest), tick, HardwareError.words)
