"""Modes other than plain position control on the lamp, whose plant is the twin."""

from __future__ import annotations

import math

import pytest

from .test_emulated_lamp import Client

NECK = 3


def set_mode(client: Client, mode: int) -> None:
    client.write(NECK, 11, mode, 1)
    for id in (1, 2):
        client.write(id, 84, 800, 2)
        client.write(id, 64, 1, 1)
    client.write(NECK, 64, 1, 1)


def test_velocity_mode() -> None:
    client = Client()
    set_mode(client, 1)
    client.write(NECK, 104, 20, 4)
    client.wait(0.2)
    start = client.lamp.plant.angle[2]
    client.wait(0.4)
    speed = (client.lamp.plant.angle[2] - start) / 0.4
    assert abs(speed) == pytest.approx(20 * 0.229 * 2 * math.pi / 60, rel=0.15)
    assert client.value(NECK, 128, 4) == pytest.approx(20, abs=5)


def test_current_based_position_draws_no_more_than_its_goal_current() -> None:
    client = Client()
    set_mode(client, 5)
    client.write(NECK, 102, 30, 2)
    position = client.value(NECK, 132, 4)
    client.write(NECK, 116, position + 300, 4)
    client.wait(0.5)
    assert abs(client.value(NECK, 126, 2)) <= 40


def test_an_i_gain_takes_the_sag_of_the_neck_away() -> None:
    error = []
    for gain in (0, 300):
        client = Client()
        client.start(400)
        client.write(NECK, 82, gain, 2)
        client.go([0.0, 0.0, 0.2])
        client.wait(2.0)
        error.append(abs(client.angles()[2] - 0.2))
    assert error[1] < error[0] / 2


def test_a_profile_slows_the_lamp() -> None:
    client = Client()
    client.start()
    client.wait(0.5)
    client.write(NECK, 112, 20, 4)  # 0.48 rad/s
    client.go([0.0, 0.0, 0.3])
    client.wait(0.3)
    assert 0.03 < client.angles()[2] < 0.2
    client.wait(1.0)
    assert client.angles()[2] == pytest.approx(0.3, abs=0.06)


def test_switching_loops_while_it_moves_makes_no_jump() -> None:
    client = Client()
    client.start()
    client.go([0.0, 0.0, 0.3])
    client.wait(1.0)
    before = client.angles()[2]
    for gain in (100, 0, 100, 0):
        client.write(NECK, 82, gain, 2)
        client.wait(0.05)
        assert client.angles()[2] == pytest.approx(before, abs=0.03)
