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

    ``designed``: irradiance (W/m²) of each patch by the design, by ``designed_rays``, whose noise counts.
    """

    name: str
    pieces: ObstacleBody
    patches: Int[np.ndarray, " t"]
    others: Sequence[ObstacleBody]
    designed: Float[np.ndarray, " p"]
    designed_rays: int

    def judge(self, rays: RayBundle, passage: Passage) -> BodyLightProof:
        """The light of ``rays``, by their ``passage`` through the part, against the design's."""
        flux, squares = self._on_patches(passage)
        areas_m2 = self._areas_m2
        emitted_w = float(rays.flux.sum())
        expected = self.designed * areas_m2
        dark = expected <= 0.0
        per_ray_w = float(squares.sum()) / (float(flux.sum()) or np.inf)  # the mean, weighted by flux
        apart = _apart(flux[~dark], expected[~dark], per_ray_w or float(rays.flux.mean()))
        apart /= 1.0 + len(rays) / self.designed_rays
        darkest = int(self.designed.argmin())
        whole_m2 = float(areas_m2.sum())
        error_w = np.sqrt(max(float(squares.sum()) - float(flux.sum()) ** 2 / len(rays), 0.0))
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

    def _on_patches(self, passage: Passage) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Flux (W) and sum of squared ray fluxes (W²) on each patch."""
        bodies = Obstacles.of([self.pieces, *self.others])
        assert bodies is not None
        left = passage.fates == CastFate.LANDED
        ways = passage.points[left], passage.directions[left]
        flux = passage.flux[left]
        first = bodies.met(*ways, np.full(len(flux), np.inf))
        met = first.triangles
        # A convex body, which alone may both reflect light and be measured, has no light of its own.
        turned = np.flatnonzero((met >= len(self.patches)) & (first.onward > 0.0))
        if len(turned):
            of_turned = first.take(turned)
            starts, going = (column[turned] for column in ways)
            onward = bodies.reflect(starts, going, of_turned, passage.draws[left][turned])
            met[turned] = bodies.met(*onward, np.full(len(turned), np.inf)).triangles
            flux[turned] *= of_turned.onward
        on_body = (met >= 0) & (met < len(self.patches))
        flux = flux[on_body]
        patches = self.patches[met[on_body]]
        size = len(self.designed)
        return np.bincount(patches, flux, size), np.bincount(patches, flux**2, size)


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
