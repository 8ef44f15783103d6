"""A real scheduler and real worker processes, as a user starts them; every outcome against the local fleet's."""

from __future__ import annotations

import dataclasses
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from distributed import Client

from robolamp.controller.expression import parse
from robolamp.controller.program import Program, compile_program
from robolamp.controller.terminals import on_board_terminals
from robolamp.errors import RobolampError
from robolamp.evolve.cluster import Cluster
from robolamp.evolve.evolution import evolve
from robolamp.evolve.platform import differences, machine
from robolamp.evolve.tasks.task import load_task
from robolamp.figure import load_figure
from robolamp.twin.bend import Bend
from robolamp.twin.figure_model import build_figure
from robolamp.twin.judges.key_poses import KeyPose
from robolamp.twin.judges.lamp_judge import Outcome
from robolamp.twin.lamp_model import TwinModel, build
from robolamp.twin.lanes.fleet import Fleet, Job

from .parts import ASSETS, CALIBRATION, LAMP

PERIOD = 0.02
TERMINALS = on_board_terminals(3)
POSES = (KeyPose(0.2, (0.1, -0.2, 0.1)),)
PATIENCE = 40.0  # for processes of a busy machine to be there [s]


def lamps() -> list[TwinModel]:
    return [build(LAMP, CALIBRATION, ASSETS, bend) for bend in (Bend(), Bend(strength=0.9, delay=0.003))]


def programs(count: int, lean: float = 0.05) -> list[Program]:
    """Programs that lean the lamp, the later ones further: until they fall, unless they lean by little."""
    texts = [f"(* (+ t goal_dist) {lean * index:.6f})" for index in range(count)]
    return [compile_program([parse(text, TERMINALS)] * 3, TERMINALS) for text in texts]


def jobs(count: int) -> list[Job]:
    """Every program to three goals on two lamps, in no order."""
    all_jobs = [Job(own, lamp, goal) for own in range(count) for lamp in (0, 1) for goal in (0.05, 0.3, 0.6)]
    return [all_jobs[index] for index in np.random.default_rng(1).permutation(len(all_jobs))]


def check_same(found: Outcome, wanted: Outcome) -> None:
    for field in dataclasses.fields(Outcome):
        if field.name == "trace":
            continue
        np.testing.assert_array_equal(getattr(found, field.name), getattr(wanted, field.name), field.name)
    assert (found.trace is None) == (wanted.trace is None)
    if found.trace is not None and wanted.trace is not None:
        for name in ("inputs", "goals", "ticks"):
            np.testing.assert_array_equal(getattr(found.trace, name), getattr(wanted.trace, name), name)


@contextmanager
def process(*command: str, **environment: str) -> Iterator[subprocess.Popen]:
    own = subprocess.Popen(
        [sys.executable, "-W", "ignore", *command],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | environment,
    )  # fmt: skip
    try:
        yield own
    finally:
        own.kill()
        own.wait()


def program(name: str, bare: bool) -> list[str]:
    """How to start one of dask's programs, on request where there is no robolamp."""
    module = f"distributed.cli.dask_{name}"
    hidden = f"import sys; sys.modules['robolamp'] = None; from {module} import main; main()"
    return ["-c", hidden] if bare else ["-m", module]


@contextmanager
def scheduler(bare: bool = False, **environment: str) -> Iterator[tuple[str, subprocess.Popen]]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = ("--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show")
    with process(*program("scheduler", bare), *options, **environment) as own:
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        yield f"127.0.0.1:{port}", own


def worker(address: str, folder: Path, bare: bool = False) -> list[str]:
    """Command of a worker that nobody restarts."""
    return [
        *program("worker", bare), f"tcp://{address}", "--no-nanny", "--nthreads", "1", "--no-dashboard",
        "--local-directory", str(folder),
    ]  # fmt: skip


def wait_for(address: str, count: int) -> None:
    """Wait until that many workers are there."""
    with Client(address, set_as_default=False, timeout=PATIENCE) as client:
        client.wait_for_workers(count, timeout=PATIENCE)


def busy(client: Client, beside: str = "") -> str:
    """Wait until a worker, another one than that beside, is in the midst of a chunk; return its address."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        for address, tasks in client.processing().items():
            if tasks and address != beside:
                time.sleep(0.2)  # the first chunk also waits for the lamps
                return address
        time.sleep(0.02)
    raise AssertionError(f"nobody is busy: {client.processing()}")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("dask")
    with scheduler() as (found, _), process(*worker(found, folder)), process(*worker(found, folder)):
        wait_for(found, 2)
        yield found


def test_outcomes_are_those_of_the_local_fleet_to_the_bit(address: str) -> None:
    twins = lamps()
    local = Fleet(twins, PERIOD, 2)
    with Cluster(address, twins, PERIOD) as cluster:
        for count, record in ((20, False), (12, True), (1, False)):
            wanted = local.run(programs(count), jobs(count), 0.4, poses=POSES, record=record)
            check_same(cluster.run(programs(count), jobs(count), 0.4, poses=POSES, record=record), wanted)
            assert cluster.steps == local.steps
        with pytest.raises(ValueError, match="no jobs"):
            cluster.run(programs(1), [], 0.4)
        assert list(cluster.machines().values()) == [machine()] * 2
        assert differences(machine(), cluster.machines()) == []
    # The lamps of another run do not get in the way of the first one's, which are still built on the workers.
    with Cluster(address, twins[1:], PERIOD) as cluster:
        other = [dataclasses.replace(job, variant=0) for job in jobs(2)]
        check_same(cluster.run(programs(2), other, 0.4), Fleet(twins[1:], PERIOD, 1).run(programs(2), other, 0.4))


def test_workers_killed_in_the_midst_of_a_chunk_lose_nothing(tmp_path: Path) -> None:
    many, lanes, duration = programs(12, 0.001), jobs(12), 5.0  # half a second for a chunk
    twins = lamps()
    wanted = Fleet(twins, PERIOD, 1).run(many, lanes, duration)
    with ExitStack() as stack:
        found, _ = stack.enter_context(scheduler(bare=True))  # which needs no robolamp
        victims = [stack.enter_context(process(*worker(found, tmp_path))) for _ in range(2)]
        wait_for(found, 2)
        cluster = stack.enter_context(Cluster(found, twins, PERIOD))
        watcher = stack.enter_context(Client(found, set_as_default=False))
        pids = watcher.run(os.getpid)
        killed: list[str] = []

        def kill() -> None:
            killed.append(busy(watcher))
            os.kill(pids[killed[0]], signal.SIGKILL)
            killed.append(busy(watcher, killed[0]))  # the other goes on alone
            # Nobody has the lamps when it dies, too; its successor must get them all the same.
            os.kill(pids[killed[1]], signal.SIGKILL)
            stack.enter_context(process(*worker(found, tmp_path)))

        killer = threading.Thread(target=kill)
        killer.start()
        outcome = cluster.run(many, lanes, duration)
        killer.join()
        assert len(killed) == 2
        assert [own.wait(PATIENCE) for own in victims] == [-signal.SIGKILL] * 2
        check_same(outcome, wanted)


def test_trials_that_kill_every_worker_are_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robolamp.evolve.cluster._DESERTED", 1.0)
    with ExitStack() as stack:
        found, _ = stack.enter_context(scheduler(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0"))
        victim = stack.enter_context(process(*worker(found, tmp_path)))
        wait_for(found, 1)
        cluster = stack.enter_context(Cluster(found, lamps(), PERIOD))
        watcher = stack.enter_context(Client(found, set_as_default=False))
        killer = threading.Thread(target=lambda: (busy(watcher), victim.kill()))
        killer.start()
        with pytest.raises(RobolampError, match=r"workers died .* of the same trials.*--resume"):
            cluster.run(programs(4, 0.001), jobs(4), 20.0)
        killer.join()
        # And now that nobody is left:
        with pytest.raises(RobolampError, match=r"no worker has been there for 1 s.*--resume"):
            cluster.run(programs(1), jobs(1), 0.4)


def test_a_scheduler_that_goes_away_is_told_in_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as stack:
        found, own = stack.enter_context(scheduler())
        stack.enter_context(process(*worker(found, tmp_path)))
        wait_for(found, 1)
        cluster = stack.enter_context(Cluster(found, lamps(), PERIOD))
        timer = threading.Timer(1.0, own.kill)
        timer.start()
        with pytest.raises(RobolampError, match=r"lost the connection.*--resume") as told:
            cluster.run(programs(32, 0.001), jobs(32), 8.0)
        timer.join()
        assert told.value.where == f"--cluster {found}"
    assert capfd.readouterr() == ("", "")


def test_a_worker_without_robolamp_is_named(tmp_path: Path) -> None:
    with ExitStack() as stack:
        found, _ = stack.enter_context(scheduler())
        stack.enter_context(process(*worker(found, tmp_path, bare=True)))
        wait_for(found, 1)
        with pytest.raises(RobolampError, match=r"worker tcp://127\.0\.0\.1:\d+ cannot run robolamp: .*No module"):
            Cluster(found, lamps()[:1], PERIOD)


def test_a_scheduler_without_workers_is_told_in_one_line() -> None:
    with scheduler() as (found, _):
        began = time.monotonic()
        with pytest.raises(RobolampError, match=rf"no workers; start some with: dask worker {found}"):
            Cluster(found, lamps()[:1], PERIOD)
        assert time.monotonic() - began < 10.0


def test_nobody_there_is_told_in_one_line_and_soon() -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))  # nobody listens
        began = time.monotonic()
        with pytest.raises(RobolampError, match="nobody answers there; expected host:port of a dask scheduler"):
            Cluster(f"127.0.0.1:{silent.getsockname()[1]}", lamps()[:1], PERIOD)
        assert time.monotonic() - began < 10.0


@pytest.mark.parametrize("wrong", ["", "localhost", "10.0.0.1:", "10.0.0.1:0", "10.0.0.1:70000", "http://a:1", "a b:1"])
def test_what_is_no_address_is_refused(wrong: str) -> None:
    with pytest.raises(RobolampError, match="is no address; expected host:port of a dask scheduler"):
        Cluster(wrong, lamps()[:1], PERIOD)


def test_without_the_extra_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RobolampError, match=r"pip install 'robolamp\[cluster\]'"):
        Cluster("127.0.0.1:8786", lamps()[:1], PERIOD)


def test_machines_that_differ_are_named_with_what_they_differ_in() -> None:
    own = machine()
    assert {"processor", "architecture", "python", "mujoco", "numpy", "numba", "robolamp"} == set(own)
    assert all(own.values())
    other = own | {"numpy": "2.0.0"}
    assert differences(own, {"a": own, "b": other, "c": other}) == [f"numpy {own['numpy']} here, 2.0.0 there (b, c)"]
    del other["numpy"]
    assert differences(own, {"b": other}) == [f"numpy {own['numpy']} here, none there (b)"]
    assert differences({}, {"b": {"numpy": "1"}}) == ["numpy none here, 1 there (b)"]


def test_genes_of_a_figure_are_bred_on_a_cluster_as_they_are_here(address: str, tmp_path: Path) -> None:
    words = ("duration=0.4", "gp.population=24", "gp.generations=3", "gp.tournament=3")
    task = load_task(ASSETS, "jumper", overrides=words)
    results = []
    with Cluster(address, [build_figure(load_figure(ASSETS, "jumper"), ASSETS)], 0.01) as cluster:
        for folder, evaluator in ((tmp_path / "here" / "run", None), (tmp_path / "there" / "run", lambda *_: cluster)):
            folder.parent.mkdir()
            results.append(evolve(task, LAMP, CALIBRATION, ASSETS, folder, seed=5, evaluator=evaluator))
        assert cluster.steps > 0
    here, there = (result.controller.read_text() for result in results)
    assert "[genome]" in here
    assert here == there
