"""Many machines: trials on the workers of a dask.distributed scheduler that stands already.

A run is cut into chunks of lanes; each becomes a task that runs a one-thread `Fleet` on whichever worker is free.
Lanes do not touch each other, so the outcomes are those of a local fleet to the bit, however the lanes are cut.

The lamps are packed into a few hundred kilobytes that go to the scheduler once, as the argument of a task of their own;
every chunk depends on it. A worker without them fetches them from one that has, and where none is left (the worker
that held them died) the scheduler runs that small task again: nothing has to be sent a second time from here.
"""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import logging
import lzma
import math
import pickle
import platform
import re
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Self, cast

import numpy as np

from robolamp.controller.program import Program
from robolamp.errors import RobolampError
from robolamp.evolve.platform import machine
from robolamp.twin.figure_model import Twin
from robolamp.twin.judges.run_outcome import RunOutcome
from robolamp.twin.lanes.fleet import Fleet, Job

if TYPE_CHECKING:
    from distributed import Client, Future
    from tornado.ioloop import IOLoop

    from robolamp.twin.judges.key_poses import KeyPose

_LANES_MOST = 96  # of a chunk, 16 individuals on 6 goals: seconds of physics, to dask's millisecond a task
_CHUNKS_A_THREAD = 4  # at least, so that the last ones do not keep the others waiting for long ...
_LANES_LEAST = 16  # ... but not of fewer lanes than this
_REACH = 5.0  # time to find the scheduler [s]
_GATHER = 4.0  # time for a first worker to be there [s]
_BREATH = 2.0  # between two looks at who is still there [s]
_DESERTED = 60.0  # without any worker, after which a run is given up: a restarted one takes some seconds [s]
_KEPT = 4  # lamps of as many runs stay built on a worker
_RESUME = "; the run's last checkpoint stands: robolamp evolve --resume RUN"
_ADDRESS = re.compile(r"((tcp|tls)://)?(\[[0-9a-fA-F:]+\]|[^\s:/\[\]]+):(?P<port>\d{1,5})\Z")
_EXPECTED = "expected host:port of a dask scheduler"

# Of this worker, by the key of their lamps, the latest last.
_idle: OrderedDict[str, list[Fleet]] = OrderedDict()
_idle_lock = threading.Lock()


@contextmanager
def _fleet(key: str, lamps: bytes) -> Iterator[Fleet]:
    """Lend a fleet of this worker to one thread; it is built where none is idle."""
    with _idle_lock:
        fleets = _idle.setdefault(key, [])
        _idle.move_to_end(key)
        while len(_idle) > _KEPT:
            _idle.popitem(last=False)
        fleet = fleets.pop() if fleets else None
    if fleet is None:
        fleet = Fleet(*pickle.loads(lzma.decompress(lamps)), workers=1)
    yield fleet
    with _idle_lock:
        fleets.append(fleet)


def run_chunk(key: str, lamps: bytes, chunk: bytes) -> tuple[RunOutcome, int]:
    """Run a chunk on a worker.

    Args:
        key: Tells these lamps from those of other runs.
        lamps: Compressed pickle of the lamps and the control period.
        chunk: Pickle of what `Fleet.run` takes.

    Returns:
        The outcomes, and the physics steps they took.
    """
    programs, jobs, duration, poses, record = pickle.loads(chunk)
    with _fleet(key, lamps) as fleet:
        before = fleet.steps
        outcome = fleet.run(programs, jobs, duration, poses=poses, record=record)
        return outcome, fleet.steps - before


def _task() -> Callable[[str, bytes, bytes], tuple[RunOutcome, int]]:
    """Return `run_chunk` as a function that travels by value, so that the scheduler itself needs no robolamp."""

    def robolamp(key: str, lamps: bytes, chunk: bytes) -> tuple[RunOutcome, int]:
        from robolamp.evolve.cluster import run_chunk  # noqa: PLC0415 (on the worker)

        return run_chunk(key, lamps, chunk)

    return robolamp


class _Loop:
    """An event loop in a thread of its own, which ends when told to, whatever became of the client in it."""

    def __init__(self) -> None:
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()), name="cluster", daemon=True)
        self._thread.start()
        self._ready.wait()

    async def _main(self) -> None:
        from tornado.ioloop import IOLoop  # noqa: PLC0415 (an optional extra)

        self.tornado: IOLoop = IOLoop.current()
        self._asyncio, self._over = asyncio.get_running_loop(), asyncio.Event()
        self._ready.set()
        await self._over.wait()

    def stop(self) -> None:
        """End the loop and its thread."""
        self._asyncio.call_soon_threadsafe(self._over.set)
        self._thread.join()


class Cluster:
    """Lamps that can be run again and again, on other machines: an evaluator like `Fleet`.

    Args:
        address: The scheduler's, "host:port" or "tls://host:port".
        twins: The lamps (variants of one model).
        period: Control period [s].

    Attributes:
        steps: Physics steps so far.

    Raises:
        RobolampError: The extra is not installed, the address is none, nobody answers there, there are no workers, one
            of them cannot run robolamp, or the period is not a whole number of physics steps.
    """

    def __init__(self, address: str, twins: Sequence[Twin], period: float) -> None:
        self._where = f"--cluster {address}"
        match = _ADDRESS.match(address)
        if match is None or not 0 < int(match["port"]) < 65536:
            raise RobolampError(f"{address!r} is no address; {_EXPECTED}", self._where)
        try:
            from distributed import Client  # noqa: PLC0415 (an optional extra)
        except ImportError:
            raise RobolampError("needs dask.distributed: pip install 'robolamp[cluster]'", self._where) from None
        Fleet(twins[:1], period, 1)  # refuses here what every worker would refuse
        self.steps = 0
        self._loop = _Loop()
        try:
            self._client = self._connected(Client, address)
        except BaseException:
            self._loop.stop()
            raise
        try:
            self.machines()  # first, because a worker without robolamp does not survive its first task
            lamps = lzma.compress(pickle.dumps((list(twins), period)), preset=0)  # they differ in a few numbers
            self._key = hashlib.sha256(lamps).hexdigest()
            self._lamps = self._client.submit(bytes, lamps, key=f"robolamp-{self._key}")
        except BaseException:
            self.close()
            raise

    def _connected(self, kind: type[Client], address: str) -> Client:
        for logger in ("distributed", "distributed.client"):  # what goes wrong is told in one line, not in their log
            logging.getLogger(logger).setLevel(logging.CRITICAL)
        try:
            client = kind(address, timeout=_REACH, set_as_default=False, loop=self._loop.tornado)
        except (OSError, ValueError):
            raise RobolampError(f"nobody answers there; {_EXPECTED}", self._where) from None
        try:
            client.wait_for_workers(1, timeout=_GATHER)
        except TimeoutError:
            client.close()
            message = f"the scheduler has no workers; start some with: dask worker {address}"
            raise RobolampError(message, self._where) from None
        return client

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the scheduler; what it still computes for us, it drops."""
        self._client.close()
        self._loop.stop()

    def machines(self) -> dict[str, dict[str, str]]:
        """Return `machine()` of every worker, by its address.

        Raises:
            RobolampError: A worker cannot run robolamp, or the scheduler is gone.
        """
        with self._told():
            found = cast(dict[str, dict[str, str] | Exception], self._client.run(machine, on_error="return"))
        machines, here = {}, platform.python_version()
        for worker, answer in found.items():
            if isinstance(answer, Exception):  # dask passes on what went wrong there as a text
                raise RobolampError(f"worker {worker} cannot run robolamp: {answer}", self._where)
            if answer["python"].split(".")[:2] != here.split(".")[:2]:  # functions do not travel between those
                raise RobolampError(f"worker {worker} has Python {answer['python']}, this is {here}", self._where)
            machines[worker] = answer
        return machines

    def run(
        self,
        programs: Sequence[Program],
        jobs: Sequence[Job],
        duration: float,
        *,
        poses: Sequence[KeyPose] = (),
        record: bool = False,
    ) -> RunOutcome:
        """Run every job to its end and judge it; for arguments and result see `Fleet.run`.

        Raises:
            RobolampError: The scheduler is gone, all workers are, or a chunk has brought several of them down.
        """
        if not jobs:
            raise ValueError("no jobs to run")
        with self._told():
            chunks = [
                self._client.submit(
                    _task(), self._key, self._lamps, _packed(programs, part, duration, poses, record), pure=False
                )
                for part in _parts(jobs, self._threads())
            ]
            results = self._gathered(chunks)
        self.steps += sum(steps for _, steps in results)
        return RunOutcome.join([outcome for outcome, _ in results])

    def _threads(self) -> int:
        return sum(self._client.nthreads().values())

    def _gathered(self, chunks: list[Future]) -> list[tuple[RunOutcome, int]]:
        """Wait for chunks as long as anybody works on them; return their results in order."""
        from distributed import wait  # noqa: PLC0415 (an optional extra)

        seen = time.monotonic()
        while True:
            try:
                with self._client.as_current():  # `wait` takes no client
                    wait(chunks, timeout=_BREATH)
                return cast(list[tuple[RunOutcome, int]], self._client.gather(chunks))
            except TimeoutError:
                if self._threads():
                    seen = time.monotonic()
                elif time.monotonic() - seen > _DESERTED:
                    raise RobolampError(f"no worker has been there for {_DESERTED:g} s{_RESUME}", self._where) from None

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Tell what can go wrong out there in one line."""
        from distributed import KilledWorker  # noqa: PLC0415 (an optional extra)

        try:
            yield
        except RobolampError:
            raise
        except KilledWorker as error:
            message = f"several workers died one after the other of the same trials, the last one {error.last_worker}"
            raise RobolampError(f"{message}: memory?{_RESUME}", self._where) from None
        except (Exception, asyncio.CancelledError) as error:
            gone = isinstance(error, CancelledError | asyncio.CancelledError | OSError)
            if not gone and self._client.status == "running":
                raise
            raise RobolampError(f"lost the connection to the scheduler{_RESUME}", self._where) from None


def _parts(jobs: Sequence[Job], threads: int) -> list[list[Job]]:
    """Cut jobs into chunks of consecutive ones."""
    count = len(jobs)
    wanted = max(math.ceil(count / _LANES_MOST), min(_CHUNKS_A_THREAD * threads, count // _LANES_LEAST), 1)
    edges = np.linspace(0, count, wanted + 1).astype(int).tolist()
    return [list(jobs[start:end]) for start, end in itertools.pairwise(edges)]


def _packed(
    programs: Sequence[Program], jobs: Sequence[Job], duration: float, poses: Sequence[KeyPose], record: bool
) -> bytes:
    """Pack a chunk with the programs that it runs and no others."""
    place = {own: index for index, own in enumerate(dict.fromkeys(job.program for job in jobs))}
    own = [replace(job, program=place[job.program]) for job in jobs]
    return pickle.dumps(([programs[index] for index in place], own, duration, tuple(poses), record))
