"""Tables: nodes per sigma against the exact SRBF sum, in nanometres, milliradians, millimetres and irradiance."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.evaluation.exact import ExactHits, trace_exact_sum
from lensforge.lens import Lens
from lensforge.receiver.plane import Receiver
from lensforge.receiver.splat import splat_flux
from lensforge.sources.bundle import RayBundle, Source
from lensforge.surfaces.spline import TableGrid, evaluate_table, grid_for, tabulate
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface
from lensforge.tracing.fused import Scene, trace_tables
from lensforge.tradeoff.ladder import Estimate, Ladder, Meter, Rung, orders_of

EXACT_RAYS = 2**13
SETTINGS = tuple(
    sorted({value for p in PRESETS.values() for value in (p.nodes_per_sigma, p.judge_nodes_per_sigma)} | {1.7})
)
_DIRECTIONS = 4096
_STEP_RAD = 1e-4  # of the central difference: 1e-8 of truncation, 1e-11 of rounding
_SEED = 2**44

Tables = dict[str, Float[np.ndarray, "side side"]]


def table_ladder(lens: Lens, source: Source, settings: Sequence[float] = SETTINGS) -> tuple[Ladder, TableGrid, Tables]:
    """The ladder, and the finest grid with its tables.

    ``rho`` and ``normal``: largest over directions of the hemisphere off the nodes, of both surfaces. ``hit``: largest
    and 99th percentile over rays that arrive both ways. ``irradiance_nmse``: the same rays splatted on the design's
    pixels, so that no noise enters.
    """
    built = {}
    for setting in settings:
        grid = grid_for(lens.detail_rad, setting)
        with Meter() as meter:
            tables = {name: tabulate(grid, getattr(lens, name)) for name in ("inner", "outer")}
        built[setting] = grid, tables, meter
    finest, tables, _ = built[max(settings)]
    rays = source.sample(min(EXACT_RAYS, source.population or EXACT_RAYS), _SEED)
    with Meter() as exactly:
        exact = trace_exact_sum(lens, finest, tables, rays)
    truth = _Truth(lens, rays, exact)
    rungs = [
        Rung(
            setting,
            "table",
            meter.seconds,
            meter.peak_mb,
            truth.errors(grid, of_setting),
            _users(setting),
            {"nodes": grid.nodes},
        )
        for setting, (grid, of_setting, meter) in built.items()
    ]
    names = tuple(rungs[0].errors)
    orders = {"table": orders_of(rungs, names)}
    nothing = {name: Estimate(0.0) for name in names}
    rungs.append(Rung(0.0, "exact sum", exactly.seconds, exactly.peak_mb, nothing, reference=True))
    units = {"rho": "nm", "normal": "mrad", "hit": "mm", "hit_99_percent": "mm", "irradiance_nmse": ""}
    reference = f"the exact sum: {_DIRECTIONS} directions, {len(rays)} rays"
    shown = ("rho", "irradiance_nmse")
    ladder = Ladder("tables", "Tables", "nodes per sigma", reference, units, shown, "seconds", tuple(rungs), orders)
    return ladder, finest, tables


class _Truth:
    """What the exact sum says at fixed directions and for fixed rays."""

    def __init__(self, lens: Lens, rays: RayBundle, exact: ExactHits) -> None:
        self._lens, self._rays, self._exact = lens, rays, exact
        self._directions = fibonacci_hemisphere(_DIRECTIONS)
        surfaces: dict[str, Surface] = {name: getattr(lens, name) for name in ("inner", "outer")}
        self._radius = {name: surface.radius(self._directions) for name, surface in surfaces.items()}
        self._normal = {name: surface.normal(self._directions) for name, surface in surfaces.items()}
        self._receiver = Receiver(lens.spec.target.receiver_mm, lens.spec.optimise.pixels)
        self._image = self._splat(exact.hits, exact.flux)

    def errors(self, grid: TableGrid, tables: Tables) -> dict[str, Estimate]:
        rho, normal = 0.0, 0.0
        for name, table in tables.items():
            radius, normals = table_normals(grid, table, self._directions)
            rho = max(rho, float(np.abs(radius - self._radius[name]).max()))
            chord = np.linalg.norm(normals - self._normal[name], axis=1)
            normal = max(normal, float(2.0 * np.arcsin(0.5 * chord).max()))
        scene = Scene(self._lens.refractive_index, self._lens.spec.target.distance_mm, grid)
        arrivals = trace_tables(torch.from_numpy(tables["inner"]), torch.from_numpy(tables["outer"]), scene, self._rays)
        both = arrivals.arrived.numpy() & self._exact.arrived
        away = np.linalg.norm(arrivals.hits.numpy()[both] - self._exact.hits[both], axis=1)
        image = self._splat(arrivals.hits.numpy(), arrivals.flux.numpy())
        difference = np.sum((image - self._image) ** 2) / np.sum(self._image**2)
        return {
            "rho": Estimate(1e6 * rho),
            "normal": Estimate(1e3 * normal),
            "hit": Estimate(float(away.max())),
            "hit_99_percent": Estimate(float(np.quantile(away, 0.99))),
            "irradiance_nmse": Estimate(float(difference)),
        }

    def _splat(self, hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]) -> Float[np.ndarray, "p p"]:
        return splat_flux(torch.from_numpy(hits), torch.from_numpy(flux), self._receiver).numpy()


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
