"""A sweep and a trade-off on the screen: a line for each design, and for each preset."""

from typing import TYPE_CHECKING

from lensforge.cli.rounded import count, figure, in_percent, measured
from lensforge.cli.screen import Block, Row

if TYPE_CHECKING:
    from lensforge.runs.sweep import Sweep, SweepRow
    from lensforge.runs.tradeoff_result import Tradeoff


def sweep_block(sweep: "Sweep") -> Block:
    """A line for each design, by the value of the varied field."""
    return Block(f"{sweep.vary}, {len(sweep.designs)} designs", [_design(row) for row in sweep.designs])


def _design(row: "SweepRow") -> Row:
    even = "" if row.uniformity is None else f", uniformity {measured(row.uniformity)}"
    missed = sum(not criterion.passed for criterion in row.criteria)
    failed = f"; {missed} {'criterion' if missed == 1 else 'criteria'} missed" if missed else ""
    return (
        f"{row.value:g}",
        f"NMSE {measured(row.nmse)}{even}, efficiency {in_percent(row.efficiency)}, radius "
        f"{figure(row.max_radius_mm, 'mm')}, height {figure(row.height_mm, 'mm')}{failed}",
    )


def tradeoff_block(found: "Tradeoff") -> Block:
    """Seconds and errors of each preset's evaluation, and of each stage of a search."""
    rows: list[Row] = []
    for row in (*found.series("presets"), *found.series("search")):
        light = f"NMSE {measured(row.nmse)}, efficiency {in_percent(row.efficiency)}"
        cost = f"{figure(row.seconds, 's', digits=2)}, {count(row.rays)} rays"
        rows.append((row.setting, f"{cost}: {light}"))
    return Block("Accuracy against time on this scene: evaluations, then a search", rows)
