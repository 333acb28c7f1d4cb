"""A sweep and a trade-off on the screen: a line for each design, and for each preset."""

from typing import TYPE_CHECKING

from lensforge.cli.rounded import count, figure, in_percent, measured
from lensforge.cli.screen import Block, Row

if TYPE_CHECKING:
    from lensforge.runs.sweep import Sweep, SweepRow
    from lensforge.runs.tradeoff.record import PresetStage, Tradeoff


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
    """Rays and errors of each preset, in the search and in the evaluation."""
    rows: list[Row] = []
    for name, preset in found.presets.items():
        rows += [(name, f"search: {_preset(preset.design)}"), ("", f"evaluation: {_preset(preset.evaluation)}")]
    return Block("Error of each preset on this scene", rows)


def _preset(stage: "PresetStage") -> str:
    noise = f"{count(stage.rays)} rays, noise adds an NMSE of {figure(stage.noise_nmse, digits=2)}"
    tables = stage.table_irradiance_nmse
    return noise if tables is None else f"{noise}, the tables {measured(tables)}"
