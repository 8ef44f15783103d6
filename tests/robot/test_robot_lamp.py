from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from dynamixel.responder import Responder
from sleeper import eventually

from robolamp.assets import Assets
from robolamp.dynamixel.registers import MODELS, Name
from robolamp.errors import BusError, RobolampError, SafetyError
from robolamp.foot.protocol import Frame, encode
from robolamp.lamp import Lamp, load_lamp
from robolamp.robot import preflight
from robolamp.robot import robot_lamp as robot
from robolamp.robot.robot_lamp import RobotLamp
from robolamp.runtime.clock import MonotonicClock
from robolamp.signals import Command

pytestmark = pytest.mark.realtime

LAMP = load_lamp(Assets())
PATIENCE = 0.2  # s: a test machine may be busy


class Foot:
    """A foot sensor that sends a frame whenever it is asked."""

    def __init__(self) -> None:
        self.sequence = 0
        self.alive = True
        self.force = 2.06
        self.disconnected = False
        self.saturated = False
        self.gone = False

    def read(self, size: int) -> bytes:
        if self.gone:
            raise OSError(5, "Input/output error")
        if not self.alive:
            return b""
        self.sequence += 1
        microseconds = time.monotonic_ns() // 1000 % 2**32
        return encode(Frame(self.sequence, microseconds, self.force, self.saturated, self.disconnected))

    def close(self) -> None:
        pass


@pytest.fixture
def line() -> Iterator[Responder]:
    with Responder() as responder:
        yield responder


@pytest.fixture
def foot() -> Foot:
    return Foot()


def robot_lamp(line: Responder, foot: Foot, lamp: Lamp = LAMP) -> RobotLamp:
    return RobotLamp(lamp, line.name, foot, MonotonicClock(), patience=PATIENCE)


@pytest.fixture
def ready(line: Responder, foot: Foot) -> Iterator[RobotLamp]:
    backend = robot_lamp(line, foot)
    backend.open()
    yield backend
    backend.close()


def test_open_writes_the_health_blocks_and_that_all_is_answered(line: Responder, ready: RobotLamp) -> None:
    assert {instruction for _, instruction, _ in line.heard} == {0x01, 0x02, 0x03, 0x82, 0x8A}
    assert {int.from_bytes(p[:2], "little") for _, instruction, p in line.heard if instruction == 0x03} == {68, 168}
    assert ready.joints == ("ankle", "knee", "neck")


def test_a_tick_is_one_reading_and_one_write(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    line.heard.clear()
    ready.observe()
    ready.command(Command(np.zeros(3)))
    ready.observe()
    assert [instruction for _, instruction, _ in line.heard] == [0x8A, 0x83, 0x8A]


def test_an_alert_without_a_reason_is_a_fault(line: Responder, ready: RobotLamp) -> None:
    line.servos[2].error = 0x80
    assert ready.observe().faults == ("knee: error byte 0x80",)
    line.servos[2][Name.HARDWARE_ERROR_STATUS] = 0x20
    assert ready.observe().faults == ()  # the guards speak of it


def test_a_servo_that_reboots_shows_its_torque_off(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    line.servos[2].boot()
    seen = ready.observe()
    assert seen.health.torque.tolist() == [1, 0, 1]
    assert seen.angle == pytest.approx(np.zeros(3), abs=1e-6)


def test_careful_runs_have_less_duty(line: Responder, foot: Foot) -> None:
    backend = RobotLamp(LAMP, line.name, foot, MonotonicClock(), patience=PATIENCE, duty=0.4)
    backend.open()
    backend.torque(True)
    assert [line.servos[i][Name.GOAL_PWM] for i in (1, 2, 3)] == [354] * 3
    backend.close()


def test_the_foot_is_tared_and_scaled(line: Responder, foot: Foot) -> None:
    backend = robot_lamp(line, foot, dataclasses.replace(LAMP, foot_tare=0.06, foot_scale=1.5))
    backend.open()
    assert backend.observe().foot_force == pytest.approx(3.0)
    backend.close()


def test_wrong_settings_are_mended_on_demand(line: Responder, foot: Foot) -> None:
    wrong = {
        Name.OPERATING_MODE: 16,
        Name.DRIVE_MODE: 4,
        Name.RETURN_DELAY_TIME: 250,
        Name.PWM_LIMIT: 400,
        Name.SHUTDOWN: 0,
        Name.TEMPERATURE_LIMIT: 100,
        Name.MAX_POSITION_LIMIT: 2100,
    }
    for name, value in wrong.items():
        line.servos[2][name] = value
    with pytest.raises(SafetyError, match=r"Return Delay Time\(9\) is 250, not 0 .*--fix mends") as caught:
        robot_lamp(line, foot).open()
    assert all(name in str(caught.value) for name in list(wrong)[:-1])
    backend = RobotLamp(LAMP, line.name, foot, MonotonicClock(), patience=PATIENCE, fix=True)
    backend.open()
    backend.close()
    assert len(backend.mended) == len(wrong)
    right = {**{name: MODELS["XL330-M288-T"][name].initial for name in wrong}, Name.RETURN_DELAY_TIME: 0}
    low, high = line.servos[2][Name.MIN_POSITION_LIMIT], line.servos[2][Name.MAX_POSITION_LIMIT]
    assert (low, high) == (1529, 2710)  # as hardware/README.md has it for the knee
    assert {name: line.servos[2][name] for name in wrong if name is not Name.MAX_POSITION_LIMIT} == {
        name: value for name, value in right.items() if name is not Name.MAX_POSITION_LIMIT
    }


def test_a_servo_that_does_not_give_its_table_whole_is_read_register_by_register(line: Responder, foot: Foot) -> None:
    line.servos[2].deaf_blocks.add(59)  # between two registers
    line.servos[2][Name.VELOCITY_LIMIT] = 7
    with pytest.raises(SafetyError, match=r"not ready: knee \(id 2\): Velocity Limit\(44\) is 7, not 445 "):
        robot_lamp(line, foot).open()


def test_fix_does_not_hide_what_it_cannot_mend(line: Responder, foot: Foot) -> None:
    line.servos[1][Name.RETURN_DELAY_TIME] = 250
    line.servos[3][Name.PRESENT_TEMPERATURE] = 60
    with pytest.raises(SafetyError, match=r"not ready: neck \(id 3\): has 60 degC, more than 55; let it cool$"):
        RobotLamp(LAMP, line.name, foot, MonotonicClock(), patience=PATIENCE, fix=True).open()
    assert line.servos[1][Name.RETURN_DELAY_TIME] == 0


def test_a_slow_adapter_is_named_and_mended(
    line: Responder, foot: Foot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preflight, "SYSFS", tmp_path)
    timer = tmp_path / Path(line.name).name / "latency_timer"
    timer.parent.mkdir()
    timer.write_text("16\n")
    with pytest.raises(SafetyError, match=r"latency timer is 16 ms, not 1; `echo 1 \| sudo tee .*latency_timer`"):
        robot_lamp(line, foot).open()
    backend = RobotLamp(LAMP, line.name, foot, MonotonicClock(), patience=PATIENCE, fix=True)
    backend.open()
    backend.close()
    assert timer.read_text() == "1\n"


def test_old_firmware_is_noticed_and_works(line: Responder, foot: Foot) -> None:
    line.servos[3][Name.FIRMWARE_VERSION] = 45
    backend = robot_lamp(line, foot)
    backend.open()
    assert np.isfinite(backend.observe().angle).all()
    backend.close()
    assert len(backend.notices) == 1
    assert backend.notices[0].startswith("neck (id 3): firmware 45 does not know Fast Sync Read")


def test_reconnecting_needs_every_servo(line: Responder, ready: RobotLamp) -> None:
    assert ready.reconnect()
    assert np.isfinite(ready.observe().angle).all()
    line.servos[2].silent = True
    with pytest.raises(BusError, match=r"knee \(id 2\) does not answer to a ping"):
        ready.reconnect()
    line.servos[2].silent = False
    assert ready.reconnect()


def test_observation_in_joint_terms(line: Responder, ready: RobotLamp) -> None:
    for servo in line.servos.values():
        servo[Name.PRESENT_POSITION] = 2048 + 100
        servo[Name.PRESENT_VELOCITY] = 50
        servo[Name.PRESENT_CURRENT] = 120
        servo[Name.PRESENT_PWM] = 88
    seen = ready.observe()
    mirrored = np.array([1, -1, 1])
    assert seen.angle == pytest.approx(mirrored * 100 * 2 * math.pi / 4096, abs=1e-6)
    assert np.sign(seen.velocity).tolist() == np.sign(seen.current).tolist() == mirrored.tolist()
    assert np.sign(seen.health.pwm).tolist() == mirrored.tolist()
    assert seen.foot_force == 2.06
    assert seen.faults == ()


def test_what_is_observed_is_fresh(ready: RobotLamp) -> None:
    def fresh() -> bool:
        seen = ready.observe()
        return seen.foot_age < 0.1 and bool((seen.angle_age < 0.1).all())

    assert eventually(fresh)  # a busy machine may be late, though not each time


def test_goals_arrive_mirrored_where_mounted_mirrored(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    ready.command(Command(np.array([0.1, 0.1, -0.1])))
    ready.observe()
    assert [line.servos[i][Name.GOAL_POSITION] - 2048 for i in (1, 2, 3)] == [65, -65, -65]


def test_torque_on_then_off(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    assert ready.observe().health.torque.tolist() == [1, 1, 1]
    assert [line.servos[i][Name.POSITION_P_GAIN] for i in (1, 2, 3)] == [800, 800, 800]
    assert [line.servos[i][Name.BUS_WATCHDOG] for i in (1, 2, 3)] == [10, 10, 10]
    ready.close()
    assert [line.servos[i][Name.TORQUE_ENABLE] for i in (1, 2, 3)] == [0, 0, 0]
    assert ready.left_on == ()
    ready.close()


def test_a_servo_that_refuses_torque_leaves_none_on(line: Responder, ready: RobotLamp) -> None:
    line.servos[3].refuse[64] = 7
    with pytest.raises(BusError, match=r"neck \(id 3\) refuses 1 for Torque Enable\(64\)"):
        ready.torque(True)
    assert [line.servos[i][Name.TORQUE_ENABLE] for i in (1, 2)] == [0, 0]
    assert ready.left_on == ("neck",)


def test_gaps_grow_old_and_are_named(line: Responder, ready: RobotLamp) -> None:
    line.servos[2].silent = True
    first, second = ready.observe(), ready.observe()
    for seen in (first, second):
        assert np.isnan(seen.angle).tolist() == [False, True, False]
        assert seen.faults == ("knee: no answer",)
    assert second.angle_age[1] > first.angle_age[1] > 0.8 * PATIENCE
    line.servos[2].silent = False
    assert ready.observe().angle_age[1] < second.angle_age[1]


def test_a_bus_that_goes_away_is_all_gaps(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    line.unplug()
    seen = ready.observe()
    assert np.isnan(seen.angle).all()
    assert (seen.health.torque == -1).all()
    assert len(seen.faults) == 1
    assert seen.faults[0].startswith("bus: the port is gone")
    with pytest.raises(BusError, match="the port is gone"):
        ready.command(Command(np.zeros(3)))
    ready.torque(False)
    assert ready.left_on == LAMP.names


def test_a_foot_that_goes_away_keeps_the_servos(foot: Foot, ready: RobotLamp) -> None:
    foot.gone = True
    seen = ready.observe()
    assert np.isfinite(seen.angle).all()
    assert seen.faults[0].startswith("foot: the port is gone")
    assert seen.foot_force == 2.06
    assert ready.observe().foot_age > seen.foot_age


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 0.79, -1.01, 1e300])
def test_no_goal_outside_the_limits_is_sent(line: Responder, ready: RobotLamp, bad: float) -> None:
    ready.torque(True)
    line.heard.clear()
    with pytest.raises(SafetyError, match=r"of knee is not from -1 to 0\.78 rad"):
        ready.command(Command(np.array([0.0, bad, 0.0])))
    ready.command(Command(LAMP.upper))
    ready.command(Command(LAMP.lower))
    ready.observe()
    assert [instruction for _, instruction, _ in line.heard].count(0x83) == 2


def test_a_tripped_watchdog_is_named(line: Responder, ready: RobotLamp, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot, "WATCHDOG", 0.0)  # silence that is too long
    ready.torque(True)
    ready.command(Command(np.zeros(3)))
    line.servos[2][Name.BUS_WATCHDOG] = -1
    with pytest.raises(SafetyError, match="Bus Watchdog has stopped knee"):
        ready.command(Command(np.zeros(3)))


def test_a_reading_after_the_silence_does_not_hide_it(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    ready.observe()
    ready.command(Command(np.zeros(3)))
    time.sleep(robot.WATCHDOG + 0.05)
    line.servos[1][Name.BUS_WATCHDOG] = line.servos[3][Name.BUS_WATCHDOG] = -1
    ready.observe()
    with pytest.raises(SafetyError, match=r"Bus Watchdog has stopped ankle, neck: nothing was sent for \d+\.\d\d s"):
        ready.command(Command(np.zeros(3)))
    ready.torque(False)
    ready.torque(True)
    ready.observe()
    ready.command(Command(np.zeros(3)))


def test_a_silence_that_tripped_nothing_is_forgiven(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    time.sleep(robot.WATCHDOG + 0.05)
    ready.observe()
    ready.command(Command(np.zeros(3)))
    line.heard.clear()
    ready.observe()
    ready.command(Command(np.zeros(3)))
    ready.observe()
    assert 0x02 not in [instruction for _, instruction, _ in line.heard]  # the servos are not asked again


@pytest.fixture
def direct(line: Responder, foot: Foot) -> Iterator[RobotLamp]:
    """Servos without health blocks: read in two steps."""
    for servo in line.servos.values():
        servo.indirect = False
    backend = robot_lamp(line, foot)
    backend.open()
    yield backend
    backend.close()


def test_an_unknown_condition_is_a_fault_when_it_lasts(line: Responder, direct: RobotLamp) -> None:
    line.servos[2].deaf_blocks.add(64)
    seen = [direct.observe() for _ in range(6)]
    assert all(np.isfinite(one.angle).all() for one in seen)
    assert [one.faults for one in seen] == [()] * 4 + [("knee: condition unknown",)] * 2
    line.servos[2].deaf_blocks.clear()
    assert direct.observe().faults == ()


def test_an_unknown_condition_is_not_forgotten_when_an_answer_is_lost(line: Responder, direct: RobotLamp) -> None:
    line.servos[2].deaf_blocks.add(64)
    faults = []
    for silent in (False, False, False, True, True, False, False, True):
        line.servos[2].silent = silent
        faults.append([text.removeprefix("knee: ") for text in direct.observe().faults if text.startswith("knee: ")])
    lost, unknown = ["no answer"], ["condition unknown"]
    assert faults == [[], [], [], lost, lost, [], unknown, lost]


def test_a_goal_is_known_to_have_arrived_only_where_it_was_read(line: Responder, ready: RobotLamp) -> None:
    ready.torque(True)
    ready.command(Command(np.zeros(3)))
    assert ready.observe().health.goal.tolist() == [1, 1, 1]
    line.servos[2][Name.GOAL_POSITION] += 1
    line.servos[3].silent = True
    assert ready.observe().health.goal.tolist() == [1, 0, -1]
    ready.torque(False)
    assert ready.observe().health.goal.tolist() == [-1, -1, -1]


def test_an_angle_is_as_old_as_its_reading(line: Responder, direct: RobotLamp) -> None:
    line.servos[2].deaf_blocks.add(64)  # the second block waits for it, after the angles were read
    assert (direct.observe().angle_age > PATIENCE).all()


def spoil(name: Name, value: int) -> Callable[[Responder, Foot], None]:
    def apply(line: Responder, foot: Foot) -> None:
        line.servos[2][name] = value

    return apply


def silence(line: Responder, foot: Foot) -> None:
    line.servos[2].silent = True


def deafen(line: Responder, foot: Foot) -> None:
    line.servos[2].deaf_to.add(0x82)


def kill_foot(line: Responder, foot: Foot) -> None:
    foot.alive = False


def lift(line: Responder, foot: Foot) -> None:
    foot.force = 0.1


def unplug_cell(line: Responder, foot: Foot) -> None:
    foot.disconnected = True


@pytest.mark.parametrize(
    ("harm", "kind", "said"),
    [
        (silence, BusError, r"knee \(id 2\) does not answer to a ping at 1000000 baud"),
        (deafen, BusError, r"knee \(id 2\) answers to a ping, but not to a sync read"),
        (kill_foot, BusError, r"no foot sensor: nothing came in 0\.5 s"),
        (lift, SafetyError, r"shows 0\.10 N, a standing lamp 0\.4 to 10 N; .*setup foot"),
        (unplug_cell, SafetyError, "load cell is not connected"),
        (spoil(Name.MODEL_NUMBER, 1190), SafetyError, r"knee \(id 2\) is XL330-M077-T; lamp\.toml says XL330-M288-T"),
        (spoil(Name.MODEL_NUMBER, 77), SafetyError, r"knee \(id 2\) is model number 77"),
        (spoil(Name.OPERATING_MODE, 16), SafetyError, r"knee \(id 2\): Operating Mode\(11\) is 16, not 3 .*write 3"),
        (spoil(Name.DRIVE_MODE, 1), SafetyError, r"knee \(id 2\): Drive Mode\(10\) is 1, not 0"),
        (
            spoil(Name.MAX_POSITION_LIMIT, 2100),
            SafetyError,
            r"outside its Position Limits \(52, 48\) of 0\.00 to 3\.22",
        ),
        (spoil(Name.HARDWARE_ERROR_STATUS, 0x20), SafetyError, r"0x20 \(overload\); find the cause"),
        (spoil(Name.PRESENT_INPUT_VOLTAGE, 30), SafetyError, r"has 3\.0 V, outside its limits of 3\.5 to 7\.0 V"),
        (spoil(Name.PRESENT_POSITION, 1024), SafetyError, r"knee .*stands at 1\.57 rad, outside -1\.17 to 0\.95; put"),
    ],
)
def test_preflight_names_what_is_wrong(
    line: Responder, foot: Foot, harm: Callable[[Responder, Foot], None], kind: type[RobolampError], said: str
) -> None:
    harm(line, foot)
    backend = robot_lamp(line, foot)
    with pytest.raises(kind, match=said) as caught:
        backend.open()
    assert caught.value.where in {line.name, "Foot"}
    assert "\n" not in str(caught.value)
    assert 0x03 not in {instruction for _, instruction, _ in line.heard}  # nothing is written
    backend.close()


def test_preflight_names_everything_at_once(line: Responder, foot: Foot) -> None:
    line.servos[1][Name.OPERATING_MODE] = 4
    line.servos[3][Name.PRESENT_INPUT_VOLTAGE] = 71
    with pytest.raises(SafetyError, match=r"ankle \(id 1\): Operating Mode.*; neck \(id 3\): has 7\.1 V"):
        robot_lamp(line, foot).open()


def test_a_range_across_the_seam_is_refused(line: Responder, foot: Foot) -> None:
    joints = (dataclasses.replace(LAMP.joints[0], zero=0.2), *LAMP.joints[1:])
    with pytest.raises(SafetyError, match=r"range is -0\.40 to 0\.80 rad .*does not cross 0"):
        robot_lamp(line, foot, dataclasses.replace(LAMP, joints=joints)).open()


def test_before_open_there_are_only_gaps() -> None:
    backend = RobotLamp(LAMP, "/dev/no-such-port", "/dev/no-such-foot", MonotonicClock())
    assert np.isnan(backend.observe().angle).all()
    assert (backend.observe().angle_age == math.inf).all()
    with pytest.raises(BusError, match="not open"):
        backend.command(Command(np.zeros(3)))
    backend.torque(False)
    backend.close()
