"""Single against double precision, and the tolerance of the search for a crossing, measured on finished lenses.

    python benchmarks/precision.py cad_out/flat_top cad_out/pi [--json FILE]

The compiled tracer computes in float64 and closes in on a crossing until Newton's step is below 1e-12 of the distance
from the origin; both are fixed. Their effect is measured on float32 tables, and on the exact tracer, which runs in
either precision and to any tolerance. Prints the tables of docs/accuracy.md.
"""

from study_script import main  # before torch

# isort: split
from collections.abc import Sequence

import numpy as np
import torch

from lensforge.light.exact_trace import DenseScan, ExactSurface, trace_exact
from lensforge.results import Metric
from lensforge.runs.tradeoff.convergence import ConvergenceStudy, Meter, orders_of
from lensforge.runs.tradeoff.reference import LIGHT_UNITS, SURFACES, ExactReference, design_receiver
from lensforge.runs.tradeoff.tables import TableMeasurement, through_tables
from lensforge.scene.lens import Lens
from lensforge.scene.receiver import Hits
from lensforge.surfaces.srbf import SrbfSurface

BISECTIONS = (0, 2, 4, 6, 8, 12, 16, 40)
EXACT_RAYS = 2**6  # with a dense scan every ray sees every function at each of many steps
SCAN = 48


def precision_study(measured: TableMeasurement) -> ConvergenceStudy:
    """Tables in float32 and float64 by the compiled tracer; the exact sum in both by the exact one."""
    reference = measured.reference
    levels = []
    for bits, dtype in ((32, np.float32), (64, np.float64)):
        stored = {name: table.astype(dtype) for name, table in measured.tables.items()}
        with Meter() as meter:
            tables = {name: table.astype(np.float64) for name, table in stored.items()}
            light = through_tables(reference.lens, measured.grid, tables, reference.rays)
        users = ("all commands",) if bits == 64 else ()
        megabytes = {"tables (MB)": sum(table.nbytes for table in stored.values()) / 1e6}
        levels.append(meter.level(bits, "tables", reference.light_errors(light.hits, light.flux), users, **megabytes))
    if is_a_sum(reference.lens):
        few = thinned(reference)
        for bits, precision in ((32, torch.float32), (64, torch.float64)):
            with Meter() as meter:
                light = exact_light(few, precision, DenseScan(SCAN))
            levels.append(meter.level(bits, "exact sum", few.light_errors(light.hits, light.flux)))
    levels.append(reference.level("exact surfaces", LIGHT_UNITS).model_copy(update={"setting": 64}))
    return ConvergenceStudy(
        name="precision",
        title="float32 and float64",
        knob="bits; fixed at 64",
        reference=f"the exact surfaces in float64: {len(reference.rays)} rays, {EXACT_RAYS} for the exact sum",
        plotted=(),
        against="setting",
        levels=tuple(levels),
    )


def search_study(measured: TableMeasurement, settings: Sequence[int] = BISECTIONS) -> ConvergenceStudy:
    """Bisections before the one Newton step that ends each search; the setting is the tolerance (mm) they reach."""
    few = thinned(measured.reference)
    reach_mm = max(exact_surface(few.lens, name, torch.float64, DenseScan()).reach_mm for name in SURFACES)
    found = {}
    for bisections in settings:
        with Meter() as meter:
            light = exact_light(few, torch.float64, DenseScan(SCAN, bisections))
        found[bisections] = meter, light
    best = found[max(settings)][1]
    levels = []
    for bisections, (meter, light) in found.items():
        both = best.arrived & light.arrived
        away = np.linalg.norm(light.hits - best.hits, axis=1)[both]
        errors = {
            "hit": Metric(value=float(away.max(initial=0.0)), unit="mm"),
            "flux": Metric(value=float(np.abs(light.flux - best.flux).sum() / best.flux.sum()), unit="of the flux"),
        }
        level = meter.level(reach_mm / SCAN / 2.0**bisections, "exact tracer", errors, bisections=bisections)
        levels.append(level.model_copy(update={"reference": bisections == max(settings)}))
    return ConvergenceStudy(
        name="search",
        title="Tolerance of the search",
        knob="tracing.exact.DenseScan (mm); the compiled tracer's is fixed",
        reference=f"{max(settings)} bisections: {len(few.rays)} rays through the exact sum",
        plotted=(),
        against="setting",
        levels=tuple(levels),
        order={"exact tracer": orders_of(levels, ("hit",))},
    )


def thinned(reference: ExactReference) -> ExactReference:
    return reference.thinned(max(1, len(reference.rays) // EXACT_RAYS))


def is_a_sum(lens: Lens) -> bool:
    return all(isinstance(getattr(lens, name), SrbfSurface) for name in SURFACES)


def exact_surface(lens: Lens, name: str, dtype: torch.dtype, scan: DenseScan) -> ExactSurface:
    surface = getattr(lens, name)
    weights, offset = (torch.tensor(value, dtype=dtype) for value in (surface.weights_mm, surface.offset_mm))
    return ExactSurface(surface.basis, weights, offset, scan)


def exact_light(reference: ExactReference, dtype: torch.dtype, scan: DenseScan) -> Hits:
    """Hits and flux of the reference's rays by the exact tracer."""
    lens = reference.lens
    inner, outer = (exact_surface(lens, name, dtype, scan) for name in SURFACES)
    with torch.no_grad():
        exits = trace_exact(inner, outer, lens.media, reference.rays)
    return Hits.of(design_receiver(lens).land_in_torch(exits))


def studies_of(measured: TableMeasurement) -> list[ConvergenceStudy]:
    """Both studies; that of the search only for a lens of two SRBF sums."""
    return [precision_study(measured), *([search_study(measured)] if is_a_sum(measured.reference.lens) else [])]


if __name__ == "__main__":
    main("Precision and search tolerance, measured on finished lenses.", studies_of)
