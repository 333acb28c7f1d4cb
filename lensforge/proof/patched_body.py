"""A measured body of the scene as verification sees it: the light of its own rays on each patch, by its own walk.

Which piece of the surface belongs to which patch is told by the design; where the pieces are, how large they are, and
which one a ray meets first is found here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lensforge.proof.obstacles import ObstacleBody, Obstacles
from lensforge.proof.proof_result import BodyLightProof
from lensforge.proof.sequential_cast import CastFate, Passage
from lensforge.results import Metric
from lensforge.sources.ray_bundle import RayBundle

_OF_GROUP = 10.0  # rays that a group of patches should have, to be compared
_M2 = 1e-6  # in a mm2


@dataclass(frozen=True, eq=False)
class PatchedBody:
    """The body ``name``: the ``pieces`` of its surface, the number of the patch of each, and the ``others`` before it.

    ``designed``: irradiance (W/m²) of each patch by the design, by ``designed_rays``, whose noise counts. ``events``:
    the most bodies from which light goes on.
    """

    name: str
    pieces: ObstacleBody
    patches: Int[np.ndarray, " t"]
    others: Sequence[ObstacleBody]
    designed: Float[np.ndarray, " p"]
    designed_rays: int
    events: int = 1

    def judge(self, rays: RayBundle, passage: Passage) -> BodyLightProof:
        """The light of ``rays``, by their ``passage`` through the part, against the design's."""
        flux, squares, of_rays = self._on_patches(passage)
        areas_m2 = self._areas_m2
        emitted_w = float(rays.flux.sum())
        expected = self.designed * areas_m2
        dark = expected <= 0.0
        per_ray_w = float(squares.sum()) / (float(flux.sum()) or np.inf)  # the mean, weighted by flux
        apart = _apart(flux[~dark], expected[~dark], per_ray_w or float(rays.flux.mean()))
        apart /= 1.0 + len(rays) / self.designed_rays
        darkest = int(self.designed.argmin())
        whole_m2 = float(areas_m2.sum())
        error_w = np.sqrt(max(of_rays - float(flux.sum()) ** 2 / len(rays), 0.0))
        return BodyLightProof(
            name=self.name,
            rays=len(rays),
            mean=Metric(value=float(flux.sum()) / whole_m2, standard_error=float(error_w) / whole_m2, unit="W/m²"),
            mean_design=float(expected.sum()) / whole_m2,
            least=Metric(
                value=float(flux[darkest] / areas_m2[darkest]),
                standard_error=float(np.sqrt(squares[darkest]) / areas_m2[darkest]),
                unit="W/m²",
            ),
            least_design=float(self.designed[darkest]),
            groups=len(apart),
            apart=float(apart.mean()) if len(apart) else 0.0,
            in_dark=float(flux[dark].sum()) / emitted_w,
        )

    @property
    def _areas_m2(self) -> Float[np.ndarray, " p"]:
        """Area of each patch, by the lengths of the edges of its pieces (Heron)."""
        corners = self.pieces.corners
        a, b, c = (np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=1) for k in range(3))
        half = 0.5 * (a + b + c)
        areas = np.sqrt(np.maximum(half * (half - a) * (half - b) * (half - c), 0.0))
        return np.bincount(self.patches, _M2 * areas, len(self.designed))

    def _on_patches(self, passage: Passage) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"], float]:
        """Flux (W) on each patch, sum of squared landings (W²) there, and sum of squared fluxes per ray (W²)."""
        bodies = Obstacles.of([self.pieces, *self.others], self.events)
        assert bodies is not None
        left = passage.fates == CastFate.LANDED
        ways = bodies.ways(passage.points[left], passage.directions[left], passage.draws[left], _without_end)
        landed = []
        for way in ways:
            on_body = (way.met.triangles >= 0) & (way.met.triangles < len(self.patches))
            rows = way.rows[on_body]
            landed.append(
                (rows, passage.flux[left][rows] * way.share[on_body], self.patches[way.met.triangles[on_body]])
            )
        order = np.concatenate([rows for rows, *_ in landed]).argsort(kind="stable")  # of the rays: sums have one order
        rows, flux, patches = (np.concatenate(column)[order] for column in zip(*landed, strict=True))
        size = len(self.designed)
        of_rays = float((np.bincount(rows, flux) ** 2).sum())
        return np.bincount(patches, flux, size), np.bincount(patches, flux**2, size), of_rays


def _without_end(points: Float[np.ndarray, "k 3"], _directions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
    return np.full(len(points), np.inf)


def _apart(
    flux: Float[np.ndarray, " k"], expected: Float[np.ndarray, " k"], per_ray_w: float
) -> Float[np.ndarray, " g"]:
    """Squared deviation of ``flux`` from ``expected`` over its variance, for groups of neighbouring patches.

    Each group is expected to receive ``_OF_GROUP`` rays; a last group of less than half as many is left out.
    """
    reached = np.cumsum(expected) / (_OF_GROUP * per_ray_w)
    groups = np.ceil(reached).astype(np.int64) - 1 if len(reached) else np.zeros(0, dtype=np.int64)
    wanted = np.bincount(groups, expected)
    square = (np.bincount(groups, flux) - wanted) ** 2
    full = np.flatnonzero(wanted > 0.5 * _OF_GROUP * per_ray_w)
    return np.asarray(square[full] / (wanted[full] * per_ray_w))
