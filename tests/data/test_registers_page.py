"""docs/registers.md says what the table of registers says."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from robolamp.dynamixel.registers import MODELS
from robolamp.robot.servo_settings import INDIRECT, RULES, Rule, Seen

PAGE = Path(__file__).parents[2] / "docs" / "registers.md"
X330 = "XL330 only"


def row(name: str, rule: Rule) -> str:
    return f"| {name} | {rule.seen} | {rule.right} | {'yes' if rule.mend else 'no'} | {rule.why} |"


def rows() -> list[str]:
    """The page's rows, in the order of the addresses."""
    table = {name: register for model in MODELS.values() for name, register in model.registers.items()}
    found = []
    for name in sorted(RULES, key=lambda name: table[name].address):
        lacking = any(name not in model.registers for model in MODELS.values())
        found.append(row(f"{name} ({table[name].address}){', ' + X330 if lacking else ''}", RULES[name]))
    return found + [row(name, rule) for name, rule in INDIRECT.items()]


def counts() -> str:
    """How many there are of each class, by model: registers with a row each, without the indirect ones."""
    said = []
    for model in MODELS.values():
        number = Counter(RULES[name].seen for name, register in model.registers.items() if register.writable)
        said.append(f"{model.name}: " + ", ".join(f"{number[seen]} {seen}" for seen in Seen))
    return "; ".join(said) + "."


def test_the_page_has_the_rows_and_counts_of_the_table() -> None:
    lines = PAGE.read_text().splitlines()
    begin = next(at for at, line in enumerate(lines) if line.startswith("| register "))
    assert [line for line in lines[begin + 2 :] if line.startswith("| ")] == rows()
    assert counts() in " ".join(lines)
