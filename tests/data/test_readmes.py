"""The READMEs of hardware, calibration, tasks and controllers say what the files and the code say."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from robolamp.assets import Assets
from robolamp.calibration import JOINT, LAMP, SERVO, Range, load_calibration
from robolamp.compare.verdicts.tolerances import load_tolerances
from robolamp.controller.controller_file import load_controller
from robolamp.controller.primitives import PRIMITIVES
from robolamp.controller.program import compile_program
from robolamp.controller.terminals import OPTIONAL, TWIN_ONLY, WAY, all_terminals, on_board_terminals
from robolamp.dynamixel.registers import BAUD_CODES, MODELS, RAD_PER_COUNT
from robolamp.errors import ExpressionError
from robolamp.evolve.tasks.fitness import terms
from robolamp.evolve.tasks.task import Cases, Settings, Task, load_task
from robolamp.lamp import load_lamp
from robolamp.twin.figure_model import World
from robolamp.twin.variation.spread import load_spread

from .readme import ROOT, table, text

CALIBRATION = "calibration/README.md"
TASKS = "sim/tasks/README.md"
HARDWARE = "hardware/README.md"
CONTROLLERS = "sim/lamp/controllers/README.md"


def read(path: str) -> dict[str, Any]:
    return tomllib.loads((ROOT / path).read_text(encoding="utf-8"))


def split(cell: str) -> list[str]:
    return re.split(r"[,\s]+", cell)


# calibration/


def test_nominal_says_where_every_value_is_from() -> None:
    calibration = load_calibration(Assets())
    for group, parameters in calibration.groups.items():
        for name, parameter in parameters.items():
            assert len(parameter.source) > 10, f"{group}.{name}"
    for group, legal in (("lamp", LAMP), ("XL330-M288-T", SERVO)):
        assert set(calibration.groups[group]) == {name for name, allowed in legal.items() if allowed.default is None}


@pytest.mark.parametrize(
    ("legal", "group", "first"),
    [(SERVO, "XL330-M288-T", "torque_constant"), (LAMP, "lamp", "supply_voltage")],
    ids=["servo", "lamp"],
)
def test_calibration_tables_are_the_schema(legal: Mapping[str, Range], group: str, first: str) -> None:
    rows = {row[0]: row[1:] for row in _parameter_rows(first)}
    for name, allowed in legal.items():
        unit, span, nominal, _ = rows.pop(name)
        assert unit == allowed.unit, name
        assert [float(value) for value in span.split(" to ")] == [allowed.low, allowed.high], name
        given = load_calibration(Assets()).groups[group].get(name)
        assert float(nominal) == (given.value if given else allowed.default), name
    assert not rows


def test_the_table_of_joints_is_the_schema() -> None:
    rows = {row[0]: row[1:] for row in _parameter_rows("encoder_offset")}
    assert set(rows) == set(JOINT)
    for name, (unit, span, default, _) in rows.items():
        allowed = JOINT[name]
        assert (unit, float(default)) == (allowed.unit, allowed.default)
        assert [float(value) for value in span.split(" to ")] == [allowed.low, allowed.high]


def _parameter_rows(first: str) -> list[list[str]]:
    lines = text(CALIBRATION).splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith(f"| `{first}`"))
    rows = []
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip().strip("`") for cell in line.strip("|").split("|")])
    return rows


def test_calibration_example_is_a_calibration(tmp_path: Path) -> None:
    example = re.search(r"```toml\n(.+?)```", text(CALIBRATION), re.DOTALL)
    assert example
    path = tmp_path / "mine.toml"
    path.write_text(example[1], encoding="utf-8")
    calibration = load_calibration(Assets(), path)
    assert calibration.groups["lamp"]["mass_scale"].stderr == 0.005
    assert calibration.groups["joint knee"]["coulomb"].value == 0.012


def test_tolerance_table_names_every_key() -> None:
    rows = {row[0]: row[1] for row in table(CALIBRATION, "key", "unit", "meaning")}
    assert set(rows) == set(read("calibration/tolerances/default.toml"))
    load_tolerances(Assets())


# sim/tasks/


@pytest.mark.parametrize("path", sorted((ROOT / "sim/tasks").glob("*.toml")), ids=lambda path: path.stem)
def test_task_loads_and_its_keys_are_explained(path: Path) -> None:
    if path.stem.startswith("spread"):
        laws = load_spread(Assets(), path.stem).laws.keys()
        explained = {key for row in table(TASKS, "key", "unit", "what differs") for key in split(row[0])}
        assert laws == explained if path.stem == "spread" else laws < explained
        return
    load_task(Assets(), path)
    explained = {key for row in table(TASKS, "key", "unit, range") for key in split(row[0])}
    for key, value in tomllib.loads(path.read_text(encoding="utf-8")).items():
        if key in ("main", "style"):
            assert f"[{key}]" in explained
        elif isinstance(value, dict):
            assert {f"{key}.{name}" for name in value} <= explained
        else:
            assert key in explained


def test_every_key_of_a_task_is_explained() -> None:
    explained = {key for row in table(TASKS, "key", "unit, range") for key in split(row[0])}
    assert {f"gp.{name}" for name in Settings.__dataclass_fields__} <= explained
    assert {f"cases.{name}" for name in Cases.__dataclass_fields__} <= explained
    assert {f"world.{name}" for name in World.__dataclass_fields__} <= explained
    tables = ("main", "style", "source", "gp", "cases", "pole", "world")
    assert {name for name in Task.__dataclass_fields__ if name not in tables} <= explained


def test_every_shipped_fitness_term_is_explained() -> None:
    shipped = {name for name, function in terms().items() if function.__module__ == "robolamp.evolve.tasks.fitness"}
    rows = table(TASKS, "term", "what it is") + table(TASKS, "term", "of a figure")
    assert {row[0] for row in rows} == shipped


# sim/lamp/controllers/


def test_terminals_are_explained() -> None:
    rows = [(split(row[0]), row[3]) for row in table(CONTROLLERS, "terminal", "unit")]
    assert tuple(name for names, _ in rows for name in names) == all_terminals(3)
    for names, where in rows:
        kinds = {"twin only": TWIN_ONLY, "optional": OPTIONAL, "yes": on_board_terminals(3), "with an odometer": WAY}
        assert set(names) <= set(kinds[where])


def test_functions_are_explained() -> None:
    written = re.findall(r"\((\S+) a b( c)?\)", " ".join(row[0] for row in table(CONTROLLERS, "function")))
    assert {name: 3 if third else 2 for name, third in written} == {
        name: primitive.arity for name, primitive in PRIMITIVES.items()
    }


def test_example_controller_bows(tmp_path: Path) -> None:
    example = re.search(r"```toml\n(.+?)```", text(CONTROLLERS), re.DOTALL)
    assert example
    path = tmp_path / "bow.toml"
    path.write_text(example[1], encoding="utf-8")
    controller = load_controller(path, load_lamp(Assets()), on_board=True)
    program = compile_program(controller.expressions, ("t", "a1"))
    assert list(program.run([0.5, 0.2])) == pytest.approx([0, 0.15, -0.2])
    assert list(program.run([1.5, 0.2])) == pytest.approx([0, 0.3, -0.2])
    assert list(program.run([2.5, 0.2])) == pytest.approx([0, 0, -0.2])


@pytest.mark.parametrize("path", sorted((ROOT / "sim/lamp/controllers").glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_controller_runs_on_the_lamp_unless_its_name_says_otherwise(path: Path) -> None:
    lamp = load_lamp(Assets())
    controller = load_controller(path, lamp)
    needs = set(controller.terminals) & set(TWIN_ONLY)
    assert bool(needs) == (path.stem.startswith(("luxo-1997", "limbo")) or path.stem.endswith("-sighted"))
    if needs:
        with pytest.raises(ExpressionError, match="which this lamp cannot supply"):
            load_controller(path, lamp, on_board=True)
    else:
        load_controller(path, lamp, on_board=True)
    assert controller.name == path.stem
    assert controller.provenance or not controller.task, "an evolved controller says where it comes from"


# hardware/


def test_keys_of_the_lamp_are_explained() -> None:
    explained = {key for row in table(HARDWARE, "key", "range", "meaning") for key in split(row[0])}
    found = set()
    for key, value in read("hardware/lamp.toml").items():
        tables = value if isinstance(value, list) else [value] if isinstance(value, dict) else []
        found |= {f"{key}.{name}" for each in tables for name in each} if tables else {key}
    assert found == explained


def test_servo_settings_fit_the_lamp() -> None:
    lamp = load_lamp(Assets())
    names = ("ankle", "knee", "neck")
    assert lamp.names == names
    rows = table(HARDWARE, "register", *names)
    settings: dict[int, list[int]] = {}
    for register, *values, factory, _ in rows:
        match = re.fullmatch(r"(.+) \((\d+)\)", register)
        assert match, register
        known = {each.address: each for each in MODELS["XL330-M288-T"].registers.values()}[int(match[2])]
        assert known.name.lower().replace("_", " ") == match[1].lower()
        assert known.eeprom
        assert known.initial == int(factory), register
        settings[known.address] = [int(value) for value in values]
    assert settings[7] == [joint.id for joint in lamp.joints]
    assert set(settings[8]) == {BAUD_CODES[lamp.bus_baud]}
    for joint, highest, lowest in zip(lamp.joints, settings[48], settings[52], strict=True):
        ends = sorted((joint.zero + joint.sign * angle) / RAD_PER_COUNT for angle in (joint.lower, joint.upper))
        assert 8 <= ends[0] - lowest <= 12
        assert 8 <= highest - ends[1] <= 12


def test_joint_table_has_the_signs_of_the_lamp() -> None:
    for joint, row in zip(load_lamp(Assets()).joints, table(HARDWARE, "joint", "between"), strict=True):
        name, _, body, horn, side, sign = row
        assert (name, int(sign)) == (joint.name, joint.sign)
        # Seen from the side the horn faces, the reading rises counter-clockwise, which from the left is forward for
        # the part that turns with the horn; a horn fixed to the part below turns it about.
        upper = {"ankle": "lower arm", "knee": "upper arm", "neck": "head"}[name]
        assert body != horn
        assert int(sign) == (1 if side == "left" else -1) * (1 if horn == upper else -1)


def test_zero_is_the_middle_of_the_turn() -> None:
    for joint in load_lamp(Assets()).joints:
        assert joint.zero == pytest.approx(math.pi, abs=1e-6)
