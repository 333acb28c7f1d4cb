"""Precision: float32 against float64, and the tolerance of the search for a crossing.

The fused tracer computes in float64 alone, with a tolerance of 1e-13 of the radius, and both are fixed: what is
offered is what is measured as such. What they are worth is seen on float32 tables, and on the readable tracer, which
runs in either precision and to any tolerance.
"""

from collections.abc import Sequence

import numpy as np
import torch

from lensforge.lens import Lens
from lensforge.receivers.hits import Hits
from lensforge.receivers.plane import PlaneReceiver
from lensforge.records import Metric
from lensforge.sources.bundle import RayBundle
from lensforge.studies.tradeoff.ladder import Ladder, Meter, Rung, exactly, orders_of
from lensforge.studies.tradeoff.tables import through_tables
from lensforge.studies.tradeoff.truth import LIGHT_UNITS, SURFACES, Tables, Truth
from lensforge.surfaces.spline import TableGrid
from lensforge.surfaces.srbf import SrbfSurface
from lensforge.tracing.reference import ExactSurface, Search, trace_exact

BISECTIONS = (0, 2, 4, 6, 8, 12, 16, 40)
_RAYS = 2**6  # the readable tracer asks for every function at each of its many steps
_SCAN = 48


def precision_ladder(truth: Truth, grid: TableGrid, tables: Tables) -> Ladder:
    """Tables in float32 and float64 by the fused tracer; the exact sum in both by the readable one."""
    rungs = []
    for bits, dtype in ((32, np.float32), (64, np.float64)):
        stored: Tables = {name: table.astype(dtype) for name, table in tables.items()}
        with Meter() as meter:
            light = through_tables(truth.lens, grid, {n: t.astype(np.float64) for n, t in stored.items()}, truth.rays)
        megabytes = sum(table.nbytes for table in stored.values()) / 1e6
        users = ("all commands",) if bits == 64 else ()
        errors = truth.light_errors(light.hits, light.flux)
        rungs.append(
            Rung(
                setting=bits,
                series="tables",
                seconds=meter.seconds,
                peak_mb=meter.peak_mb,
                errors=errors,
                presets=users,
                other={"tables_mb": megabytes},
            )
        )
    if _is_a_sum(truth.lens):
        few = _few(truth)
        for bits, precision in ((32, torch.float32), (64, torch.float64)):
            with Meter() as meter:
                hits, flux = _read(few.lens, few.rays, precision, Search(_SCAN))
            rungs.append(
                Rung(
                    setting=bits,
                    series="exact sum",
                    seconds=meter.seconds,
                    peak_mb=meter.peak_mb,
                    errors=few.light_errors(hits, flux),
                )
            )
    nothing = exactly(LIGHT_UNITS)
    rungs.append(
        Rung(
            setting=64,
            series="exact surfaces",
            seconds=truth.cost.seconds,
            peak_mb=truth.cost.peak_mb,
            errors=nothing,
            reference=True,
        )
    )
    return Ladder(
        name="precision",
        title="float32 and float64",
        knob="bits; fixed at 64",
        reference=f"the exact surfaces in float64: {len(truth.rays)} rays, {_RAYS} for the exact sum",
        plotted=(),
        against="setting",
        rows=tuple(rungs),
    )


def search_ladder(truth: Truth, settings: Sequence[int] = BISECTIONS) -> Ladder | None:
    """Bisections before the one Newton step that ends each search; None for a lens that is not two SRBF sums."""
    if not _is_a_sum(truth.lens):
        return None
    few = _few(truth)
    reach = 2.0 * max(_reach(getattr(few.lens, name)) for name in SURFACES)
    found = {}
    for bisections in settings:
        with Meter() as meter:
            light = _read(few.lens, few.rays, torch.float64, Search(_SCAN, bisections))
        found[bisections] = meter, light
    meter, (hits, flux) = found[max(settings)]
    arrived = flux > 0.0
    rungs = []
    for bisections, (cost, (landed, carried)) in found.items():
        both = arrived & (carried > 0.0)
        away = np.linalg.norm(landed - hits, axis=1)[both]
        errors = {
            "hit": Metric(value=float(away.max(initial=0.0)), unit="mm"),
            "flux": Metric(value=float(np.abs(carried - flux).sum() / flux.sum()), unit="of the flux"),
        }
        tolerance = reach / _SCAN / 2.0**bisections
        last = bisections == max(settings)
        other = {"bisections": bisections}
        rungs.append(
            Rung(
                setting=tolerance,
                series="readable tracer",
                seconds=cost.seconds,
                peak_mb=cost.peak_mb,
                errors=errors,
                other=other,
                reference=last,
            )
        )
    return Ladder(
        name="search",
        title="Tolerance of the search",
        knob="tracing.reference.Search (mm); the fused tracer's is fixed at 1e-13 of the radius",
        reference=f"{max(settings)} bisections: {len(few.rays)} rays through the exact sum",
        plotted=("hit",),
        against="setting",
        rows=tuple(rungs),
        order={"readable tracer": orders_of(rungs, ("hit",))},
    )


def _few(truth: Truth) -> Truth:
    return truth.thinned(max(1, len(truth.rays) // _RAYS))


def _is_a_sum(lens: Lens) -> bool:
    return all(isinstance(getattr(lens, name), SrbfSurface) for name in SURFACES)


def _reach(surface: SrbfSurface) -> float:
    return float(surface.offset_mm + np.abs(surface.weights).sum())


def _read(lens: Lens, rays: RayBundle, dtype: torch.dtype, search: Search) -> tuple[np.ndarray, np.ndarray]:
    """Hits and flux by the readable tracer, in float64."""
    inner, outer = [
        ExactSurface(s.basis, torch.tensor(s.weights, dtype=dtype), torch.tensor(s.offset_mm, dtype=dtype), search)
        for s in (getattr(lens, name) for name in SURFACES)
    ]
    with torch.no_grad():
        exit_rays = trace_exact(inner, outer, lens.refractive_index, rays)
    landed = Hits.of(PlaneReceiver.of(lens.spec.target, lens.spec.optimise.pixels).land_in_torch(exit_rays))
    return landed.hits, landed.flux
