"""Decoding and operators against geppy (Gao 2018), which shares no code with ours, given the same choices."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from robolamp.controller.gene import Gene
from robolamp.controller.primitives import PRIMITIVES
from robolamp.evolve.representations.gep_operators import between, swap, transposed

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of geppy and DEAP, guests here
    import geppy
    from geppy.tools import crossover, mutation

HEAD, CONSTANTS, GENES = 6, 4, 3
TAIL = 2 * HEAD + 1
BODY, LENGTH = HEAD + TAIL, HEAD + 2 * TAIL
LEAVES = ("t", "a0", "a1", "?")
NAMES = (*PRIMITIVES, *LEAVES)


def primitive_set() -> Any:
    found = geppy.PrimitiveSet("main", input_names=["t", "a0", "a1"])
    for name, own in PRIMITIVES.items():
        found.add_function(own.function, own.arity, name=WORDS[name])
    found.add_rnc_terminal()  # which geppy calls ?
    return found


WORDS = {"+": "add", "-": "sub", "*": "mul", "%": "div", "ifltz": "ifltz"}
OWN = {word: name for name, word in WORDS.items()}
SYMBOLS = {OWN.get(item.name, item.name): item for item in (*primitive_set().functions, *primitive_set().terminals)}


def drawn(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    head = rng.integers(len(NAMES), size=(GENES, HEAD))
    tail = rng.integers(len(PRIMITIVES), len(NAMES), size=(GENES, TAIL))
    domain = rng.integers(CONSTANTS, size=(GENES, TAIL))
    return np.concatenate([head, tail, domain], axis=1).astype(np.int16), rng.normal(size=(GENES, CONSTANTS))


def to_geppy(symbols: np.ndarray, constants: np.ndarray) -> list[Any]:
    return [
        geppy.GeneDc.from_genome(
            [*(SYMBOLS[NAMES[i]] for i in row[:BODY]), *row[BODY:].tolist()], HEAD, values.tolist()
        )
        for row, values in zip(symbols, constants, strict=True)
    ]


def from_geppy(chromosome: list[Any]) -> list[list[int]]:
    return [
        [*(NAMES.index(OWN.get(item.name, item.name)) for item in gene[:BODY]), *gene[BODY:]] for gene in chromosome
    ]


def test_genes_express_the_same_trees() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        symbols, constants = drawn(rng)
        for row, values, guest in zip(symbols, constants, to_geppy(symbols, constants), strict=True):
            gene = Gene(tuple(NAMES[i] for i in row[:BODY]), tuple(row[BODY:].tolist()), tuple(values.tolist()), HEAD)

            def nested(node: Any) -> tuple[Any, ...]:
                return (OWN.get(node.name, node.name), *(nested(child) for child in node.children))

            def own(tokens: list[Any]) -> tuple[Any, ...]:
                token = tokens.pop(0)
                arity = PRIMITIVES[token].arity if token in PRIMITIVES else 0
                return (str(token), *(own(tokens) for _ in range(arity)))

            assert own(list(gene.expression.tokens)) == nested(geppy.ExpressionTree.from_genotype(guest).root)


@pytest.mark.parametrize("root", [False, True])
def test_transposition(root: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        symbols, constants = drawn(rng)
        donor, receiver = rng.integers(GENES, size=2)
        functions = np.flatnonzero(symbols[donor, :HEAD] < len(PRIMITIVES))
        if root and not len(functions):
            continue
        length = int(rng.integers(2 if root else 1, 5))
        start = int(rng.choice(functions)) if root else int(rng.integers(BODY - length + 1))
        place = 0 if root else int(rng.integers(1, HEAD - length + 1))
        guest = to_geppy(symbols, constants)
        monkeypatch.setattr(mutation, "_choose_donor_donee", lambda c, d=donor, r=receiver: (c[d], c[r], d, r))
        monkeypatch.setattr(mutation, "_choose_subsequence_indices", lambda *_, s=start, n=length, **__: (s, s + n - 1))
        monkeypatch.setattr(mutation.random, "choice", lambda _, s=start: s)
        monkeypatch.setattr(mutation.random, "randint", lambda *_, v=length if root else place: v)
        (mutation.ris_transpose if root else mutation.is_transpose)(guest)
        one = [np.array([value]) for value in (start, length, place)]
        symbols[receiver] = transposed(symbols[[receiver]], symbols[[donor]], one[0], one[1], one[2], HEAD)[0]
        assert from_geppy(guest) == symbols.tolist()


@pytest.mark.parametrize("kind", ["one", "two", "gene"])
def test_recombination(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    for _ in range(100):
        parents = [drawn(rng) for _ in range(2)]
        guests = [to_geppy(*parent) for parent in parents]
        if kind == "gene":
            gene = int(rng.integers(GENES))
            low, high = gene * LENGTH, (gene + 1) * LENGTH
            monkeypatch.setattr(crossover.random, "choices", lambda *_, g=gene, **__: [g, g])
            crossover.crossover_gene(*guests)
        elif kind == "one":
            gene, point = int(rng.integers(GENES)), int(rng.integers(LENGTH))
            low, high = gene * LENGTH + point + 1, GENES * LENGTH
            draws = iter((gene, point))
            monkeypatch.setattr(crossover.random, "randint", lambda *_, d=draws: next(d))
            crossover.crossover_one_point(*guests)
            guests.reverse()  # geppy exchanges what is before the point
        else:
            (first, one), (second, two) = sorted([(int(rng.integers(GENES)), int(rng.integers(LENGTH))) for _ in "ab"])
            low, high = first * LENGTH + one, second * LENGTH + two + 1
            draws = iter((one, two))
            monkeypatch.setattr(crossover.random, "choices", lambda *_, f=first, s=second, **__: [f, s])
            monkeypatch.setattr(crossover.random, "randint", lambda *_, d=draws: next(d))
            crossover.crossover_two_point(*guests)
        symbols = np.stack([parent[0] for parent in parents])
        constants = np.stack([parent[1] for parent in parents])
        mask = between(np.array([low]), np.array([high]), GENES, LENGTH)
        swap(symbols, constants, np.array([0]), np.array([1]), mask)
        assert [from_geppy(guest) for guest in guests] == symbols.tolist()
        if kind == "gene":
            assert [[gene.rnc_array for gene in guest] for guest in guests] == constants.tolist()
