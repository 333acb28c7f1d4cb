"""Tables: nodes per sigma against the exact surfaces, in nanometres, milliradians, millimetres and irradiance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.lens import Lens
from lensforge.receivers.hits import Hits
from lensforge.receivers.plane import PlaneReceiver
from lensforge.sources.bundle import RayBundle, Source
from lensforge.studies.tradeoff.ladder import Ladder, Meter, Rung, orders_of
from lensforge.studies.tradeoff.truth import DIRECTIONS, LIGHT_UNITS, SHAPE_UNITS, SURFACES, Tables, Truth, directions
from lensforge.surfaces.spline import TableGrid, evaluate_table, grid_for, tabulate
from lensforge.tracing.fused import Scene, trace_tables

SETTINGS = tuple(
    sorted({value for p in PRESETS.values() for value in (p.nodes_per_sigma, p.judge_nodes_per_sigma)} | {1.7})
)
_STEP_RAD = 1e-4  # of the central difference: 1e-8 of truncation, 1e-11 of rounding


@dataclass(frozen=True)
class TableMeasurement:
    """The ladder, the finest grid with its tables, and the exact light that other ladders are held against."""

    ladder: Ladder
    grid: TableGrid
    tables: Tables
    truth: Truth


def table_ladder(lens: Lens, source: Source, settings: Sequence[float] = SETTINGS) -> TableMeasurement:
    """Tables of each number of nodes per sigma; seconds are those of making them."""
    built = {}
    for setting in settings:
        grid = grid_for(lens.detail_rad, setting)
        with Meter() as meter:
            tables = {name: tabulate(grid, getattr(lens, name)) for name in SURFACES}
        built[setting] = grid, tables, meter
    finest, tables, _ = built[max(settings)]
    truth = Truth.of(lens, source, finest, tables)
    rungs = []
    for setting, (grid, made, meter) in built.items():
        light = through_tables(lens, grid, made, truth.rays)
        errors = truth.shape_errors({name: table_normals(grid, table, directions()) for name, table in made.items()})
        errors |= truth.light_errors(light.hits, light.flux)
        nodes = {"nodes": grid.nodes}
        rungs.append(
            Rung(
                setting=setting,
                series="table",
                seconds=meter.seconds,
                peak_mb=meter.peak_mb,
                errors=errors,
                presets=_users(setting),
                other=nodes,
            )
        )
    names = tuple(rungs[0].errors)
    orders = {"table": orders_of(rungs, names)}
    rungs.append(truth.reference_rung("exact sum", SHAPE_UNITS | LIGHT_UNITS))
    ladder = Ladder(
        name="tables",
        title="Tables",
        knob="nodes per sigma",
        reference=f"the exact sum: {DIRECTIONS} directions, {len(truth.rays)} rays",
        plotted=("rho", "irradiance_nmse"),
        against="seconds",
        rows=tuple(rungs),
        order=orders,
    )
    return TableMeasurement(ladder, finest, tables, truth)


def through_tables(lens: Lens, grid: TableGrid, tables: Tables, rays: RayBundle) -> Hits:
    """Hits and flux of ``rays`` by the fused tracer."""
    inner, outer = (torch.from_numpy(tables[name]) for name in SURFACES)
    receiver = PlaneReceiver.of(lens.spec.target, lens.spec.optimise.pixels)
    return Hits.of(receiver.land(trace_tables(inner, outer, Scene(lens.refractive_index, grid), rays)))


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
    judge = [f"{name}, evaluation" for name, preset in PRESETS.items() if preset.judge_nodes_per_sigma == setting]
    return (*design, *judge)
