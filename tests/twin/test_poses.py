from __future__ import annotations

import numpy as np
import pytest

from robolamp.twin.actuators.gears import read_beyond
from robolamp.twin.judges.key_poses import KeyPose, PoseErrors
from robolamp.twin.lanes.fleet import Fleet, Job

from .parts import FALL, HEAVY, PERIOD, STAND, SWAY, TWIN, N, program, rows

FLEET = Fleet([TWIN, HEAVY], PERIOD, 2)
JOBS = [Job(0, 0, 0.1), Job(0, 1, 0.3), Job(1, 0, 0.3)]
PROGRAMS = [program(*SWAY), program(*STAND)]
WANTED = (0.2, -0.3, 0.1)


def test_a_pose_is_judged_by_the_true_angles_at_its_time() -> None:
    poses = [KeyPose(0.0, WANTED), KeyPose(0.34, (0.0, 0.0, 0.0)), KeyPose(0.5, WANTED), KeyPose(0.5, (1.0, 1.0, 1.0))]
    outcome = FLEET.run(PROGRAMS, JOBS, 1.0, poses=poses, record=True)
    assert outcome.trace is not None
    for lane, twin in enumerate((TWIN, HEAVY, TWIN)):
        qpos = FLEET.play(JOBS[lane], outcome.trace.goals[lane], 50)
        read = [
            [read_beyond(*pair) for pair in zip(twin.gears.table, at, strict=True)] for at in qpos[:, twin.gears.qpos]
        ]
        angles = qpos[:, twin.qpos] + read
        errors = [np.abs(angles[round(pose.time / PERIOD)] - pose.angles).mean() for pose in poses]
        assert outcome.pose_error[lane] == pytest.approx(np.mean(errors), abs=1e-12)


def test_between_ticks_the_nearest_physics_step_counts() -> None:
    for time in (0.3, 0.302, 0.3031, 0.308):
        step = round(time / TWIN.timestep)
        here = FLEET.run(PROGRAMS, JOBS, 1.0, poses=[KeyPose(time, WANTED)]).pose_error
        there = FLEET.run(PROGRAMS, JOBS, 1.0, poses=[KeyPose(step * TWIN.timestep, WANTED)]).pose_error
        assert (here == there).all()
    early, late = (FLEET.run(PROGRAMS, JOBS, 1.0, poses=[KeyPose(t, WANTED)]).pose_error for t in (0.302, 0.308))
    assert early[0] != late[0]


def test_a_pose_after_the_end_is_judged_on_the_last_angles() -> None:
    for duration, texts in ((0.5, SWAY), (2.0, FALL)):
        poses = [KeyPose(1.9, WANTED), KeyPose(0.2, (0.0,) * N)]
        jobs = [Job(0, 0, 0.3), Job(0, 1, 0.3)]
        outcome = FLEET.run([program(*texts)], jobs, duration, poses=poses)
        early = FLEET.run([program(*texts)], jobs, duration, poses=poses[1:])
        assert outcome.fallen.all() == (texts == FALL)
        expected = (np.abs(outcome.angles - np.array(WANTED)).mean(axis=1) + early.pose_error) / 2
        assert outcome.pose_error == pytest.approx(expected, abs=1e-12)


def test_poses_change_nothing_but_their_error() -> None:
    bare = FLEET.run(PROGRAMS, JOBS, 0.5)
    posed = FLEET.run(PROGRAMS, JOBS, 0.5, poses=[KeyPose(0.3, WANTED)])
    assert not bare.pose_error.any()
    assert (posed.pose_error > 0.05).all()
    assert (rows(bare) != rows(posed)).sum() == len(JOBS)


def test_lanes_are_judged_alike_however_they_are_shared_out() -> None:
    poses = [KeyPose(0.1, WANTED), KeyPose(0.4, WANTED)]
    one, three = (Fleet([TWIN, HEAVY], PERIOD, n).run(PROGRAMS, JOBS, 0.5, poses=poses) for n in (1, 3))
    assert (rows(one) == rows(three)).all()


def test_without_poses_there_is_no_error() -> None:
    assert PoseErrors((), 2, 0.002).finish(np.ones((2, 3))).tolist() == [0.0, 0.0]
