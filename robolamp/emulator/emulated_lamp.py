"""The emulated lamp in one piece: servos on a line, the foot sensor, and the plant that moves behind them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibration import Calibration
from robolamp.dynamixel.registers import BAUD_CODES, MODELS, Name
from robolamp.emulator.faults.injector import Injector
from robolamp.emulator.faults.script import Faults
from robolamp.emulator.faults.strike import strike
from robolamp.emulator.foot_sensor import FootSensor
from robolamp.emulator.line.line import GAP, Line, Reply
from robolamp.emulator.plant.plant import Plant
from robolamp.emulator.reality.reality import Reality
from robolamp.emulator.servo.servo import WAKING, Drive, Sensed, Servo
from robolamp.errors import FileError
from robolamp.lamp import Lamp
from robolamp.twin.lamp_model import build

VELOCITY_WINDOW = 0.05
"""Present Velocity is the mean over this time [s]. Estimate: the e-manual gives none; servos are seen to lag so."""

CAPACITOR_TIME = 0.004
"""Time in which the supply's voltage follows the load [s]. Estimate: some 1,000 uF, and tenths of an Ohm in the cables,
behind motors of a few Ohm."""

WARMING = 0.1
"""How often the windings' resistance follows their temperature [s]: they take minutes."""

Array = NDArray[np.float64]


class EmulatedLamp:
    """A lamp that answers bytes, in a time that is given to it.

    Args:
        lamp: The lamp's description.
        calibration: The twin's numbers.
        assets: Where the model is.
        reality: How this lamp differs from that twin.
        gap: Silence inside a packet that ends it [s].
        faults: What goes wrong; None: nothing.
        factory: The servos are new (id 1, 57,600 baud, Return Delay Time 250) and only the first is plugged in.
        clamped: Whether the base is clamped to the desk.
        store: Folder that keeps each servo's EEPROM, as ankle.toml for the ankle's; what it holds goes before the
            lamp's description. None: it is not kept.

    Attributes:
        lamp: As given.
        servos: The servos, in the order of the joints.
        line: What connects them.
        injector: What lets things go wrong.
        plant: What they turn.

    Raises:
        FileError: The model or calibration lacks something, or no servo can have the lamp's baud rate.
    """

    def __init__(
        self,
        lamp: Lamp,
        calibration: Calibration,
        assets: Assets,
        reality: Reality,
        *,
        gap: float = GAP,
        faults: Faults | None = None,
        factory: bool = False,
        clamped: bool = False,
        store: Path | None = None,
    ) -> None:
        if lamp.bus_baud not in BAUD_CODES:
            legal = ", ".join(map(str, BAUD_CODES))
            raise FileError(f"bus.baud: {lamp.bus_baud} is not one of {legal}", str(lamp.path))
        twin = build(lamp, calibration, assets, reality, clamped=clamped)
        if reality.resistance_per_kelvin:
            growth = np.full(len(lamp.joints), reality.resistance_per_kelvin)
            twin = replace(twin, servos=replace(twin.servos, resistance_temperature=growth))
        self.lamp = lamp
        self.plant = Plant(twin)
        self._random = np.random.default_rng(reality.seed)
        self._reality = reality
        self._watchers: list[Callable[[EmulatedLamp], None]] = []
        self._frames: deque[tuple[float, bytes]] = deque()
        self._seen: deque[Array] = deque(maxlen=round(VELOCITY_WINDOW / self.plant.timestep) + 1)
        self._read_encoders()
        eeprom = {Name.BAUD_RATE: BAUD_CODES[lamp.bus_baud], Name.RETURN_DELAY_TIME: 0}
        self.servos = tuple(
            Servo(
                MODELS[joint.servo],
                {} if factory else {**eeprom, Name.ID: joint.id},
                self._senses(index),
                store=store / f"{joint.name}.toml" if store else None,
                woke=index * WAKING,
            )
            for index, joint in enumerate(lamp.joints)
        )
        self._drives: list[Drive | None] = [None] * len(self.servos)
        jitter, fixed = reality.jitter, reality.latency
        latency = (
            (lambda: fixed + (float(self._random.exponential(jitter)) if jitter else 0.0)) if jitter or fixed else None
        )
        self.injector = Injector(
            faults or Faults("none"),
            [joint.id for joint in lamp.joints],
            lambda index, event, time: strike(self.servos[index], event, time),
        )
        self.line = Line(self.servos, lamp.bus_baud, self.advance_to, latency, gap, self.injector)
        if factory:
            self.line.unplugged = set(range(1, len(self.servos)))
        self._supply = twin.supply_resistance, reality.drain
        self._drop = 0.0  # over the supply's resistance [V]
        self._warmed = 0.0  # when the windings' resistance was last brought up to date [s]
        self._forces: deque[float] = deque(maxlen=round(reality.foot_dead_time / self.plant.timestep) + 1)
        self._foot = FootSensor(twin.foot_gain, lambda: self._foot_error(reality))

    @property
    def time(self) -> float:
        """Simulated time, 0 at the start [s]."""
        return self.plant.time

    @property
    def timestep(self) -> float:
        """Physics step [s]."""
        return self.plant.timestep

    def watch(self, watcher: Callable[[EmulatedLamp], None]) -> None:
        """Call a function with this lamp after each physics step."""
        self._watchers.append(watcher)

    def advance_to(self, time: float) -> None:
        """Let the physics run up to a time; where it has been there already, nothing happens.

        Args:
            time: In simulated time [s].
        """
        while self.plant.time + self.plant.timestep <= time:
            self._step()
        self.injector.poll(time)

    def receive(self, data: bytes, time: float) -> list[Reply]:
        """Take bytes from the client and return the servos' answers.

        Args:
            data: What the client sends.
            time: When [s].
        """
        return self.line.feed(data, time)

    def frames(self, time: float) -> bytes:
        """Return the foot sensor's frames that were sampled by a time and not yet handed out.

        Args:
            time: In simulated time [s].
        """
        due = bytearray()
        while self._frames and self._frames[0][0] <= time:
            due += self._frames.popleft()[1]
        return bytes(due)

    def _step(self) -> None:
        plant = self.plant
        self.injector.poll(plant.time)
        plant.sag(self.injector.sag() + self._sag())
        if plant.time >= self._warmed:
            self._warmed = plant.time + WARMING
            plant.warm(self._reality.temperature + np.array([servo.heat for servo in self.servos]))
        for index, servo in enumerate(self.servos):
            servo.poll(plant.time)
            drive = servo.drive()
            if drive is not self._drives[index]:
                self._drives[index] = drive
                joint = self.lamp.joints[index]
                goal, duty = joint.sign * (drive.goal - joint.zero), drive.duty
                own = replace(drive, goal=goal, duty=None if duty is None else joint.sign * duty)
                plant.drive(index, own, (servo.written - plant.time) / plant.timestep)
        plant.step()
        self._read_encoders()
        self._sample_foot()
        for watcher in self._watchers:
            watcher(self)

    def _sag(self) -> float:
        """Return by how much the supply is lower than a good one [V]; capacitors smooth what the motors draw."""
        resistance, drain = self._supply
        if resistance:
            drawn = float(np.abs(self.plant.current).sum())
            self._drop += (resistance * drawn - self._drop) * min(self.plant.timestep / CAPACITOR_TIME, 1.0)
        return self._drop + drain * self.plant.time

    def _foot_error(self, reality: Reality) -> float:
        noise = float(self._random.normal(0.0, reality.foot_noise)) if reality.foot_noise else 0.0
        return reality.foot_offset + reality.foot_drift * self.plant.time + noise

    def _sample_foot(self) -> None:
        injector = self.injector
        self._foot.stuck = injector.foot("stuck")
        self._forces.append(self.plant.force)
        for moment, frame in self._foot.sample(self._forces[0], self.plant.time):
            if not injector.foot("silent"):
                for delay, data in injector.packet("foot", frame, moment):
                    sent = injector.noise(len(data)) if injector.foot("rubbish") else data
                    self._frames.append((moment + delay, sent))

    def _read_encoders(self) -> None:
        self._seen.append(
            self.plant.reading + self._random.normal(size=len(self.lamp.joints)) * self._reality.encoder_noise
        )

    def _senses(self, index: int) -> Callable[[float], Sensed]:
        joint, plant = self.lamp.joints[index], self.plant

        def sense(time: float) -> Sensed:
            newest, oldest = self._seen[-1][index], self._seen[0][index]
            window = max(len(self._seen) - 1, 1) * plant.timestep
            ahead = min(max(time - plant.time, 0.0), plant.timestep)
            return Sensed(
                angle=joint.zero + joint.sign * float(newest + plant.velocity[index] * ahead),
                velocity=joint.sign * float(newest - oldest) / window,
                current=joint.sign * float(plant.current[index]),
                duty=joint.sign * float(plant.duty[index]),
                voltage=plant.voltage,
                temperature=self._reality.temperature,
            )

        return sense
