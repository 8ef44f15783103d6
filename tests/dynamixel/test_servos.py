from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections.abc import Iterator

import numpy as np
import pytest
from sleeper import Sleeper

from robolamp.dynamixel.bus import ATTEMPTS, Bus
from robolamp.dynamixel.registers import MODELS, RAD_PER_COUNT, VELOCITY_UNIT, IndirectBlock, Name
from robolamp.dynamixel.servos import TORQUE_OFF_ATTEMPTS, Servos
from robolamp.dynamixel.wire_time import CONDITION, STATE, Transport, wire_time
from robolamp.errors import BusError, SafetyError

from .responder import Responder
from .test_bus import Clock

pytestmark = pytest.mark.realtime

GAINS = (800, 700, 600)


@pytest.fixture
def line() -> Iterator[Responder]:
    with Responder() as responder:
        yield responder


def on(line: Responder, model: str = "XL330-M288-T") -> tuple[Bus, Servos]:
    bus = Bus(line.name, 1_000_000, Clock(), patience=0.2)
    bus.open()
    return bus, Servos(bus, [1, 2, 3], [MODELS[model]] * 3)


@pytest.fixture
def servos(line: Responder) -> Iterator[Servos]:
    bus, servos = on(line)
    yield servos
    bus.close()


def test_state_in_si_units(line: Responder, servos: Servos) -> None:
    knee = line.servos[2]
    knee[Name.PRESENT_POSITION] = 1024
    knee[Name.PRESENT_VELOCITY] = -100
    knee[Name.PRESENT_CURRENT] = -250
    knee[Name.PRESENT_PWM] = 885
    knee[Name.TORQUE_ENABLE] = 1
    knee[Name.HARDWARE_ERROR_STATUS] = 0x20
    state = servos.read()
    assert state.position == pytest.approx([math.pi, math.pi / 2, math.pi])
    assert state.velocity[1] == pytest.approx(-100 * VELOCITY_UNIT)
    assert state.current[1] == pytest.approx(-0.25)
    assert state.pwm[1] == pytest.approx(1.0)
    assert state.voltage == pytest.approx([5.0] * 3)
    assert state.temperature.tolist() == [31.0] * 3
    assert state.torque.tolist() == [0, 1, 0]
    assert state.hardware_error.tolist() == [0, 0x20, 0]


def test_a_silent_servo_is_a_gap_never_zero(line: Responder, servos: Servos) -> None:
    line.servos[3].silent = True
    state = servos.read()
    assert np.isnan([state.position[2], state.velocity[2], state.current[2], state.voltage[2]]).all()
    assert (state.torque[2], state.hardware_error[2]) == (-1, -1)
    assert np.isfinite(state.position[:2]).all()


def test_a_dead_servo_is_asked_again_once_only(line: Responder, servos: Servos) -> None:
    line.servos[3].silent = True
    servos.read()
    asked = [parameters[4:] for _, _, parameters in line.heard]
    assert asked == [bytes([1, 2, 3]), bytes([3]), bytes([1, 2])]
    line.heard.clear()
    servos.read()
    assert [parameters[4:] for _, _, parameters in line.heard] == [bytes([1, 2, 3]), bytes([1, 2])]
    line.servos[3].silent = False
    assert np.isfinite(servos.read().position).all()


def test_a_model_without_current_sensor_has_a_gap_there() -> None:
    with Responder(model="XL430-W250-T") as line:
        line.servos[1].memory[126:128] = b"\x64\x00"  # Present Load
        bus, servos = on(line, "XL430-W250-T")
        state = servos.read()
        bus.close()
    assert np.isnan(state.current).all()
    assert np.isfinite(state.position).all()


def test_goals(line: Responder, servos: Servos) -> None:
    servos.write_goals(np.array([0.0, math.pi, 4095 * RAD_PER_COUNT]))
    servos.read()  # an answer: the goals before it have arrived
    assert [line.servos[i][Name.GOAL_POSITION] for i in (1, 2, 3)] == [0, 2048, 4095]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -0.01, 2 * math.pi, 1e300])
def test_no_goal_outside_the_turn_is_sent(line: Responder, servos: Servos, bad: float) -> None:
    with pytest.raises(SafetyError, match=r"goal .* of servo 2 is not inside its turn"):
        servos.write_goals(np.array([1.0, bad, 1.0]))
    assert line.heard == []


def test_torque_on_goes_to_the_present_goal_first(line: Responder, servos: Servos) -> None:
    line.servos[2][Name.PRESENT_POSITION] = 1500
    line.servos[2][Name.PROFILE_VELOCITY] = 50
    line.servos[2][Name.BUS_WATCHDOG] = -1
    servos.torque_on(GAINS, watchdog=0.2)
    knee = line.servos[2]
    assert knee[Name.GOAL_POSITION] == 1500
    assert (knee[Name.TORQUE_ENABLE], knee[Name.PROFILE_VELOCITY], knee[Name.BUS_WATCHDOG]) == (1, 0, 10)
    assert [line.servos[i][Name.POSITION_P_GAIN] for i in (1, 2, 3)] == list(GAINS)
    writes = [int.from_bytes(p[:2], "little") for i, instruction, p in line.heard if (i, instruction) == (2, 3)]
    assert writes.index(98) < writes.index(116) < writes.index(64) < len(writes) - 1 - writes[::-1].index(98)


def test_each_watchdog_is_armed_with_its_torque(line: Responder, servos: Servos) -> None:
    servos.torque_on(GAINS, watchdog=0.2)
    writes = [(i, p) for i, instruction, p in line.heard if instruction == 3]
    armed = [writes.index((i, bytes([98, 0, 10]))) for i in (1, 2, 3)]
    powered = [writes.index((i, bytes([64, 0, 1]))) for i in (1, 2, 3)]
    assert [a - p for a, p in zip(armed, powered, strict=True)] == [1, 1, 1]


def test_wire_time_is_that_of_the_bytes_on_the_line(line: Responder, servos: Servos) -> None:
    servos.read()
    servos.write_goals(np.full(3, 3.0))
    servos.read()  # answered after the goals have been heard
    sent = sum(10 + len(p) for _, _, p in line.heard[:3])
    answered = sum(3 * (11 + length) for _, length in (STATE, CONDITION)) + 3 / 2  # every other one is longer by a byte
    assert wire_time("tick", 3, 57_600) == pytest.approx((sent + answered) * 10 / 57_600)


def test_a_servo_that_stays_without_torque_is_named(line: Responder, servos: Servos) -> None:
    line.servos[3].stuck.add(64)
    with pytest.raises(BusError, match="servo 3 took Torque Enable 1 and stays without torque"):
        servos.torque_on(GAINS, watchdog=0.2)


def test_torque_off_reaches_the_others_when_one_is_dead(line: Responder, servos: Servos) -> None:
    servos.torque_on(GAINS, watchdog=0.2)
    line.servos[1].silent = True
    line.servos[2].error = 0x80  # an overloaded servo: alert on every answer
    assert servos.torque_off() == (0,)
    assert [line.servos[i][Name.TORQUE_ENABLE] for i in (1, 2, 3)] == [1, 0, 0]
    assert [line.servos[i][Name.BUS_WATCHDOG] for i in (2, 3)] == [0, 0]


def test_torque_off_is_told_again_to_each_servo(line: Responder, servos: Servos) -> None:
    servos.torque_on(GAINS, watchdog=0.2)
    line.servos[2].garbled = TORQUE_OFF_ATTEMPTS * ATTEMPTS - 1  # the bus asks ATTEMPTS times each time
    assert servos.torque_off() == ()
    assert [line.servos[i][Name.TORQUE_ENABLE] for i in (1, 2, 3)] == [0, 0, 0]
    assert not [id for id, _, _ in line.heard if id == 0xFE]  # nobody else is told for it


def test_torque_off_never_raises_on_a_port_that_is_gone(line: Responder, servos: Servos) -> None:
    line.unplug()
    with Sleeper() as sleeper:
        began = time.monotonic()
        assert servos.torque_off() == (0, 1, 2)
        assert time.monotonic() - began < 1.0 + sleeper.lost(began)


def test_tripped_watchdogs(line: Responder, servos: Servos) -> None:
    assert servos.watchdog_tripped() == ()
    line.servos[2][Name.BUS_WATCHDOG] = -1
    assert servos.watchdog_tripped() == (1,)


def set_apart(line: Responder) -> None:
    for number, servo in line.servos.items():
        servo[Name.PRESENT_POSITION] = 1000 + number
        servo[Name.PRESENT_VELOCITY] = -number
        servo[Name.PRESENT_PWM] = -10 * number


@pytest.mark.parametrize("model", ["XL330-M288-T", "XL430-W250-T"])
@pytest.mark.parametrize(("firmware", "way", "instruction"), [(52, Transport.FAST, 0x8A), (44, Transport.BLOCK, 0x82)])
def test_a_tick_is_one_transaction(model: str, firmware: int, way: Transport, instruction: int) -> None:
    with Responder(model=model) as line:
        set_apart(line)
        if firmware == 44 and model == "XL330-M288-T":
            for servo in line.servos.values():
                servo.model = dataclasses.replace(servo.model, indirect=(IndirectBlock(168, 224, 20, 64, 227),))
                servo.boot()
        bus, servos = on(line, model)
        before = servos.read()
        assert servos.prepare([firmware] * 3) is way
        line.heard.clear()
        after = servos.read()
        bus.close()
    assert [heard for _, heard, _ in line.heard] == [instruction]
    for name, values in vars(before).items():
        np.testing.assert_array_equal(getattr(after, name), values, err_msg=name)


def test_servos_without_indirect_registers_are_read_directly(line: Responder, servos: Servos) -> None:
    for servo in line.servos.values():
        servo.indirect = False
    assert servos.prepare([52] * 3) is Transport.DIRECT
    assert servos.read().position == pytest.approx([math.pi] * 3)


def test_servos_that_refuse_the_map_are_read_directly(line: Responder, servos: Servos) -> None:
    line.servos[2].refuse[168] = 7
    assert servos.prepare([52] * 3) is Transport.DIRECT
    assert servos.read().position == pytest.approx([math.pi] * 3)


def test_servos_deaf_to_fast_sync_read_are_read_by_sync_read(line: Responder, servos: Servos) -> None:
    line.servos[1].deaf_to.add(0x8A)
    assert servos.prepare([52] * 3) is Transport.BLOCK


def test_a_servo_that_rebooted_says_so_and_its_empty_block_is_not_believed(line: Responder, servos: Servos) -> None:
    servos.prepare([52] * 3)
    servos.torque_on(GAINS, 0.2)
    assert servos.read().torque.tolist() == [1, 1, 1]
    line.servos[2].boot()
    for _ in range(3):
        state = servos.read()
        assert state.position == pytest.approx([math.pi] * 3)
        assert state.torque.tolist() == [1, 0, 1]
    assert servos.prepare([52] * 3) is Transport.FAST


@pytest.mark.parametrize("absent", [1, 2, 3])
def test_a_servo_that_falls_silent_costs_its_own_data_only(line: Responder, servos: Servos, absent: int) -> None:
    servos.prepare([52] * 3)
    line.servos[absent].silent = True
    line.heard.clear()
    for _ in range(3):
        state = servos.read()
        assert np.isnan(state.position).tolist() == [i == absent for i in (1, 2, 3)]
        assert (state.torque[absent - 1], state.error[absent - 1]) == (-1, -1)
    others = bytes(i for i in (1, 2, 3) if i != absent)
    assert [(heard, p[4:]) for _, heard, p in line.heard[-1:]] == [(0x8A, others + bytes([absent]))]
    line.servos[absent].silent = False
    assert np.isfinite(servos.read().position).all()


def test_an_alert_comes_with_the_data(line: Responder, servos: Servos) -> None:
    servos.prepare([52] * 3)
    line.servos[3].error = 0x80
    line.servos[3][Name.HARDWARE_ERROR_STATUS] = 0x20
    state = servos.read()
    assert state.error.tolist() == [0, 0, 0x80]
    assert state.hardware_error.tolist() == [0, 0, 0x20]
    assert np.isfinite(state.position).all()


def test_readings_in_a_row_have_different_lengths(line: Responder, servos: Servos) -> None:
    """An answer to one that was given up is told from the next one's by its length."""
    for prepared in (False, True):
        if prepared:
            servos.prepare([52] * 3)
        line.heard.clear()
        for _ in range(4):
            servos.read()
        blocks = [p[:4] for _, _, p in line.heard if p[0] != 64]
        assert all(a != b for a, b in itertools.pairwise(blocks))


def test_torque_off_tells_all_at_once_what_one_does_not_confirm(line: Responder, servos: Servos) -> None:
    servos.torque_on(GAINS, watchdog=0.2)
    line.servos[1].silent = True
    line.heard.clear()
    assert servos.torque_off() == (0,)
    deadline = time.monotonic() + 5.0  # nobody answers it, so it may still be on its way
    while line.heard.count((0xFE, 0x03, bytes([64, 0, 0]))) < TORQUE_OFF_ATTEMPTS:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_goal_that_a_servo_does_not_hold_is_lost(line: Responder, servos: Servos) -> None:
    servos.prepare([52, 52, 52])
    servos.torque_on(GAINS, watchdog=0.2)
    servos.write_goals(np.full(3, 3.0))
    assert not servos.read().goal_lost.any()
    line.servos[2][Name.GOAL_POSITION] = 17
    assert servos.read().goal_lost.tolist() == [False, True, False]
    servos.torque_off()
    assert not servos.read().goal_lost.any()  # without torque a servo follows no goal
