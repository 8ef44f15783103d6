"""How many small faults the tests find: a seeded sample of mutants of the code that drives the lamp and judges runs.

A mutant is the package with one expression or statement changed, in a copy in a temporary folder. The tests of its
room that run the changed line are run on it, the quickest first, until one fails; if none does, those of the rooms
that use it. Compiled code is mutated as any other: numba's caches of a mutant go with it. Which test runs which line is
found once; a compiled function that is called counts with all its lines and with those that it calls. Where one test
of a file runs the line, the file is taken whole, as fixtures and caches serve all its tests; a line that runs at import
has every test of the room. Slow tests are not among them; one against the real clock must fail twice, as machines are
busy.

Results are a JSON line a mutant in `--folder`; a run that was stopped goes on where it was. `mutants.toml` lists
mutants that change nothing that anybody could see, each with its reason.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import hashlib
import itertools
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]

ROOMS = {  # patterns of its files, and the folders of its tests: its own first, then those of what uses it
    "controller": ("controller/**/*.py", ["controller", "contract", "runtime", "twin"]),
    "runtime": ("runtime/**/*.py", ["runtime", "contract", "robot"]),
    "robot": ("robot/**/*.py", ["robot", "contract", "runtime"]),
    "dynamixel": ("dynamixel/**/*.py", ["dynamixel", "robot", "contract"]),
    "foot": ("foot/**/*.py", ["foot", "robot", "contract"]),
    "judge": ("twin/**/*judge*.py twin/**/*verdict*.py", ["twin", "contract"]),
    "signals": ("signals.py", ["contract", "runtime", "robot", "twin", "log"]),
}
LEAST = 20  # mutants a room, where it has as many; the rest in proportion to what each has
HALFWAY = "halfway"  # survived the tests of its room, not yet tried by those of others
GOAL = 0.9  # share to be killed of those that are not equivalent
ALLOWANCE = 120.0  # s: what a mutant's tests may take beside four times what they took before: imports, compiling
MARK = "ROBOLAMP_MUTANT"  # in the environment of every process of a mutant, so that all of them are found and ended

SWAPS: dict[type, type] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add,
    ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.And: ast.Or,
    ast.Or: ast.And,
}  # fmt: skip
OPPOSITES: dict[type, type] = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
NAMES = {"min": "max", "minimum": "maximum", "fmin": "fmax", "any": "all", "floor": "ceil", "sin": "cos"}
NAMES |= {new: old for old, new in NAMES.items()}


# Mutants


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        room: See `ROOMS`.
        path: The file, from the root.
        lines: First and last line of the statement, without its body.
        at: First byte of what is replaced, and the one behind it.
        code: What stands there then.
        scope: Class and function; "" at a module's top.
        text: The line where it begins.
        change: What became of what, and which it is of several that are alike in these three.
        runs: Whether the line runs when a function is called, not at import.
    """

    room: str
    path: str
    lines: tuple[int, int]
    at: tuple[int, int]
    code: str
    scope: str
    text: str
    change: str
    runs: bool

    @property
    def place(self) -> tuple[str, str, str]:
        """What it is, wherever it stands: code that moves keeps its mutants."""
        return self.scope, self.text, self.change

    @property
    def key(self) -> str:
        """The same, short."""
        return hashlib.sha256(repr(self.place).encode()).hexdigest()[:12]


def changes(node: ast.AST, condition: bool) -> Iterator[ast.AST]:
    """Yield what may stand in a node's place; `condition`: it decides an if, a while, or what a comprehension takes."""

    def changed(**values: Any) -> ast.AST:
        new = copy.copy(node)
        vars(new).update(values)
        return new

    match node:
        case ast.Compare(ops=ops):
            for index, op in enumerate(ops):
                yield changed(ops=[*ops[:index], SWAPS[type(op)](), *ops[index + 1 :]])
            if len(ops) == 1 and type(ops[0]) in OPPOSITES:
                yield changed(ops=[OPPOSITES[type(ops[0])]()])
        case ast.BinOp(op=op) | ast.BoolOp(op=op) | ast.AugAssign(op=op):
            if type(op) in SWAPS and not (isinstance(node, ast.BinOp) and _is_text(node)):
                yield changed(op=SWAPS[type(op)]())
        case ast.UnaryOp(operand=operand):
            yield operand
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(value=float(value)):
            yield ast.Constant(2.0 * value or 1.0)
        case ast.IfExp(body=body, orelse=orelse):
            yield changed(body=orelse, orelse=body)
        case ast.Call(func=ast.Name(id=name)) if name in NAMES:
            yield changed(func=ast.Name(NAMES[name]))
        case ast.Call(func=ast.Attribute(value=value, attr=name)) if name in NAMES:
            yield changed(func=ast.Attribute(value, NAMES[name]))
        case ast.Expr(value=ast.Call()) | ast.Raise() | ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield ast.Pass()
        case ast.Break():
            yield ast.Continue()
        case ast.Continue():
            yield ast.Break()
    if condition and not isinstance(node, ast.Compare | ast.UnaryOp | ast.Constant):
        yield ast.UnaryOp(ast.Not(), node)


def _is_text(node: ast.AST) -> bool:
    return any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in ast.walk(node))


def mutants_of(room: str, path: Path) -> list[Mutant]:
    """Return every mutant of a file; wording, types, decorators, assertions and zip's strictness stay as they are."""
    raw = path.read_bytes()
    lines = raw.splitlines(keepends=True)
    starts = [0, *itertools.accumulate(map(len, lines))]
    found: list[Mutant] = []
    seen: Counter[tuple[str, str, str]] = Counter()

    def visit(node: Any, scope: str, span: tuple[int, int], runs: bool, condition: bool) -> None:
        if isinstance(node, ast.JoinedStr | ast.Assert | ast.arg) or getattr(node, "arg", None) == "strict":
            return
        body = getattr(node, "body", None)
        if isinstance(node, ast.stmt):
            last = node.end_lineno or node.lineno
            span = node.lineno, max(node.lineno, body[0].lineno - 1) if isinstance(body, list) else last
        for new in changes(node, condition):
            text = lines[node.lineno - 1].decode().strip()
            code = ast.unparse(ast.fix_missing_locations(new))
            change = f"{ast.unparse(node)} -> {code}"
            seen[scope, text, change] += 1
            change += f" ({seen[scope, text, change]})" * (seen[scope, text, change] > 1)
            at = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
            code = code if isinstance(new, ast.stmt) else f"({code})"
            where = room, str(path.relative_to(ROOT)), span, at
            found.append(Mutant(*where, code, scope, text, change, runs))
        inner, within = scope, runs
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            inner, within = f"{scope}.{node.name}".lstrip("."), runs or isinstance(node, ast.FunctionDef)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "exc", "cause", "bases"):
                continue
            decides = name == "ifs" or (name == "test" and isinstance(node, ast.If | ast.While))
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    visit(child, *((inner, span, within) if name == "body" else (scope, span, runs)), decides)

    visit(ast.parse(raw), "", (1, 1), False, False)
    return found


def all_mutants() -> dict[str, list[Mutant]]:
    """Return every mutant, by room."""
    every: dict[str, list[Mutant]] = {}
    for name, (patterns, _) in ROOMS.items():
        files = sorted(path for pattern in patterns.split() for path in (ROOT / "robolamp").glob(pattern))
        if not files:
            raise SystemExit(f"{name}: no file is {patterns} of robolamp/")
        every[name] = [mutant for path in files for mutant in mutants_of(name, path)]
    return every


def sample(every: dict[str, list[Mutant]], count: int, seed: int) -> list[Mutant]:
    """Return a sample stratified by room, the rooms in turn, so that a part of it is stratified too."""
    total, spare = sum(map(len, every.values())), max(count - LEAST * len(every), 0)
    sizes = {name: min(LEAST + spare * len(mutants) // total, len(mutants)) for name, mutants in every.items()}
    sizes[max(sizes, key=sizes.__getitem__)] += count - sum(sizes.values())  # what is left
    chosen: list[tuple[float, Mutant]] = []
    for name, mutants in every.items():
        drawn = sorted(mutants, key=lambda mutant: hashlib.sha256(f"{seed} {mutant.key}".encode()).digest())
        chosen += [(rank / sizes[name], mutant) for rank, mutant in enumerate(drawn[: sizes[name]])]
    return [mutant for _, mutant in sorted(chosen, key=lambda pair: pair[0])]


# Copies in which mutants live


class Copy:
    """A copy of the checkout in which tests are run, mutant after mutant; nothing outside it is written to."""

    stopped = threading.Event()  # no more tests are started

    def __init__(self, folder: Path) -> None:
        unwanted = (".git", ".venv", "runs", "__pycache__", ".hypothesis", ".pytest_cache", ".ruff_cache")
        shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*unwanted))
        self.folder = folder
        self._temporary = folder.with_suffix(".tmp")
        self._edits = 0
        self._users = _users(folder / "robolamp")

    def pytest(self, tests: list[str], limit: float, *options: str, **environment: str) -> int | None:
        """Run test files; return pytest's exit code, or None if that took longer than `limit` seconds."""
        if self.stopped.is_set():
            raise CancelledError
        self._temporary.mkdir(exist_ok=True)
        path = f"{self.folder}:{self.folder / 'benchmarks'}"
        mark = f"{MARK}={self.folder}"
        command = [sys.executable, "-m", "pytest", "-q", "--tb=line", "--hypothesis-seed=0", "-m", "not slow"]
        command += ["-p", "_watcher", "-p", "no:cacheprovider", "-p", "no:xdist", *options, *tests]
        surroundings = {"PYTHONPATH": path, "TMPDIR": str(self._temporary), MARK: str(self.folder), "MUJOCO_GL": "egl"}
        with (self.folder.with_suffix(".txt")).open("wb") as output:
            process = subprocess.Popen(
                command, cwd=self.folder, env=os.environ | surroundings | environment, stdin=subprocess.DEVNULL,
                stdout=output, stderr=output, start_new_session=True,
            )  # fmt: skip
            try:
                return process.wait(limit)
            except subprocess.TimeoutExpired:
                return None
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                end_all(mark)  # those that left its group
                process.wait()
                shutil.rmtree(self._temporary, ignore_errors=True)
                shutil.rmtree(self.folder / ".hypothesis", ignore_errors=True)

    @contextlib.contextmanager
    def mutated(self, mutant: Mutant) -> Iterator[None]:
        """Change the code; compiled code that may hold what was changed is put aside meanwhile."""
        path = self.folder / mutant.path
        raw, before = path.read_bytes(), path.stat()
        code = raw[: mutant.at[0]] + mutant.code.encode() + raw[mutant.at[1] :]
        self._edits += 1
        path.write_bytes(code)
        os.utime(path, (before.st_atime, before.st_mtime + self._edits))  # Python's caches go by seconds
        with self._compiled_anew(path):
            yield
        path.write_bytes(raw)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))

    @contextlib.contextmanager
    def _compiled_anew(self, path: Path) -> Iterator[None]:
        aside = Path(tempfile.mkdtemp(dir=self.folder.parent))
        users = [user for user in self._users[path] if "njit" in user.read_text()]

        def caches() -> list[Path]:
            return [each for user in users for each in user.parent.glob(f"__pycache__/{user.stem}.*.nb?")]

        kept = [(cache, Path(shutil.move(cache, aside / f"{index}"))) for index, cache in enumerate(caches())]
        yield
        for cache in caches():
            cache.unlink()
        for cache, there in kept:
            shutil.move(there, cache)
        aside.rmdir()


def _users(package: Path) -> dict[Path, set[Path]]:
    """Return, by file, the files that import it, whether or not by others, and itself."""
    names = {".".join(path.relative_to(package.parent).with_suffix("").parts): path for path in package.rglob("*.py")}
    users = {path: {path} for path in names.values()}
    for path in names.values():
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.ImportFrom) and node.module:
                for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names)):
                    if name in names:
                        users[names[name]].add(path)
    changed = True
    while changed:
        changed = False
        for path, direct in users.items():
            wider = set().union(*(users[user] for user in direct))
            changed |= wider != direct
            users[path] = wider
    return users


def end_all(mark: str) -> None:
    """End every process that has `mark` in its environment, whosever child it is by now (where there is /proc)."""
    for environment in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if mark.encode() in environment.read_bytes().split(b"\0"):
                os.kill(int(environment.parent.name), signal.SIGKILL)


# Which test runs what


def measured(
    places: set[str], copies: queue.Queue[Copy], folder: Path, pool: ThreadPoolExecutor
) -> dict[str, dict[str, Any]]:
    """Return, by test file, what its tests take and which lines they run; measured anew where code or test changed."""
    with borrowed(copies) as copy_:
        root = copy_.folder
    tests = set((root / "tests").rglob("test_*.py"))
    others = sorted({*(root / "robolamp").rglob("*.py"), *(root / "tests").rglob("*.py")} - tests)
    state = b"".join(path.read_bytes() for path in others)
    folders = {root / "tests" / place for place in places}
    names = sorted(str(path.relative_to(root)) for path in tests if folders & set(path.parents))
    store = folder / "tests.json"
    known: dict[str, dict[str, Any]] = json.loads(store.read_text()) if store.exists() else {}
    lock = threading.Lock()

    def measure(name: str) -> None:
        digest = hashlib.sha256(state + (root / name).read_bytes()).hexdigest()
        if known.get(name, {}).get("digest") == digest:
            return
        with borrowed(copies) as copy_:
            times, lines = copy_.folder.with_suffix(".times"), copy_.folder.with_suffix(".lines")
            for output in (times, lines):
                output.write_text("null")
            code = copy_.pytest([name], 1800.0, MUTANTS_TIMES=str(times), MUTANTS_LINES=str(lines))
            if code != 0:  # what fails because it is watched passes by itself
                copy_.pytest([name], 1800.0, MUTANTS_TIMES=str(times))
            entry = {"digest": digest, "times": json.loads(times.read_text()), "lines": json.loads(lines.read_text())}
        with lock:
            known[name] = entry
            store.write_text(json.dumps(known))
            took = "took too long" if entry["times"] is None else f"{sum(entry['times'].values()):.1f} s"
            print(f"{name}: {len(entry['times'] or ())} tests, {took}", flush=True)

    list(pool.map(measure, names))
    return {name: known[name] for name in names}


def tests_for(mutant: Mutant, known: dict[str, dict[str, Any]]) -> tuple[list[str], float]:
    """Return the tests of a mutant, those that run its line first, the quick ones first; and their time [s]."""
    folders = tuple(f"tests/{place}/" for place in ROOMS[mutant.room][1])
    wanted = set(range(mutant.lines[0], mutant.lines[1] + 1))
    entries = [entry for name, entry in known.items() if name.startswith(folders) and entry["times"] is not None]
    runs = [
        {test for test, of in (entry["lines"] or {}).items() if wanted & set(of.get(mutant.path, ()))}
        for entry in entries
    ]
    every = not mutant.runs or not any(runs)  # a line that no test runs may run at import
    own: dict[str, tuple[bool, float]] = {}  # by test: whether it does not run the line, its time
    for entry, ran in zip(entries, runs, strict=True):
        if ran or every or entry["lines"] is None:
            own |= {test: (test not in ran, seconds) for test, seconds in entry["times"].items()}
    return sorted(own, key=own.__getitem__), sum(seconds for _, seconds in own.values())


# The run


@contextlib.contextmanager
def borrowed(copies: queue.Queue[Copy]) -> Iterator[Copy]:
    """Lend a copy."""
    one = copies.get()
    try:
        yield one
    finally:
        copies.put(one)


def judge(mutant: Mutant, copies: queue.Queue[Copy], known: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return what became of a mutant."""
    tests, seconds = tests_for(mutant, known)
    result, killer, began = "survived", "", time.monotonic()
    with borrowed(copies) as copy_, copy_.mutated(mutant):
        began, left = time.monotonic(), tests
        while left and result == "survived":
            result, killer, doubtful = _tried(copy_, left, ALLOWANCE + 4.0 * seconds)
            if doubtful and _tried(copy_, [killer], ALLOWANCE + 4.0 * seconds)[0] == "survived":
                result, left = "survived", left[left.index(killer) + 1 :]  # the machine was busy
            else:
                break
    told = {"tests": len(tests), "by": killer, "seconds": round(time.monotonic() - began, 1)}
    return outcome(mutant, result) | told


def _tried(copy_: Copy, tests: list[str], limit: float) -> tuple[str, str, bool]:
    """Return what became of a mutant by tests in order, which test killed it, and whether that has the real clock."""
    order, failed = copy_.folder.with_suffix(".order"), copy_.folder.with_suffix(".failed")
    order.write_text(json.dumps(tests))
    failed.write_text("")
    files = list(dict.fromkeys(test.partition("::")[0] for test in tests))
    code = copy_.pytest(files, limit, "-x", MUTANTS_ORDER=str(order), MUTANTS_FAILED=str(failed))
    if code in (None, 0):
        return "survived" if code == 0 else "timeout", "", False
    test, _, clock = failed.read_text().partition("\n")
    return "killed", test or f"exit code {code}", bool(clock)


def outcome(mutant: Mutant, result: str) -> dict[str, Any]:
    """Return a line of the results."""
    told = {"key": mutant.key, "room": mutant.room, "result": result, "path": mutant.path, "line": mutant.lines[0]}
    return told | {"in": mutant.scope, "text": mutant.text, "change": mutant.change}


def equivalents() -> dict[tuple[str, str, str], str]:
    """Return the reasons why mutants change nothing, by function, line, and change."""
    listed = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())["equivalent"]
    return {(each["in"], each["text"], change): each["reason"] for each in listed for change in each["changes"]}


def report(mutants: list[Mutant], results: dict[str, dict[str, Any]]) -> float:
    """Print what became of the mutants, by room; return the share killed of those that are not equivalent."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for mutant in mutants:
        result = results[mutant.key]["result"] if mutant.key in results else "not run"
        table[mutant.room][result] += 1
        table["all"][result] += 1
        if result == "survived":
            print(f"survived: {mutant.path}:{mutant.lines[0]} {mutant.scope}: {mutant.text}\n    {mutant.change}")
    print(
        f"{'':12}{'mutants':>9}{'killed':>9}{'timeout':>9}{'survived':>9}{'equivalent':>11}{'not run':>9}{'score':>8}"
    )
    score = 0.0
    for room in [*(name for name in ROOMS if name in table), "all"]:
        found = table[room]
        dead = found["killed"] + found["timeout"]
        score = dead / max(dead + found["survived"], 1)
        waiting = found["not run"] + found[HALFWAY]
        row = f"{found['killed']:9}{found['timeout']:9}{found['survived']:9}{found['equivalent']:11}{waiting:9}"
        print(f"{room:12}{found.total():9}{row}{score:8.0%}")
    return score


def main() -> None:
    """Run the sample, or go on with it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--room", choices=ROOMS, help="only the mutants of this room")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--folder", type=Path, default=ROOT / "runs/mutants", help="results, one JSON line a mutant")
    parser.add_argument("--again", action="store_true", help="run those that survived, or were equivalent, again")
    parser.add_argument("--report", action="store_true", help="run nothing, tell of the results so far")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    options.folder.mkdir(parents=True, exist_ok=True)
    log: Path = options.folder / "results.jsonl"
    lines = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    results = {line["key"]: line for line in lines}  # the last of each counts
    every, reasons = all_mutants(), equivalents()
    there = {mutant.place for mutants in every.values() for mutant in mutants}
    for place in reasons.keys() - there:
        print(f"mutants.toml lists what is not there any more: {' | '.join(place)}")
    drawn = sample(every, options.count, options.seed)
    mutants = [mutant for mutant in drawn if options.room in (None, mutant.room)]
    for mutant in mutants:
        if mutant.place in reasons:
            results[mutant.key] = outcome(mutant, "equivalent")
    left = [
        each
        for each in mutants
        if results.get(each.key, {"result": HALFWAY})["result"] == HALFWAY
        or (options.again and results[each.key]["result"] == "survived")
    ]
    if left and not options.report:
        _run(left, options, log, results)
    if report(mutants, results) < GOAL:
        sys.exit(1)


def _run(left: list[Mutant], options: argparse.Namespace, log: Path, results: dict[str, dict[str, Any]]) -> None:
    with tempfile.TemporaryDirectory(prefix="robolamp-mutants-", ignore_cleanup_errors=True) as place:
        copies: queue.Queue[Copy] = queue.Queue()
        pool = ThreadPoolExecutor(options.workers)
        try:
            for index in range(options.workers):
                copies.put(Copy(Path(place) / f"copy{index}"))
            halfway = [mutant for mutant in left if mutant.key in results and results[mutant.key]["result"] == HALFWAY]
            left = [mutant for mutant in left if mutant not in halfway]
            for stage in (slice(0, 1), slice(1, None)):  # a room's own tests first: those of others are for few
                left += [] if stage.stop else halfway
                places = {place for mutant in left for place in ROOMS[mutant.room][1][stage]}
                known = measured(places, copies, options.folder, pool)
                waiting = {pool.submit(judge, mutant, copies, known): mutant for mutant in left}
                for future in as_completed(waiting):
                    line = future.result()
                    if line["result"] == "survived" and stage.stop:
                        line["result"] = HALFWAY
                        halfway.append(waiting[future])
                    results[line["key"]] = line
                    with log.open("a") as stream:
                        stream.write(json.dumps(line) + "\n")
                    where = f"{line['path']}:{line['line']}"
                    print(f"{line['result']:9} {line['seconds']:6.1f} s  {where}  {line['change']}", flush=True)
                left = []
        finally:
            Copy.stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
            for index in range(options.workers):
                end_all(f"{MARK}={Path(place) / f'copy{index}'}")
            pool.shutdown()


if __name__ == "__main__":
    main()
