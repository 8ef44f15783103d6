"""The limbo pole: what stands clear of it does not touch it, what meets it feels it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from robolamp.twin.bend import Bend
from robolamp.twin.lamp_model import POLE_RADIUS, Pole, TwinModel, build
from robolamp.twin.lanes.fleet import Fleet, Job
from robolamp.twin.lanes.lamp_body import Body
from robolamp.twin.pictures.render import qpos_of, side_view, strip
from robolamp.twin.twin_lamp import TwinLamp

from .parts import ASSETS, CALIBRATION, FALL, LAMP, PERIOD, STAND, TWIN, N, program, rows

HEAD_TOP, HEAD_FRONT = 0.2206, 0.0923  # of the lamp that stands, settled [m]
BOW = ("0.25", "0.1", "0")  # the head goes forward, and down


def with_pole(height: float, x: float, bend: Bend | None = None) -> TwinModel:
    return build(LAMP, CALIBRATION, ASSETS, bend, pole=Pole(height, x))


def force_on(body: Body, twin: TwinModel) -> float:
    return float(body.data.sensordata[twin.pole_sensor])


def test_its_lower_edge_is_at_its_height() -> None:
    twin = with_pole(0.2, 0.3)
    assert TWIN.pole_sensor is None
    body = Body(twin)
    bar = body.data.geom("pole")
    assert bar.xpos == pytest.approx([0.3, 0.0, 0.2 + POLE_RADIUS])
    assert np.abs(bar.xmat.reshape(3, 3)[:, 2]) == pytest.approx([0.0, 1.0, 0.0])  # it lies across the way
    assert twin.model.geom("pole").size[0] == POLE_RADIUS


@pytest.mark.parametrize(
    ("pole", "touches"),
    [
        (Pole(HEAD_TOP + 0.002, 0.042), False),
        (Pole(HEAD_TOP - 0.008, 0.042), True),
        (Pole(0.192, HEAD_FRONT + POLE_RADIUS + 0.002), False),
    ],
)
def test_where_the_standing_lamp_ends(pole: Pole, touches: bool) -> None:
    outcome = Fleet([with_pole(pole.height, pole.x)], PERIOD, 1).run([program(*STAND)], [Job(0, 0, 0.3)], 0.5)
    assert outcome.pole.tolist() == [touches]


def test_a_pole_that_is_not_touched_changes_nothing() -> None:
    jobs = [Job(0, 0, 0.1), Job(1, 0, 0.3)]
    programs = [program(*STAND), program("(* 0.1 (- 0.5 t))", "0", "0")]
    free = Fleet([TWIN], PERIOD, 1).run(programs, jobs, 0.5)
    poled = Fleet([with_pole(0.15, 0.4)], PERIOD, 1).run(programs, jobs, 0.5)
    assert not poled.pole.any()
    assert (rows(free) == rows(poled)).all()


@pytest.mark.parametrize(("part", "height", "way"), [
    ("head", 0.19, 1), ("foot", 0.004, 1), ("upper_arm", 0.15, -1), ("lower_arm", 0.09, -1), ("foot", 0.004, -1),
])  # fmt: skip
def test_every_part_of_the_lamp_is_stopped_by_it(part: str, height: float, way: int) -> None:
    twin = with_pole(height - POLE_RADIUS, way * 0.16)
    body = Body(twin)
    body.model.opt.gravity[:] = 0.0  # it drifts towards the pole
    body.data.qvel[0] = way * 0.6
    met, felt = set(), 0.0
    for _ in range(200):
        body.step()
        for contact in body.data.contact[: body.data.ncon]:
            names = {twin.model.geom(int(geom)).name for geom in contact.geom}
            met |= names - {"pole"} if "pole" in names else set()
        felt = max(felt, force_on(body, twin))
    assert part in met
    assert felt > 1.0
    assert way * body.data.geom(part).xpos[0] < 0.16  # it did not pass through
    free = Body(TWIN)
    free.model.opt.gravity[:] = 0.0
    free.data.qvel[0] = way * 0.6
    free.step(200)
    assert way * free.data.geom(part).xpos[0] > 0.16


def test_a_lane_that_touches_is_told_and_goes_on() -> None:
    twins = [with_pole(height, 0.10) for height in (0.18, 0.5, 0.17)]
    fleet = Fleet(twins, PERIOD, 2)
    programs = [program(*BOW), program(*STAND)]
    jobs = [Job(index, variant, 0.3) for variant in range(3) for index in range(2)]
    outcome = fleet.run(programs, jobs, 1.0)
    assert outcome.pole.tolist() == [True, False, False, False, True, False]
    assert not outcome.fallen.any()
    free = Fleet([TWIN], PERIOD, 1).run(programs, [Job(0, 0, 0.3), Job(1, 0, 0.3)], 1.0)
    assert (rows(outcome)[2:4] == rows(free)).all()  # its pole is out of reach: it is the lamp without one
    assert np.abs(outcome.angles[0] - free.angles[0]).max() > 0.01
    for variant in range(3):  # poles of different heights are numbers of one model
        alone = Fleet([twins[variant]], PERIOD, 1).run(programs, [Job(0, 0, 0.3), Job(1, 0, 0.3)], 1.0)
        assert (rows(outcome)[2 * variant : 2 * variant + 2] == rows(alone)).all()


def test_a_fleet_has_poles_everywhere_or_nowhere() -> None:
    with pytest.raises(ValueError, match="the models differ in more than numbers"):
        Fleet([TWIN, with_pole(0.2, 0.2)], PERIOD, 1)


def test_the_single_lamp_tells_it_too() -> None:
    twin = with_pole(0.18, 0.10)
    lamp = TwinLamp(twin, goal=0.3, duration=1.0)
    lamp.open()
    lamp.torque(True)
    lamp.clock.sleep_until(0.5)
    assert not lamp.outcome.pole[0]
    lamp.body.set_goal(np.array([0.3, 0.2, 0.0]))
    lamp.clock.sleep_until(1.5)
    assert lamp.outcome.pole[0]


def test_a_lamp_that_falls_on_it_makes_no_warning() -> None:
    twin = with_pole(0.12, 0.14)
    outcome = Fleet([twin], PERIOD, 1).run([program(*FALL)], [Job(0, 0, 0.3)], 2.0)
    assert outcome.pole[0]
    assert not outcome.unstable[0]


@pytest.mark.parametrize("opengl", [True, False], indirect=True)
def test_pictures_show_it(opengl: bool) -> None:
    twin = with_pole(0.2, 0.12)
    pose = qpos_of(twin, (0.0, 0.0, 0.0), np.zeros(N))[None]
    free, poled = (strip(t, pose, ["x"], width=160, height=200, opengl=opengl)[:200].astype(int) for t in (TWIN, twin))
    red = (poled[:, :, 0] - poled[:, :, 1:].max(axis=2)) > 40
    assert red.sum() >= 8
    assert not ((free[:, :, 0] - free[:, :, 1:].max(axis=2)) > 40).any()
    if not opengl:
        side = side_view(twin, pose[0], 160, 200)
        rows_, columns = np.nonzero(red)
        assert columns.mean() > 160 * 0.45 + 0.09 * 200 / 0.40
        assert rows_.mean() == pytest.approx(200 * 0.86 - 0.204 * 200 / 0.40, abs=2)
        assert side.shape == (200, 160, 3)


def test_mujoco_agrees_on_who_touches_whom() -> None:
    twin = with_pole(0.18, 0.10)
    body = Body(twin)
    body.step(500)
    body.set_goal(np.array([0.3, 0.2, 0.0]))
    bar = twin.model.geom("pole").id
    both = 0
    for _ in range(500):
        body.step()
        touching = [c for c in body.data.contact[: body.data.ncon] if bar in c.geom]
        normal = 0.0
        for index, contact in enumerate(body.data.contact[: body.data.ncon]):
            if bar in contact.geom:
                force = np.zeros(6)
                mujoco.mj_contactForce(twin.model, body.data, index, force)
                normal += force[0]
        assert force_on(body, twin) == pytest.approx(normal, abs=1e-9)
        both += bool(touching) and normal > 0
    assert both > 50
