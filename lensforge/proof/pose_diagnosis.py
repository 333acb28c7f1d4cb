"""Recognition of a part that is the lens in another unit, place, or sense, or as its mirror image.

Candidates follow from the boxes: the unit from the ratio of their sides, the turn or mirror from which sides fit, the
shift from their centres. Whether one is right the light decides: rays that are moved as the part was, cast through it,
and moved back land where the design's do.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from lensforge.optics.media import Media
from lensforge.proof.facet_casting import Grid, Leg
from lensforge.proof.part_comparison import Expected
from lensforge.proof.part_mesh import PartMesh
from lensforge.proof.refraction import RefractingFace, through_glass
from lensforge.proof.sequential_cast import cross
from lensforge.results import BodySize
from lensforge.sources.ray_bundle import RayBundle

Ends = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]  # exit points (mm) and directions, NaN where lost
# By rays and the faces by which they come in and out, whatever faces of the part they meet.
Cast = Callable[[Leg, RefractingFace, RefractingFace], Ends]

RAYS = 128
_SAME_RATIO = 5e-3  # of the sides of two boxes: those of coarse facets are shorter by less
_LANDED = 0.8  # of the rays, at least, for a candidate that counts
_FITS = 0.2  # a candidate's distance, of that of the part as it lies, at most; wrong ones are as far off as that
_FITS_RAD = 2e-3  # and as far as so much turns the light at the lens: what is recognised need not be exact
_STEP_DEG = 10.0  # between the turns about z that are tried where the outline is round
_UNITS = {
    1.0 / 25.4: "the file is in inches",
    25.4: "the file is 25.4 times too large, as if its mm were inches",
    0.1: "the file is in cm",
    10.0: "the file is ten times too large, as if its mm were cm",
    0.001: "the file is in metres",
    1000.0: "the file is a thousand times too large, as if its mm were metres",
}
_NEAR_UNIT, _NEAR_ONE = 2e-3, 1e-4  # relative: of the ratio of boxes, whose facets may differ
_LEAST_SHIFT_MM = 5e-3
INWARDS = "its facets face inwards (the volume is negative): flip their normals, and write the file again"


@dataclass(frozen=True)
class Motion:
    """The change ``scale * turn @ x + shift_mm`` from the lens to the part; ``turn``: orthogonal, may mirror."""

    scale: float
    turn: Float[np.ndarray, "3 3"]
    shift_mm: Float[np.ndarray, " 3"]

    def apply(self, rays: RayBundle) -> Leg:
        """Rays moved as the part was."""
        origins = self.scale * rays.origins @ self.turn.T + self.shift_mm
        return Leg(origins, rays.directions @ self.turn.T, np.zeros(len(rays)))

    def undo(self, ends: Ends) -> Ends:
        """Exit rays moved back."""
        return (ends[0] - self.shift_mm) @ self.turn / self.scale, ends[1] @ self.turn

    @property
    def words(self) -> str:
        """The change in words, and what to do about it."""
        found = [*self._scaled(), *self._turned(), *self._shifted()]
        if len(found) == 1 and found[0] in _UNITS.values():
            return f"{found[0]}: lensforge reads mm, so write it in mm"
        return f"it is the lens, but {' and '.join(found)}: write it again as it was exported, in mm"

    def _scaled(self) -> Iterator[str]:
        if self.scale in _UNITS:
            yield _UNITS[self.scale]
        elif self.scale != 1.0:
            yield f"scaled by {self.scale:.5g}"

    def _turned(self) -> Iterator[str]:
        proper = np.linalg.det(self.turn) > 0.0
        mirrored = next((k for k in range(3) if np.allclose(self.turn, np.diag(1.0 - 2.0 * np.eye(3)[k]))), None)
        if mirrored is not None:
            yield f"mirrored: {'xyz'[mirrored]} is -{'xyz'[mirrored]}"
            return
        if not proper:
            yield "mirrored: x is -x"
        vector = Rotation.from_matrix(self.turn if proper else self.turn @ np.diag([-1.0, 1.0, 1.0])).as_rotvec()
        angle = float(np.linalg.norm(vector))
        if angle > 1e-6:
            axis = ", ".join(f"{value:.3g}" for value in vector / angle + 0.0)
            yield f"turned by {np.degrees(angle):.4g} degrees about ({axis})"

    def _shifted(self) -> Iterator[str]:
        if self.shift_mm.any():
            yield f"shifted by ({', '.join(f'{value:.4g}' for value in self.shift_mm)}) mm"


def through_mesh(part: PartMesh, grid: Grid) -> Cast:
    """Rays through a mesh, refracted at the first two facets that they meet, whatever these are."""

    def cast(leg: Leg, into: RefractingFace, out_of: RefractingFace) -> Ends:
        points, directions = np.full((2, len(leg.origins), 3), np.nan)
        entry = grid.first_hits(leg)
        rows = np.nonzero(entry.found)[0]
        entered = cross(part, leg.take(rows), entry.take(rows), into.take(rows))
        exits = grid.first_hits(entered.leg)
        met = np.nonzero(exits.found)[0]
        left = cross(part, entered.leg.take(met), exits.take(met), out_of.take(rows[met]))
        passes = left.transmittance > 0.0
        points[rows[met[passes]]] = left.leg.origins[passes]
        directions[rows[met[passes]]] = left.leg.directions[passes]
        return points, directions

    return cast


_AS_IT_LIES = Motion(1.0, np.eye(3), np.zeros(3))


def recognised(
    cast: Cast, found: BodySize, exported: BodySize | None, rays: RayBundle, media: Media, expected: Expected
) -> str:
    """Words on a part that is the lens elsewhere, larger, turned, mirrored or inside out; empty where it is not.

    ``cast`` sends rays through the part. ``expected``: the design's results for all of ``rays``.
    """
    rows = np.nonzero(expected.screen.on_pixels(expected.landings))[0]
    rows = np.sort(np.random.default_rng(0).permutation(rows)[:RAYS])
    if len(rows) == 0:
        return ""
    some, landings = rays.take(rows), expected.take(rows)
    faces = RefractingFace.inner(some, media), RefractingFace.outer(some, media)

    def distance(motion: Motion) -> float:
        """Median distance (mm) between landings, after ``motion`` is undone; infinite where too many rays are lost."""
        points, directions, _ = through_glass(*motion.undo(cast(motion.apply(some), *faces)), media)
        screen = landings.screen
        gaps = screen.mm_per_unit * np.linalg.norm(screen.land(points, directions) - landings.landings, axis=1)
        seen = gaps[np.isfinite(gaps)]
        return float(np.median(seen)) if len(seen) >= _LANDED * len(gaps) else np.inf

    before, fits_mm = distance(_AS_IT_LIES), _FITS_RAD * landings.screen.reach_mm(landings.irradiance)
    most = min(_FITS * before, fits_mm)
    if found.volume_mm3 < 0.0 and before <= fits_mm:
        return INWARDS
    best = _best(distance, found, exported, most) if exported is not None else None
    words = "" if best is None else best.words
    inwards = found.volume_mm3 < 0.0 and best is not None and np.linalg.det(best.turn) > 0.0
    return f"{words}; {INWARDS}" if inwards else words


def _best(distance: Callable[[Motion], float], found: BodySize, exported: BodySize, most: float) -> Motion | None:
    """The simplest of the motions that land rays nearly as near as the best does; None where none is nearer than
    ``most``.
    """
    tried = [(distance(motion), motion) for motion in candidates(found, exported)]
    nearest, motion = min(tried, key=lambda each: each[0], default=(np.inf, _AS_IT_LIES))
    if nearest > most and _is_round(exported):
        nearest, motion = _turned_about_z(distance)
        tried = [(nearest, motion)]
    if nearest > most:
        return None
    return next(each for gap, each in tried if gap <= min(most, 3.0 * nearest + 1e-3))


def candidates(found: BodySize, exported: BodySize) -> list[Motion]:
    """Motions that take the box as exported to the one found, the simplest first."""
    motions = []
    (low, high), (least, most) = np.array(found.bounds_mm), np.array(exported.bounds_mm)
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.diag(signs) @ np.eye(3)[list(order)]
        ratios = (high - low) / np.maximum(np.abs(turn) @ (most - least), np.finfo(float).tiny)
        scale = float(ratios.mean())
        if not scale > 0.0 or np.ptp(ratios) > _SAME_RATIO * scale:
            continue
        unit = next((each for each in (1.0, *_UNITS) if abs(scale / each - 1.0) < _limit(each)), scale)
        shift = 0.5 * (low + high) - unit * turn @ (0.5 * (least + most))
        shift = np.where(np.abs(shift) < _LEAST_SHIFT_MM * unit, 0.0, shift)
        motions.append(Motion(unit, turn, shift))
    return sorted(motions, key=lambda each: (np.linalg.det(each.turn) < 0.0, -np.trace(each.turn)))


def _limit(unit: float) -> float:
    return _NEAR_ONE if unit == 1.0 else _NEAR_UNIT


def _is_round(size: BodySize) -> bool:
    """True where the box is square across z: the outline may be a circle."""
    (x0, y0, _), (x1, y1, _) = size.bounds_mm
    return abs((x1 - x0) / max(y1 - y0, np.finfo(float).tiny) - 1.0) < _SAME_RATIO


def _turned_about_z(distance: Callable[[Motion], float]) -> tuple[float, Motion]:
    """The best turn about z, by steps and then by halving them; its distance and itself."""

    def turned(degrees: float) -> Motion:
        return replace(_AS_IT_LIES, turn=Rotation.from_euler("z", degrees, degrees=True).as_matrix())

    gap, angle = min((distance(turned(each)), each) for each in np.arange(_STEP_DEG, 360.0, _STEP_DEG).tolist())
    step = 0.5 * _STEP_DEG
    while step > 1e-3:
        gap, angle = min([(gap, angle), *((distance(turned(angle + by)), angle + by) for by in (-step, step))])
        step *= 0.5
    return gap, turned(angle)
