"""Who answers: two servos with one id, servos with another id or rate, and one that says little."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import pytest
from contract.backends import LAMP

from robolamp.assets import Assets
from robolamp.calibration import load_calibration
from robolamp.dynamixel.bus import Bus
from robolamp.dynamixel.registers import MODELS, HardwareError, Name
from robolamp.dynamixel.servos import Servos
from robolamp.emulator.bare_servos import BareServos
from robolamp.emulator.bare_servos_file import BareServo
from robolamp.emulator.emulated_lamp import EmulatedLamp
from robolamp.emulator.faults.script import Event, Faults, Rates
from robolamp.emulator.ports.lockstep import Lockstep
from robolamp.emulator.reality.file import Reality
from robolamp.errors import BusError, RobolampError, SafetyError
from robolamp.lamp import Lamp
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.robot.setup import assign, check_strangers, scan

ASSETS = Assets()
A, C = "XL330-M288-T", "XL430-W250-T"
DOUBLED = "several servos answer to this id"


def servo(
    id: int = 1, model: str = A, *, baud: int = 1_000_000, delay: float = 0.0, position: float = 3.1
) -> BareServo:
    return BareServo(model, id, baud, delay, position, 5.0 if model == A else 11.1, 0.0)


TWO = {
    "alike": (servo(), servo()),
    "that stand elsewhere": (servo(), servo(position=2.0)),
    "of two models": (servo(), servo(model=C)),
    "one of which waits longer": (servo(), servo(delay=0.0005)),
    "one of which waits a little longer": (servo(), servo(delay=0.00002)),
    "that both wait": (servo(delay=0.0005), servo(delay=0.0005)),
}


@pytest.mark.parametrize("servos", TWO.values(), ids=TWO)
@pytest.mark.parametrize("baud", [57_600, 1_000_000])
def test_two_servos_with_one_id_are_seen_and_nothing_is_written(servos: Sequence[BareServo], baud: int) -> None:
    world = BareServos([dataclasses.replace(each, baud=baud) for each in servos])
    ports = Lockstep(world, baud)
    found = scan(ports.servo_port, ports.clock, rates=(baud,), last=3)
    assert [(each.id, each.doubled) for each in found] == [(1, True)]
    before = [[each.register(name) for name in (Name.ID, Name.RETURN_DELAY_TIME)] for each in world.servos]
    with pytest.raises(SafetyError, match=DOUBLED):
        assign(ports.servo_port, ports.clock, found[0], 2, 1_000_000)
    after = [[each.register(name) for name in (Name.ID, Name.RETURN_DELAY_TIME)] for each in world.servos]
    assert after == before


@pytest.mark.parametrize("baud", [57_600, 1_000_000])
def test_servos_with_ids_of_their_own_are_not_taken_for_two(baud: int) -> None:
    ports = Lockstep(BareServos([servo(1, baud=baud), servo(2, C, baud=baud, delay=0.0005)]), baud)
    assert [(each.id, each.doubled) for each in scan(ports.servo_port, ports.clock, rates=(baud,), last=3)] == [
        (1, False),
        (2, False),
    ]


def test_a_line_that_loses_and_doubles_packets_is_no_second_servo() -> None:
    for seed in range(10):
        rates = Rates(dropped=0.06, duplicated=0.1, corrupted=0.02)
        ports = Lockstep(BareServos([servo()], faults=Faults("noise", seed, {"status": rates})), 1_000_000)
        bus = Bus(ports.servo_port, 1_000_000, ports.clock)
        bus.open()
        assert not bus.doubled(1)


def test_a_servo_that_would_obey_too_is_named_before_anything_is_written() -> None:
    world = BareServos([servo(5), servo(2)])
    world.servos[1].put(Name.SHADOW_ID, 5)
    ports = Lockstep(world, 1_000_000)
    found = scan(ports.servo_port, ports.clock, rates=(1_000_000,), last=6)
    with pytest.raises(SafetyError, match=r"servo 2: Secondary\(Shadow\) ID\(12\) is 5, not 255"):
        assign(ports.servo_port, ports.clock, found[1], 1, 1_000_000, found)
    assert [each.id for each in world.servos] == [5, 2]


@pytest.mark.parametrize("level", [0, 1])
def test_a_servo_that_confirms_nothing_is_not_renumbered(level: int) -> None:
    world = BareServos([servo(5)])
    world.servos[0].put(Name.STATUS_RETURN_LEVEL, level)
    ports = Lockstep(world, 1_000_000)
    (found,) = scan(ports.servo_port, ports.clock, rates=(1_000_000,), last=6)
    with pytest.raises(SafetyError, match=rf"servo 5: Status Return Level\(68\) is {level}, not 2"):
        assign(ports.servo_port, ports.clock, found, 1, 1_000_000)
    assert world.servos[0].id == 5


def test_a_second_servo_that_answers_no_reads_is_found_before_anything_is_renumbered() -> None:
    world = BareServos([servo(), servo(position=2.0)])
    world.servos[1].put(Name.STATUS_RETURN_LEVEL, 0)
    ports = Lockstep(world, 1_000_000)
    (found,) = scan(ports.servo_port, ports.clock, rates=(1_000_000,), last=3)
    with pytest.raises(SafetyError, match=DOUBLED):
        assign(ports.servo_port, ports.clock, found, 2, 1_000_000)
    assert [each.id for each in world.servos] == [1, 1]


def rig(*events: Event, lamp: Lamp = LAMP, volts: float = 0.0) -> tuple[EmulatedLamp, Lockstep]:
    reality = dataclasses.replace(Reality.none(lamp), supply=volts)
    faults = Faults("script", events=events)
    world = EmulatedLamp(lamp, load_calibration(ASSETS), ASSETS, reality, faults=faults)
    return world, Lockstep(world, lamp.bus_baud)


def refused(ports: Lockstep, *, fix: bool = False, lamp: Lamp = LAMP) -> RobolampError:
    robot = RobotLamp(lamp, ports.servo_port, ports.foot_port, ports.clock, fix=fix)
    with pytest.raises(RobolampError) as caught:
        robot.open()
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_second_servo_that_answers_no_reads_is_found_before_a_run() -> None:
    world = BareServos([servo(joint.id, position=joint.zero) for joint in LAMP.joints] + [servo(2, position=2.0)])
    world.servos[3].put(Name.STATUS_RETURN_LEVEL, 0)
    ports = Lockstep(world, 1_000_000)
    robot = RobotLamp(LAMP, ports.servo_port, None, ports.clock)
    with pytest.raises(SafetyError, match=rf"knee \(id 2\): {DOUBLED}"):
        robot.open()
    assert not any(each.register(Name.TORQUE_ENABLE) for each in world.servos)


def test_a_stranger_that_would_obey_what_a_joint_is_told_is_named() -> None:
    world = BareServos([servo(joint.id) for joint in LAMP.joints] + [servo(9), servo(10, C)])
    ports = Lockstep(world, 1_000_000)
    check_strangers(ports.servo_port, ports.clock, LAMP)
    for stranger in world.servos[3:]:
        stranger.put(Name.SHADOW_ID, 2)
    said = r"servo 9, which is no joint's.*obey what is written to the knee.*servo 10, which is no joint's"
    with pytest.raises(SafetyError, match=said):
        check_strangers(ports.servo_port, ports.clock, LAMP)


@pytest.mark.parametrize("fix", [False, True])
def test_two_joints_with_one_id_are_named_and_nothing_is_mended(fix: bool) -> None:
    world, ports = rig()
    world.servos[0].put(Name.ID, 2)
    world.servos[2].put(Name.DRIVE_MODE, 4)
    said = str(refused(ports, fix=fix))
    assert f"knee (id 2): {DOUBLED}" in said
    assert "ankle (id 1) does not answer to a ping" in said
    assert "neck (id 3): Drive Mode(10) is 4, not 0" in said
    assert world.servos[2].register(Name.DRIVE_MODE) == 4


def test_all_that_is_wrong_is_named_at_once() -> None:
    models = (C, "XL330-M077-T", A)
    joints = tuple(dataclasses.replace(joint, servo=model) for joint, model in zip(LAMP.joints, models, strict=True))
    world, ports = rig()
    world.servos[2].put(Name.TEMPERATURE_LIMIT, 40)
    world.servos[2].put(Name.VELOCITY_LIMIT, 100)
    said = str(refused(ports, lamp=dataclasses.replace(LAMP, joints=joints)))
    for text in (
        "ankle (id 1) is XL330-M288-T; lamp.toml says XL430-W250-T",
        "knee (id 2) is XL330-M288-T; lamp.toml says XL330-M077-T",
        "Temperature Limit(31) is 40, not 70",
        "Velocity Limit(44) is 100, not 445",
    ):
        assert text in said


def test_a_lamp_at_another_rate_says_so() -> None:
    world, ports = rig()
    for one in world.servos:
        one.put(Name.BAUD_RATE, 1)
    error = refused(ports)
    assert isinstance(error, BusError)
    for joint in LAMP.joints:
        text = f"{joint.name} (id {joint.id}) does not answer to a ping at 1000000 baud; it answers at 57600 baud"
        assert text in error.message
    assert "Baud Rate(8) is 1, not 3" in error.message


def test_a_servo_with_another_id_is_found() -> None:
    world, ports = rig()
    world.servos[1].put(Name.ID, 77)
    assert "id 77 answers, which is no joint's: ID(7) is 77, not 2? `robolamp setup assign --joint knee`" in str(
        refused(ports)
    )


def test_a_new_servo_is_recognised() -> None:
    world, ports = rig()
    world.servos[1].put(Name.ID, 1)
    world.servos[1].put(Name.BAUD_RATE, 1)
    assert "a servo answers as id 1 at 57600 baud, as new ones do" in str(refused(ports))


def test_a_servo_with_torque_on_is_not_written_to() -> None:
    world, ports = rig()
    world.servos[1].put(Name.TORQUE_ENABLE, 1)
    world.servos[1].put(Name.PWM_LIMIT, 500)
    said = str(refused(ports, fix=True))
    assert "knee (id 2): Torque Enable(64) is 1, not 0; `robolamp stop` first" in said
    assert "PWM Limit(36) is 500" in said
    assert "mended" not in said
    assert "refuses" not in said


@pytest.mark.parametrize("level", [0, 1])
def test_a_servo_that_confirms_nothing_confirms_that_its_torque_is_off(level: int) -> None:
    world, ports = rig()
    for each in world.servos:
        each.put(Name.TORQUE_ENABLE, 1)
        each.put(Name.STATUS_RETURN_LEVEL, level)
    bus = Bus(ports.servo_port, 1_000_000, ports.clock)
    bus.open()
    models = [MODELS[joint.servo] for joint in LAMP.joints]
    assert Servos(bus, [joint.id for joint in LAMP.joints], models).torque_off() == ()
    assert [each.register(Name.TORQUE_ENABLE) for each in world.servos] == [0, 0, 0]


@pytest.mark.parametrize(("volts", "limit"), [(3.6, 35), (3.6, 31), (3.2, 31)])
def test_a_supply_too_low_is_not_ready_whatever_the_servos_allow(volts: float, limit: int) -> None:
    world, ports = rig(volts=volts - 5.0)
    for one in world.servos:
        one.put(Name.MIN_VOLTAGE_LIMIT, limit)
    said = str(refused(ports, fix=True))
    for joint in LAMP.joints:
        assert f"{joint.name} (id {joint.id}): has {volts:.1f} V, " in said


@pytest.mark.parametrize("delay", [0.003, 0.08, 0.1])
def test_answers_that_are_late_before_the_start_are_waited_for(delay: float) -> None:
    late = Rates(late=1.0, late_by=delay)
    world = EmulatedLamp(
        LAMP,
        load_calibration(ASSETS),
        ASSETS,
        Reality.none(LAMP),
        faults=Faults("late", 1, {"status": late, "instruction": late}),
    )
    ports = Lockstep(world, LAMP.bus_baud)
    robot = RobotLamp(LAMP, ports.servo_port, ports.foot_port, ports.clock)
    robot.open()
    robot.close()


def test_a_pose_that_the_servo_would_not_hold_is_named() -> None:
    """It is inside what the preflight allows of an angle, and outside the servo's Position Limits."""
    knee = dataclasses.replace(LAMP.joints[1], lower=0.1, zero=LAMP.joints[1].zero)
    lamp = dataclasses.replace(LAMP, joints=(LAMP.joints[0], knee, LAMP.joints[2]))
    world, ports = rig(lamp=lamp)
    world.servos[1].put(Name.MAX_POSITION_LIMIT, 2000)
    world.servos[1].put(Name.MIN_POSITION_LIMIT, 1500)
    said = str(refused(ports, lamp=lamp))
    assert "knee (id 2): stands at 3.14 rad of the servo's turn, outside its Position Limits (52, 48)" in said


class Replugged:
    """A lamp in lockstep whose servo port goes away; what happens meanwhile is the test's."""

    def __init__(self, *ports: str) -> None:
        gone = [Event("unplugged", at=1.0, lasts=0.5, port=port) for port in ports or ("servo",)]
        self.world, self.ports = rig(*gone)
        self.robot = RobotLamp(LAMP, self.ports.servo_port, self.ports.foot_port, self.ports.clock)
        self.robot.open()
        self.robot.torque(True)
        self.ports.clock.sleep_until(1.1)
        self.robot.observe()
        with pytest.raises(BusError):
            self.robot.reconnect()
        self.ports.clock.sleep_until(1.6)


def test_a_lamp_that_comes_back_as_it_was_is_taken_up_with_its_foot() -> None:
    lamp = Replugged("servo", "foot")
    assert lamp.robot.reconnect()
    lamp.robot.torque(True)
    seen = lamp.robot.observe()
    assert seen.faults == ()
    assert seen.foot_force == pytest.approx(2.1, abs=0.3)
    assert seen.foot_age < 0.05
    lamp.robot.close()


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        (Name.MODEL_NUMBER, 1190, "knee (id 2) is XL330-M077-T"),
        (Name.DRIVE_MODE, 1, "Drive Mode(10) is 1, not 0"),
        (Name.SHADOW_ID, 1, "Secondary(Shadow) ID(12) is 1, not 255"),
        (Name.ID, 1, "ankle (id 1): several servos answer"),
        (Name.STATUS_RETURN_LEVEL, 0, "Status Return Level(68) is 0, not 2"),
    ],
)
def test_a_lamp_that_comes_back_otherwise_is_refused(name: Name, value: int, said: str) -> None:
    lamp = Replugged()
    lamp.world.servos[1].put(name, value)
    if name is Name.ID:
        with pytest.raises(BusError, match=r"knee \(id 2\) does not answer to a ping"):
            lamp.robot.reconnect()
    else:
        with pytest.raises(SafetyError) as caught:
            lamp.robot.reconnect()
        assert said in str(caught.value)
    lamp.robot.close()


def test_an_error_after_a_replug_is_found() -> None:
    lamp = Replugged()
    lamp.world.servos[0].fail(HardwareError.OVERLOAD)
    with pytest.raises(SafetyError, match=r"ankle \(id 1\): Hardware Error Status\(70\) is 0x20"):
        lamp.robot.reconnect()
    lamp.robot.close()


def test_what_cannot_be_kept_is_not_mended(tmp_path: Path) -> None:
    """A lamp.toml inside the installed package cannot hold that zeros are wanted."""
    world, ports = rig()
    world.servos[1].put(Name.HOMING_OFFSET, 10)
    lamp = dataclasses.replace(LAMP, path=tmp_path / "_assets" / "hardware" / "lamp.toml")
    said = str(refused(ports, fix=True, lamp=lamp))
    assert "is part of the installed package; give a folder of your own with --lamp" in said
    assert world.servos[1].register(Name.HOMING_OFFSET) == 10
