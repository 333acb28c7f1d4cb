"""Exact surfaces at fixed directions and with fixed rays: the reference of several convergence studies."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from convergence.study import Errors, Meter, RefinementLevel, reference_level
from lensforge.light.reference_bodies import ReferenceBody
from lensforge.light.reference_trace import as_arrays, trace_reference
from lensforge.light.table_trace import Scene
from lensforge.results import Metric
from lensforge.results.estimates import jackknife_error, jackknife_metric, relative_square
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import splat_flux
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import fibonacci_hemisphere

DIRECTIONS = 4096
RAYS, SCRAMBLES = 2**13, 8
_SEED = 16 * 2**40  # a range that lensforge.seeds leaves free
SURFACES = ("inner", "outer")
LIGHT_UNITS = {"hit": "mm", "hit_99_percent": "mm", "irradiance_nmse": ""}
SHAPE_UNITS = {"rho": "nm", "normal": "mrad"}

Tables = dict[str, Float[np.ndarray, "side side"]]
Shape = tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]


@dataclass(frozen=True)
class ExactReference:
    """Rays of several independent scrambles, joined, and their hits through the exact surfaces of ``lens``.

    Hits are those on the first receiver.
    """

    lens: Lens
    rays: RayBundle
    exact: Landings
    cost: Meter

    @staticmethod
    def of(lens: Lens, source: Source, grid: TableGrid, tables: Tables) -> "ExactReference":
        """Trace rays of ``source`` through the exact surfaces; ``tables``, fine ones, lead to the crossings."""
        each = max(1, min(RAYS, source.ray_count or RAYS) // SCRAMBLES)
        rays = RayBundle.joined([source.sample(each, _SEED + k) for k in range(SCRAMBLES)])
        with Meter() as cost:
            exact = landed_exactly(lens, grid, tables, rays)
        return ExactReference(lens, rays, exact, cost)

    def thinned(self, factor: int) -> "ExactReference":
        """Every ``factor``-th ray only."""
        kept = slice(None, None, factor)
        return replace(self, rays=self.rays.take(kept), exact=self.exact.take(kept))

    def shape_errors(self, shapes: dict[str, Shape]) -> Errors:
        """Largest errors over both surfaces at :func:`directions`: ``rho`` (nm) and ``normal`` (mrad)."""
        rho, normal = 0.0, 0.0
        for name, (radius, normals) in shapes.items():
            surface = getattr(self.lens, name)
            rho = max(rho, float(np.abs(radius - surface.radius(directions())).max()))
            chord = np.linalg.norm(normals - surface.normal(directions()), axis=1)
            normal = max(normal, float(2.0 * np.arcsin(0.5 * chord).max()))
        return {"rho": Metric(value=1e6 * rho, unit="nm"), "normal": Metric(value=1e3 * normal, unit="mrad")}

    def light_errors(self, hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]) -> Errors:
        """Largest error of a hit and its 99th percentile, over rays that arrive in both; ``irradiance_nmse``.

        Hits are in mm; in the far field a thousandth of the chart counts as 1 mm, which 1 m away it is. The irradiance
        is the splat of the same rays on the design's pixels, so that it has no ray noise.
        """
        both = (flux > 0.0) & self.exact.arrived
        receiver = design_receiver(self.lens)
        away = (1e3 if receiver.kind == "far_field" else 1.0) * np.linalg.norm(hits - self.exact.hits, axis=1)
        grid = receiver.grid
        parts = np.array_split(np.arange(len(flux)), SCRAMBLES)
        pictures = [
            [splat_flux(h[part], f[part], grid) for h, f in ((hits, flux), (self.exact.hits, self.exact.flux))]
            for part in parts
        ]
        nmse = jackknife_metric(np.array(pictures), relative_square)
        return {
            "hit": Metric(value=float(away[both].max(initial=0.0)), unit="mm"),
            "hit_99_percent": _percentile(away, both, parts),
            "irradiance_nmse": nmse,
        }

    def level(self, series: str, units: Mapping[str, str]) -> RefinementLevel:
        """The exact surfaces as a level without errors; ``units`` are those of the study's errors."""
        return reference_level(series, units, self.cost)


def landed_exactly(lens: Lens, grid: TableGrid, tables: Tables, rays: RayBundle, newton_steps: int = 0) -> Landings:
    """Hits of ``rays`` on the lens's own first receiver through its exact surfaces; ``tables`` lead to the crossings.

    ``newton_steps``: additional to the one that ends every search, for tables that are far from the surfaces.
    """
    guides, scene = np.stack([tables[name] for name in SURFACES]), Scene(lens.media, grid)
    body, *further = ReferenceBody.exact(lens.surfaces, scene, guides)
    faces = tuple(replace(face, newton_steps=1 + newton_steps) for face in body.faces)
    return design_receiver(lens).land(as_arrays(trace_reference([replace(body, faces=faces), *further], rays)))


def design_receiver(lens: Lens) -> PosedReceiver:
    """The first receiver of ``lens``, with the pixels of its design."""
    return receivers_of(lens.spec, lens.spec.optimise.pixels)[0]


def directions() -> Float[np.ndarray, "n 3"]:
    """Unit vectors over the hemisphere, off the nodes of any table."""
    return fibonacci_hemisphere(DIRECTIONS)


def _percentile(
    away: Float[np.ndarray, " n"], both: Bool[np.ndarray, " n"], parts: list[Float[np.ndarray, " k"]]
) -> Metric:
    """The 99th percentile, and its standard error by the jackknife over the scrambles ``parts``."""

    def percentile(rows: Bool[np.ndarray, " n"]) -> float:
        return float(np.quantile(away[rows], 0.99)) if rows.any() else 0.0

    left_out = []
    for part in parts:
        rows = both.copy()
        rows[part] = False
        left_out.append(percentile(rows))
    return Metric(value=percentile(both), unit="mm", standard_error=jackknife_error(np.array(left_out)))
