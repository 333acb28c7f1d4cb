"""Convergence of the tables with nodes per sigma: errors of radius, normal, hits and irradiance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from convergence.reference import (
    DIRECTIONS,
    LIGHT_UNITS,
    SHAPE_UNITS,
    SURFACES,
    ExactReference,
    Tables,
    design_receiver,
    directions,
)
from convergence.study import ConvergenceStudy, Meter, orders_of
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.scene.lens import Lens
from lensforge.scene.receiver import Landings
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.bicubic_table import TableGrid, evaluate_table, grid_for, tabulate

SETTINGS = tuple(
    sorted({value for p in PRESETS.values() for value in (p.nodes_per_sigma, p.evaluate_nodes_per_sigma)} | {1.7})
)
_STEP_RAD = 1e-4  # of the central difference: 1e-8 of truncation, 1e-11 of rounding


@dataclass(frozen=True)
class TableMeasurement:
    """The study, the finest grid with its tables, and the exact reference, also for other studies."""

    study: ConvergenceStudy
    grid: TableGrid
    tables: Tables
    reference: ExactReference


def table_study(lens: Lens, source: Source, settings: Sequence[float] = SETTINGS) -> TableMeasurement:
    """Tables at each number of nodes per sigma, against the exact surfaces; seconds are those of tabulation."""
    built = {}
    for setting in settings:
        grid = grid_for(lens.detail_rad, setting)
        with Meter() as meter:
            tables = {name: tabulate(grid, getattr(lens, name)) for name in SURFACES}
        built[setting] = grid, tables, meter
    finest, tables, _ = built[max(settings)]
    reference = ExactReference.of(lens, source, finest, tables)
    levels = []
    for setting, (grid, made, meter) in built.items():
        light = through_tables(lens, grid, made, reference.rays)
        errors = reference.shape_errors(
            {name: table_normals(grid, table, directions()) for name, table in made.items()}
        )
        errors |= reference.light_errors(light.hits, light.flux)
        levels.append(meter.level(setting, "table", errors, _users(setting), nodes=grid.nodes))
    orders = {"table": orders_of(levels, tuple(levels[0].errors))}
    levels.append(reference.level("exact sum", SHAPE_UNITS | LIGHT_UNITS))
    study = ConvergenceStudy(
        name="tables",
        title="Tables",
        knob="nodes per sigma",
        reference=f"the exact sum: {DIRECTIONS} directions, {len(reference.rays)} rays",
        plotted=("rho", "irradiance_nmse"),
        against="seconds",
        levels=tuple(levels),
        order=orders,
    )
    return TableMeasurement(study, finest, tables, reference)


def through_tables(lens: Lens, grid: TableGrid, tables: Tables, rays: RayBundle) -> Landings:
    """Hits and flux of ``rays`` on the first receiver by the fused tracer."""
    inner, outer = (tables[name] for name in SURFACES)
    return design_receiver(lens).land(trace_tables((inner, outer), Scene(lens.media, grid), rays))


def table_normals(
    grid: TableGrid, table: Float[np.ndarray, "side side"], directions: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """``rho`` (mm) and outward unit normals of a table, its gradient by central differences along two tangents."""
    helper = np.where(np.abs(directions[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    radius = evaluate_table(grid, table, directions)
    outward = directions.copy()
    for tangent in (first, np.cross(directions, first)):
        ahead, behind = (
            evaluate_table(grid, table, np.cos(step) * directions + np.sin(step) * tangent)
            for step in (_STEP_RAD, -_STEP_RAD)
        )
        outward -= ((ahead - behind) / (2.0 * _STEP_RAD * radius))[:, None] * tangent
    return radius, outward / np.linalg.norm(outward, axis=1, keepdims=True)


def _users(setting: float) -> tuple[str, ...]:
    design = [f"{name}, design" for name, preset in PRESETS.items() if preset.nodes_per_sigma == setting]
    evaluation = [
        f"{name}, evaluation" for name, preset in PRESETS.items() if preset.evaluate_nodes_per_sigma == setting
    ]
    return (*design, *evaluation)
