"""Every register that a client may write, of every model, set off its default over the wire: who sees to it?

A servo of each model turns a pendulum in lockstep; what another client left in it is written by the SDK.
"""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from contract.backends import LAMP
from dynamixel_sdk import COMM_SUCCESS, PacketHandler
from numpy.typing import NDArray

from robolamp.assets import Assets
from robolamp.calibrate.servo.procedure import bench_lamp
from robolamp.calibration import load_calibration
from robolamp.controller.controller_file import load_controller
from robolamp.controller.pilot import Pilot, PilotStep
from robolamp.dynamixel.registers import MODELS, Model, Name, Register
from robolamp.emulator.bare_servos import BareServos
from robolamp.emulator.bare_servos_file import BareServo, PendulumLoad
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import Reality
from robolamp.errors import BusError, RobolampError, SafetyError
from robolamp.lamp import Lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.robot.servo_settings import INDIRECT, MAPPED, RULES, Seen
from robolamp.runtime.loop import run
from robolamp.signals import Interventions, Observation

ASSETS = Assets()
SUPPLY = {"XL330-M288-T": 5.0, "XL330-M077-T": 5.0, "XL430-W250-T": 11.1}
GAIN, SWING = 400, 0.5
WRITABLE = [
    (model.name, register) for model in MODELS.values() for register in model.registers.values() if register.writable
]
UNREAD = (Name.ID, Name.BAUD_RATE, Name.PROTOCOL_TYPE)  # a servo in which they are wrong does not answer


def values(register: Register) -> tuple[int, ...]:
    """Values that are off the default, legal, and not all near each other."""
    special: dict[Name, tuple[int, ...]] = {
        Name.ID: (9, 0, 252),
        Name.BAUD_RATE: (1, 4),
        Name.PROTOCOL_TYPE: tuple(choice for choice in register.choices if choice != 2),
        Name.SHADOW_ID: (1, 2, 100, 252),
        Name.RETURN_DELAY_TIME: (1, 250, 254),
        Name.TEMPERATURE_LIMIT: (40, 69, 100),  # 0 trips at once
        Name.DRIVE_MODE: (1, 4, 5, 8, 9, 12, 13),
        Name.HOMING_OFFSET: (1, 300, -300, 1024, 2000, -1_044_479),
        Name.MIN_POSITION_LIMIT: (1900, 2000),
        Name.MAX_POSITION_LIMIT: (2200, 2100),
        Name.SHUTDOWN: (0, 1, 0x04, 0x20),
        Name.GOAL_POSITION: (2300, 1800),
        Name.GOAL_PWM: (0, 100, -300),
        Name.GOAL_CURRENT: (0, 1, -1000),
        Name.GOAL_VELOCITY: (0, 1, -100),
    }
    if register.name in special:
        return special[register.name]
    assert register.low is not None
    assert register.high is not None
    near = [register.initial + step for step in (-1, 1)] if register.initial is not None else []
    spread = [register.low, register.high, (register.low + register.high) // 2, *near, *register.choices]
    legal = {value for value in spread if register.low <= value <= register.high}
    if register.choices:
        legal &= set(register.choices)
    return tuple(sorted(legal - {register.initial}))


class Bench:
    """One servo on a pendulum, as a lamp of one joint with a lamp.toml of its own."""

    def __init__(self, model: Model, folder: Path, eeprom: dict[Name, int] | None = None) -> None:
        self.model = model
        numbers = load_calibration(ASSETS)
        load = PendulumLoad(0.05, 0.1, SWING, {**numbers.servo("XL330-M288-T", "bench"), "encoder_offset": 0.0})
        servo = BareServo(model.name, 1, 1_000_000, 0.0, np.pi, SUPPLY[model.name], 0.0, load)
        path = folder / "lamp.toml"
        if not path.exists():
            path.write_text('[[joint]]\nname = "bench"  # kept\n')
        lamp = bench_lamp("bench", servo, path).lamp
        joint = dataclasses.replace(lamp.joints[0], position_p_gain=GAIN)
        self.lamp = dataclasses.replace(lamp, joints=(joint,))
        store = folder / "servo-1.toml"
        if eeprom:
            rows = "".join(f'"{name}" = {value}\n' for name, value in eeprom.items())
            store.write_text(f'model = "{model.name}"\n[eeprom]\nID = 1\n"Baud Rate" = 3\n{rows}')
        self.world = BareServos([servo], store=folder if eeprom else None)
        self.ports = Lockstep(self.world, 1_000_000)
        self.servo = self.world.servos[0]

    def leave(self, register: Register, value: int) -> None:
        """Write a register as another client would, and go."""
        port, packets = self.ports.servo_port, PacketHandler(2.0)
        assert port.openPort()
        raw = list(value.to_bytes(register.size, "little", signed=value < 0))
        result, error = packets.writeTxRx(port, 1, register.address, register.size, raw)
        quiet = register.name is Name.STATUS_RETURN_LEVEL  # what it answers with the new level is not our question
        assert quiet or (result, error) == (COMM_SUCCESS, 0), (register.name, value, result, error)
        port.closePort()

    def robot(self, lamp: Lamp | None = None, *, fix: bool = False) -> RobotLamp:
        return RobotLamp(lamp or self.lamp, self.ports.servo_port, None, self.ports.clock, fix=fix)

    def marked(self) -> Lamp:
        """The lamp as its lamp.toml says now."""
        own = tomllib.loads(self.lamp.path.read_text())["joint"][0]
        marks = {key: text for key, text in own.items() if key.endswith("_wanted")}
        return dataclasses.replace(self.lamp, joints=(dataclasses.replace(self.lamp.joints[0], **marks),))


class Swing:
    """Swings the pendulum."""

    def step(self, observation: Observation, time: float) -> PilotStep:
        goal = np.array([0.3 * np.sin(8.0 * time)])
        return PilotStep(np.empty(0), goal, goal, 0, True, Interventions())


def swung(bench: Bench) -> NDArray[np.float64]:
    """What the shaft does in a run, as read."""
    bench.ports.clock.sleep_until(1.0)  # whatever was said before
    robot = bench.robot()
    robot.open()
    angles: list[float] = []
    result = run(
        robot, Swing(), bench.lamp, duration=0.5, clamped=True,
        on_tick=lambda tick: angles.append(tick.observation.angle[0]),
    )  # fmt: skip
    robot.close()
    assert (result.ended, result.faults) == ("finished", {})
    return np.array(angles)


def test_the_table_has_every_register_and_no_other() -> None:
    assert {register.name for _, register in WRITABLE} == set(RULES)
    assert {name for name, rule in RULES.items() if rule.mend} <= {
        name for name, rule in RULES.items() if rule.seen is Seen.CHECKED
    }


def of(seen: Seen) -> list[tuple[str, Register]]:
    return [row for row in WRITABLE if RULES[row[1].name].seen is seen]


@pytest.mark.parametrize(
    ("model", "register"), of(Seen.CHECKED), ids=lambda each: each if isinstance(each, str) else each.name
)
def test_what_is_checked_is_named_and_mended(model: str, register: Register, tmp_path: Path) -> None:
    rule = RULES[register.name]
    for turn, value in enumerate(values(register)):
        folder = tmp_path / str(turn)
        folder.mkdir()
        if register.name is Name.PROTOCOL_TYPE:  # the emulated servo takes no other over the wire
            bench = Bench(MODELS[model], folder, {register.name: value})
        else:
            bench = Bench(MODELS[model], folder)
            bench.leave(register, value)
        before = bench.lamp.path.read_text()
        kind = BusError if register.name in UNREAD else SafetyError
        with pytest.raises(kind) as caught:
            bench.robot().open()
        said = str(caught.value)
        assert f"{register.name}({register.address})" in said
        if register.name is Name.PROTOCOL_TYPE:
            assert "Protocol Type(13) is 2" in said
        else:
            right = re.search(rf"\({register.address}\) is {value}, not (\d+)", said)
            assert right, said
        assert ("--fix mends" in said) == rule.mend
        assert "\n" not in said
        assert bench.servo.register(register.name) == value  # nothing was written
        assert bench.lamp.path.read_text() == before
        if not rule.mend:
            with pytest.raises(RobolampError):
                bench.robot(fix=True).open()
            assert bench.servo.register(register.name) == value
            continue
        mended = bench.robot(fix=True)
        upset = {what for what in rule.upset if register.name is not Name.DRIVE_MODE or value & 1}
        if upset:
            with pytest.raises(SafetyError) as caught:
                mended.open()
            assert re.search(rf"mended: .*\({register.address}\) is {value}, .*; not ready: ", str(caught.value))
            assert str(caught.value).endswith("`robolamp setup zero`")
            assert "# kept" in bench.lamp.path.read_text()
            with pytest.raises(SafetyError, match=r"must be found again, for .* when found; `robolamp setup zero`$"):
                bench.robot(bench.marked()).open()  # the next time too
            asked = bench.marked().joints[0]
            assert {key for key in ("zero", "sign") if getattr(asked, f"{key}_wanted")} == upset
        else:
            mended.open()
            mended.close()
            assert len(mended.mended) == 1
            assert bench.lamp.path.read_text() == before
        again = bench.robot()
        again.open()
        again.close()
        assert again.mended == []
        assert bench.servo.register(register.name) != value


RIGHT = {
    Name.BUS_WATCHDOG: 10,
    Name.PROFILE_ACCELERATION: 0,
    Name.PROFILE_VELOCITY: 0,
    Name.POSITION_D_GAIN: 0,
    Name.POSITION_I_GAIN: 0,
    Name.POSITION_P_GAIN: GAIN,
    Name.FEEDFORWARD_2ND_GAIN: 0,
    Name.FEEDFORWARD_1ST_GAIN: 0,
    Name.GOAL_PWM: 885,
    Name.GOAL_POSITION: 2048,
}


@pytest.mark.parametrize(
    ("model", "register"), of(Seen.WRITTEN), ids=lambda each: each if isinstance(each, str) else each.name
)
def test_what_is_written_is_right_when_torque_is_on(model: str, register: Register, tmp_path: Path) -> None:
    for value in values(register):
        bench = Bench(MODELS[model], tmp_path)
        bench.leave(register, value)
        robot = bench.robot()
        robot.open()
        robot.torque(True)
        assert bench.servo.register(register.name) == RIGHT[register.name], value
        robot.close()


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_a_run_does_not_depend_on_what_is_free(model: str, tmp_path: Path) -> None:
    free = [register for name, register in of(Seen.FREE) if name == model]
    assert len(free) >= 5
    for register in free:
        same = Bench(MODELS[model], tmp_path)
        same.leave(register, same.servo.register(register.name))
        reference = swung(same)
        assert np.ptp(reference) > 0.3
        for value in values(register):
            bench = Bench(MODELS[model], tmp_path)
            bench.leave(register, value)
            np.testing.assert_array_equal(swung(bench), reference, str((register.name, value)))


@pytest.mark.parametrize("model", MODELS)
def test_what_is_left_in_ram_does_not_change_a_run(model: str, tmp_path: Path) -> None:
    """Gains and profiles of another client, which were written and not set back."""
    same, left = Bench(MODELS[model], tmp_path), Bench(MODELS[model], tmp_path)
    for name in RIGHT:
        register = MODELS[model][name]
        same.leave(register, same.servo.register(name))
        left.leave(register, values(register)[-1])
    np.testing.assert_allclose(swung(left), swung(same), rtol=0, atol=1e-9)  # goals that were written round differently


@pytest.mark.parametrize("model", MODELS)
def test_indirect_addresses_of_another_client(model: str, tmp_path: Path) -> None:
    reference = swung(Bench(MODELS[model], tmp_path))
    bench = Bench(MODELS[model], tmp_path)
    port, packets = bench.ports.servo_port, PacketHandler(2.0)
    assert port.openPort()
    for block in MODELS[model].indirect:
        for entry in range(block.count):
            assert packets.write2ByteTxRx(port, 1, block.address + 2 * entry, 146) == (COMM_SUCCESS, 0)
    port.closePort()
    np.testing.assert_allclose(swung(bench), reference, rtol=0, atol=1e-9)
    assert MODELS[model].indirect[0].count >= MAPPED
    assert {rule.seen for rule in INDIRECT.values()} == {Seen.WRITTEN, Seen.FREE}


def test_a_tripped_watchdog_does_not_matter(tmp_path: Path) -> None:
    bench = Bench(MODELS["XL330-M288-T"], tmp_path)
    registers = bench.model.registers
    for name, value in ((Name.TORQUE_ENABLE, 1), (Name.BUS_WATCHDOG, 1)):
        bench.leave(registers[name], value)
    bench.ports.clock.sleep_until(0.5)
    assert bench.servo.register(Name.BUS_WATCHDOG) == -1
    bench.leave(registers[Name.TORQUE_ENABLE], 0)
    robot = bench.robot()
    robot.open()
    robot.torque(True)
    assert bench.servo.register(Name.BUS_WATCHDOG) == 10
    robot.close()


def test_a_hop_lands_where_it_did_with_all_that_is_free_off_its_default() -> None:
    landed = []
    for off in (False, True):
        world = EmulatedLamp(LAMP, load_calibration(ASSETS), ASSETS, Reality.none(LAMP))
        ports = Lockstep(world, LAMP.bus_baud)
        port, packets = ports.servo_port, PacketHandler(2.0)
        assert port.openPort()
        for joint, servo in zip(LAMP.joints, world.servos, strict=True):
            for register in MODELS[joint.servo].registers.values():
                if register.writable and RULES[register.name].seen is Seen.FREE:
                    value = values(register)[-1] if off else servo.register(register.name)
                    raw = list(value.to_bytes(register.size, "little", signed=value < 0))
                    assert packets.writeTxRx(port, joint.id, register.address, register.size, raw)[0] == COMM_SUCCESS
        ports.clock.sleep_until(1.0)
        robot = RobotLamp(LAMP, port, ports.foot_port, ports.clock)
        robot.open()
        path = ASSETS.named("hop-counting", "sim/lamp/controllers", "controller")
        pilot = Pilot(load_controller(path, LAMP, on_board=True), LAMP, 0.1)
        ports.clock.sleep_until(2.0)
        run(robot, pilot, LAMP, duration=2.0)
        robot.close()
        landed.append(world.plant.truth())
    assert landed[0] == landed[1]
    assert landed[0].base_x > 0.02
