"""What the exact surfaces say, at fixed directions and for fixed rays: the reference of several ladders."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from lensforge.evaluation.exact import ExactHits, trace_exact_sum
from lensforge.evaluation.metrics import jackknife, relative_square
from lensforge.lens import Lens
from lensforge.receivers.plane import Receiver
from lensforge.receivers.splat import splat_flux
from lensforge.sources.bundle import RayBundle, Source
from lensforge.surfaces.spline import TableGrid
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.studies.tradeoff.ladder import Estimate, Meter

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
    exact: ExactHits
    cost: Meter

    @staticmethod
    def of(lens: Lens, source: Source, grid: TableGrid, tables: Tables) -> "Truth":
        """Trace through the exact surfaces; ``tables``, the finest there are, bracket the crossings."""
        each = max(1, min(RAYS, source.population or RAYS) // SCRAMBLES)
        rays = RayBundle.joined([source.sample(each, _SEED + k) for k in range(SCRAMBLES)])
        with Meter() as cost:
            exact = trace_exact_sum(lens, grid, tables, rays)
        return Truth(lens, rays, exact, cost)

    def thinned(self, factor: int) -> "Truth":
        """Every ``factor``-th ray only."""
        kept = slice(None, None, factor)
        return replace(self, rays=self.rays.take(kept), exact=self.exact.take(kept))

    def shape_errors(self, shapes: dict[str, Shape]) -> dict[str, Estimate]:
        """``rho`` (nm) and ``normal`` (mrad), the larger of both surfaces, of those at :func:`directions`."""
        rho, normal = 0.0, 0.0
        for name, (radius, normals) in shapes.items():
            surface = getattr(self.lens, name)
            rho = max(rho, float(np.abs(radius - surface.radius(directions())).max()))
            chord = np.linalg.norm(normals - surface.normal(directions()), axis=1)
            normal = max(normal, float(2.0 * np.arcsin(0.5 * chord).max()))
        return {"rho": Estimate(1e6 * rho), "normal": Estimate(1e3 * normal)}

    def light_errors(self, hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]) -> dict[str, Estimate]:
        """``hit`` (mm): largest, and 99th percentile, over rays that arrive both ways; ``irradiance_nmse``.

        The irradiance is the splat of the same rays on the design's pixels, so that no noise enters.
        """
        both = (flux > 0.0) & self.exact.arrived
        away = np.linalg.norm(hits - self.exact.hits, axis=1)
        receiver = Receiver(self.lens.spec.target.receiver_mm, self.lens.spec.optimise.pixels)
        parts = np.array_split(np.arange(len(flux)), SCRAMBLES)
        pictures = [
            [splat_flux(h[part], f[part], receiver) for h, f in ((hits, flux), (self.exact.hits, self.exact.flux))]
            for part in parts
        ]
        return {
            "hit": Estimate(float(away[both].max(initial=0.0))),
            "hit_99_percent": _percentile(away, both, parts),
            "irradiance_nmse": Estimate(*jackknife(np.array(pictures), relative_square)),
        }

    def exactly(self, names: tuple[str, ...]) -> dict[str, Estimate]:
        """The errors of the reference itself: none."""
        return {name: Estimate(0.0) for name in names}


def directions() -> Float[np.ndarray, "n 3"]:
    """Unit vectors over the hemisphere, off the nodes of any table."""
    return fibonacci_hemisphere(DIRECTIONS)


def _percentile(
    away: Float[np.ndarray, " n"], both: Bool[np.ndarray, " n"], parts: list[Float[np.ndarray, " k"]]
) -> Estimate:
    """The 99th percentile, and its standard error by leaving out one scramble at a time."""

    def of(rows: Bool[np.ndarray, " n"]) -> float:
        return float(np.quantile(away[rows], 0.99)) if rows.any() else 0.0

    left_out = []
    for part in parts:
        rows = both.copy()
        rows[part] = False
        left_out.append(of(rows))
    return Estimate(of(both), float(np.sqrt((len(parts) - 1) * np.var(left_out))))
