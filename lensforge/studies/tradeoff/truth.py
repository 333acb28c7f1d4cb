"""What the exact surfaces say, at fixed directions and for fixed rays: the reference of several ladders."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from lensforge.evaluation.exact import trace_exact_sum
from lensforge.evaluation.metrics import jackknife, relative_square
from lensforge.lens import Lens
from lensforge.receivers.hits import Hits
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.splat import splat_flux
from lensforge.records import Metric
from lensforge.sources.bundle import RayBundle, Source
from lensforge.studies.tradeoff.ladder import Errors, Meter, Rung, exactly
from lensforge.surfaces.spline import TableGrid
from lensforge.surfaces.srbf import fibonacci_hemisphere

DIRECTIONS = 4096
RAYS, SCRAMBLES = 2**13, 8
SURFACES = ("inner", "outer")
LIGHT_UNITS = {"hit": "mm", "hit_99_percent": "mm", "irradiance_nmse": ""}
SHAPE_UNITS = {"rho": "nm", "normal": "mrad"}
_SEED = 2**44

Tables = dict[str, Float[np.ndarray, "side side"]]
Shape = tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]


@dataclass(frozen=True)
class Truth:
    """Rays in independent scrambles, one after the other, and where the exact surfaces of ``lens`` send them."""

    lens: Lens
    rays: RayBundle
    exact: Hits
    cost: Meter

    @staticmethod
    def of(lens: Lens, source: Source, grid: TableGrid, tables: Tables) -> "Truth":
        """Trace through the exact surfaces; ``tables``, the finest there are, bracket the crossings."""
        each = max(1, min(RAYS, source.population or RAYS) // SCRAMBLES)
        rays = RayBundle.joined([source.sample(each, _SEED + k) for k in range(SCRAMBLES)])
        with Meter() as cost:
            exact = landed_exactly(lens, grid, tables, rays)
        return Truth(lens, rays, exact, cost)

    def thinned(self, factor: int) -> "Truth":
        """Every ``factor``-th ray only."""
        kept = slice(None, None, factor)
        return replace(self, rays=self.rays.take(kept), exact=self.exact.take(kept))

    def shape_errors(self, shapes: dict[str, Shape]) -> Errors:
        """``rho`` (nm) and ``normal`` (mrad), the larger of both surfaces, of those at :func:`directions`."""
        rho, normal = 0.0, 0.0
        for name, (radius, normals) in shapes.items():
            surface = getattr(self.lens, name)
            rho = max(rho, float(np.abs(radius - surface.radius(directions())).max()))
            chord = np.linalg.norm(normals - surface.normal(directions()), axis=1)
            normal = max(normal, float(2.0 * np.arcsin(0.5 * chord).max()))
        return {"rho": Metric(value=1e6 * rho, unit="nm"), "normal": Metric(value=1e3 * normal, unit="mrad")}

    def light_errors(self, hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]) -> Errors:
        """``hit`` (mm): largest, and 99th percentile, over rays that arrive both ways; ``irradiance_nmse``.

        The irradiance is the splat of the same rays on the design's pixels, so that no noise enters.
        """
        both = (flux > 0.0) & self.exact.arrived
        away = np.linalg.norm(hits - self.exact.hits, axis=1)
        grid = PixelGrid(self.lens.spec.target.receiver_mm, self.lens.spec.optimise.pixels)
        parts = np.array_split(np.arange(len(flux)), SCRAMBLES)
        pictures = [
            [splat_flux(h[part], f[part], grid) for h, f in ((hits, flux), (self.exact.hits, self.exact.flux))]
            for part in parts
        ]
        nmse, noise = jackknife(np.array(pictures), relative_square)
        return {
            "hit": Metric(value=float(away[both].max(initial=0.0)), unit="mm"),
            "hit_99_percent": _percentile(away, both, parts),
            "irradiance_nmse": Metric(value=nmse, standard_error=noise),
        }

    def reference_rung(self, series: str, units: Mapping[str, str]) -> Rung:
        """The exact surfaces as the rung without an error, ``units`` those of the ladder's errors."""
        cost = self.cost
        return Rung(
            setting=0, series=series, seconds=cost.seconds, peak_mb=cost.peak_mb, errors=exactly(units), reference=True
        )


def landed_exactly(lens: Lens, grid: TableGrid, tables: Tables, rays: RayBundle, steps: int = 1) -> Hits:
    """Hits of ``rays`` on the lens's own receiver, through its exact surfaces; see :func:`trace_exact_sum`."""
    receiver = PlaneReceiver.of(lens.spec.target, lens.spec.optimise.pixels)
    return Hits.of(receiver.land_in_torch(trace_exact_sum(lens, grid, tables, rays, steps)))


def directions() -> Float[np.ndarray, "n 3"]:
    """Unit vectors over the hemisphere, off the nodes of any table."""
    return fibonacci_hemisphere(DIRECTIONS)


def _percentile(
    away: Float[np.ndarray, " n"], both: Bool[np.ndarray, " n"], parts: list[Float[np.ndarray, " k"]]
) -> Metric:
    """The 99th percentile, and its standard error by leaving out one scramble at a time."""

    def of(rows: Bool[np.ndarray, " n"]) -> float:
        return float(np.quantile(away[rows], 0.99)) if rows.any() else 0.0

    left_out = []
    for part in parts:
        rows = both.copy()
        rows[part] = False
        left_out.append(of(rows))
    noise = float(np.sqrt((len(parts) - 1) * np.var(left_out)))
    return Metric(value=of(both), unit="mm", standard_error=noise)
