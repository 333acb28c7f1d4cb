"""Mutants of the measured modules, by cosmic-ray's operators, in an order drawn from a seed."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from .left_out import left_out, within

# One replacement of each operator of arithmetic, and two of an order: its opposite, and the case of equality.
OPERATORS = (
    *(
        f"ReplaceBinaryOperator_{pair}"
        for pair in (
            "Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Mul", "Mod_Mul", "Pow_Mul",
            "BitOr_BitAnd", "BitAnd_BitOr", "BitXor_BitOr", "LShift_RShift", "RShift_LShift",
        )
    ),
    *(
        f"ReplaceComparisonOperator_{pair}"
        for pair in (
            "Eq_NotEq", "NotEq_Eq", "Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt",
            "Is_IsNot", "IsNot_Is",
        )
    ),
    "ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Not", "ReplaceUnaryOperator_Delete_Invert",
    "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd", "AddNot",
    "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ZeroIterationForLoop", "ExceptionReplacer",
    "NumberReplacer",
)  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change of one place: ``key`` names it by the text of its line, whatever is written above it."""

    module: str  # such as light/by_intensities.py
    operator: str
    occurrence: int  # which place of the operator in the module, as cosmic-ray counts
    line: int
    key: str


def mutants_of(package: Path, module: str) -> list[Mutant]:
    """Every mutant of a module; those of one place that differ (a number: one more, one less) have numbers."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    source = (package / module).read_text(encoding="utf-8")
    lines, places, nodes = source.split("\n"), left_out(source), list(ast_nodes(get_ast(source)))
    found, seen = [], Counter[str]()
    for operator in OPERATORS:
        change = get_operator(f"core/{operator}")()
        begins = (begin for node in nodes for begin, _ in change.mutation_positions(node))
        for occurrence, (line, column) in enumerate(begins):
            text = lines[line - 1]
            union_of_types = "Bit" in operator and not text.startswith(" ")
            if not within((line, column), places) and not union_of_types:
                key = f"{module}: {text.strip()} @{column - len(text) + len(text.lstrip())} {operator}"
                seen[key] += 1
                found.append(Mutant(module, operator, occurrence, line, f"{key} {seen[key]}"))
    return found


def drawn(every: Iterable[list[Mutant]], seed: int) -> list[Mutant]:
    """All mutants in the order of the draw: any number of the first ones has of each module its share of all.

    The order within a module is that of a hash of seed and key, so that a change of one line leaves the others' places.
    """
    placed: list[tuple[float, Mutant]] = []
    for mutants in every:
        if mutants:
            offset = _chance(seed, mutants[0].module)
            ordered = sorted(mutants, key=lambda mutant: _chance(seed, mutant.key))
            placed += [((rank + offset) / len(ordered), mutant) for rank, mutant in enumerate(ordered)]
    return [mutant for _, mutant in sorted(placed, key=lambda pair: pair[0])]


def _chance(seed: int, words: str) -> float:
    """A number in [0, 1) that looks random and is always the same."""
    return int.from_bytes(hashlib.sha256(f"{seed} {words}".encode()).digest()[:6]) / 2**48


def mutated(source: str, mutant: Mutant) -> str | None:
    """The source with the bug; None where that is no program, or the same one."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    changed = mutate_code(source, get_operator(f"core/{mutant.operator}")(), mutant.occurrence)
    try:
        return changed if changed and compile(changed, mutant.module, "exec") else None
    except SyntaxError:
        return None


def changed_lines(source: str, changed: str) -> Iterator[tuple[int, str, str]]:
    """Number, old and new text of the lines that differ."""
    for number, (old, new) in enumerate(zip(source.split("\n"), changed.split("\n"), strict=False), start=1):
        if old != new:
            yield number, old.strip(), new.strip()
