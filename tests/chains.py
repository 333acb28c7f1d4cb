"""Bodies of more than two faces for tests, and derivatives of their light along a direction."""

from dataclasses import dataclass

import numpy as np

from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE, SHELL, FaceRole
from lensforge.optics.media import FaceCoating, Media, Medium, Mirror
from lensforge.scene.body import Body, Face
from lensforge.scene.exit_rays import Sensitivities
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace

REACH = 14.0


def collimator(tilt: float = 0.0, draft: float = 0.02, eccentricity: float = 0.8) -> Body:
    """A body of four faces for total internal reflection, 8 mm high; its exit is tilted along x."""
    return Body(
        (
            Face("cap", sphere(4.0), CAVITY, BODY),
            Face("side", ConeFace(REACH, 3.2, draft), CAVITY, BODY),
            Face("wall", ConicFace(REACH, 5.0, eccentricity, (0.5 * tilt, 0.2 * tilt, 1.0)), BODY, OUTSIDE),
            Face("exit", PlaneFace(REACH, 8.0, (tilt, 0.3 * tilt, 1.0)), BODY, OUTSIDE),
        )
    )


def reflector(parameter_mm: float, eccentricity: float, height_mm: float) -> Body:
    """A mirror about the source, and its opening."""
    mirror = ConicFace(REACH, parameter_mm, eccentricity)
    return Body((Face("mirror", mirror, CAVITY, BODY), Face("opening", PlaneFace(REACH, height_mm), CAVITY, OUTSIDE)))


def mirrors(reflectance: float, **around: str) -> tuple[FaceCoating, ...]:
    """Mirrors on some faces, each by what lies around the body there."""
    return tuple(FaceCoating(name, medium, Mirror(reflectance)) for name, medium in around.items())


def tables_of(body: Body, grid: TableGrid) -> np.ndarray:
    """Tables of all faces."""
    return np.stack([tabulate(grid, face.surface) for face in body.faces])


def upwards(count: int, seed: int, half_mm: float = 0.0) -> RayBundle:
    """Rays all over the hemisphere, from a square about a shifted centre where ``half_mm`` is above 0."""
    rng = np.random.default_rng(seed)
    along = rng.normal(size=(count, 3))
    along[:, 2] = np.abs(along[:, 2])
    along /= np.linalg.norm(along, axis=1)[:, None]
    origins = half_mm * (rng.uniform(-1.0, 1.0, (count, 3)) * [1.0, 1.0, 0.0] + [0.2, 0.1, 0.0])
    return RayBundle(origins, along, rng.uniform(0.5, 1.5, count))


@dataclass(frozen=True)
class Slope:
    """Derivative along a direction by differences, with its error, and by the adjoint; rays that change their way."""

    differences: float
    error: float
    adjoint: float
    crossed: int


class MixedLight:
    """A number in which the point, direction, flux and exit sine of every ray has a random say."""

    def __init__(self, tables: np.ndarray, scene: Scene, rays: RayBundle, seed: int) -> None:
        self.tables, self.scene, self.rays = tables, scene, rays
        self.base = TracedBundle.of(tables, scene, rays)
        exits, rng, count = self.base.exits, np.random.default_rng(seed), len(rays)
        self.by_directions, self.by_flux, self.by_sin2 = (rng.normal(size=s) for s in ((count, 3), count, count))
        across = rng.normal(size=(count, 3))
        self.by_points = across - (across * exits.directions).sum(1)[:, None] * exits.directions
        self.left, self.reflected = exits.fates == 0, exits.fates == 4

    def _value(self, traced: TracedBundle) -> np.ndarray:
        """Share of each ray; its point counts in the plane across the ray of the base."""
        start, way, exits = self.base.exits.points, self.base.exits.directions, traced.exits
        along = ((start - exits.points) * way).sum(1) / np.where(self.left, (exits.directions * way).sum(1), 1.0)
        points = exits.points + along[:, None] * exits.directions
        seen = (self.by_points * points).sum(1) + (self.by_directions * exits.directions).sum(1)
        value = self.left * (seen + self.by_flux * exits.flux)
        return value + (self.left | self.reflected) * self.by_sin2 * exits.sin2_exit

    def slope(self, direction: np.ndarray, step: float) -> Slope:
        """Along ``direction``, over the rays that meet the same faces on both sides."""
        slopes, same = [], np.ones(len(self.rays), dtype=bool)
        for size in (step, 2.0 * step):
            ends = [TracedBundle.of(self.tables + s * size * direction, self.scene, self.rays) for s in (1.0, -1.0)]
            for end in ends:
                same &= end.exits.fates == self.base.exits.fates
                if end.met is not None:  # of the usual lens nothing tells
                    same &= (end.met == self.base.met).all(axis=1)
            slopes.append((self._value(ends[0]) - self._value(ends[1])) / (2.0 * size))
        left, seen = self.left & same, (self.left | self.reflected) & same
        by = Sensitivities(self.by_points * left[:, None], self.by_directions * left[:, None])
        gradients = self.base.gradients(by, self.by_flux * left, self.by_sin2 * seen)
        error = np.abs(slopes[0] - slopes[1])[same].sum() + 1e-6 * np.abs(slopes[0])[same].sum()
        return Slope(
            float(slopes[0][same].sum()), float(error), float((gradients * direction).sum()), int((~same).sum())
        )


def clear(index: float = 1.49, coatings: tuple[FaceCoating, ...] = (), absorption: float = 0.0) -> Media:
    """A body of one index in air: of the usual lens, or of the faces that are coated."""
    roles = tuple(
        FaceRole(coating.face, *((CAVITY, BODY) if coating.around == CAVITY else (BODY, OUTSIDE)))
        for coating in coatings
    )
    return Media(Medium(index, absorption), coatings=coatings, faces=roles or SHELL)
