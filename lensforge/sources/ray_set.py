"""Ray set of files or of another program as a source: placed in lens coordinates, drawn by seed, with its outline.

The outline goes around the points of a plane from which nearly all of the light seems to come.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, UInt64

from lensforge.errors import InputError
from lensforge.optics.pose import IN_PLACE, Pose
from lensforge.sources.emitting_area import convex_hull, hull_points
from lensforge.sources.ray_bundle import RayBundle, Rays, blocks_of, chosen, number_type, with_flux
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.source_sections import Placement

_SHARE = 0.95  # of the flux inside the outline; the rest starts far out, such as at the edge of a window
_DIGIT = 20  # bits of a value by which more are divided
_Crossings = tuple[Float[np.ndarray, "_ 2"], Float[np.ndarray, " _"]]  # points (mm) of the plane, and the flux there
_Values = tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]  # values, and the flux at each


def outline_of(rays: Rays, pose: Pose) -> Float[np.ndarray, "k 3"]:
    """Convex hull (mm) of the points where 95 % of the forward flux crosses, or seems to cross, a plane.

    It is the plane z = 0 of the source before ``pose`` turned, tilted and shifted it to its place. All rays count;
    those that are not in memory are read block by block, several times.
    """

    def blocks() -> Iterator[RayBundle]:
        return (block.seen_from(pose) for block in blocks_of(rays))

    forward = any(bool((block.directions[:, 2] > 0.0).any()) for block in blocks())
    corners = _around(lambda: (_crossings(block, forward) for block in blocks()))
    return pose.points(np.column_stack([corners, np.zeros(len(corners))]))


def _crossings(rays: RayBundle, forward: bool) -> _Crossings:
    """Points (mm) where rays that go ``forward``, or the others, meet the plane z = 0, extended as lines.

    Rays along that plane stay where they start.
    """
    start = rays.origins
    direction = rays.directions
    selected = (direction[:, 2] > 0.0) == forward
    level = np.abs(direction[:, 2]) < 1e-9
    length = np.where(level, 0.0, -start[:, 2] / np.where(level, 1.0, direction[:, 2]))
    points = start[:, :2] + length[:, None] * direction[:, :2]
    return points[selected], rays.flux[selected]


def _around(crossings: Callable[[], Iterable[_Crossings]]) -> Float[np.ndarray, "k 2"]:
    """Corners around all but outliers; a few rays far out do not move the median that defines these.

    ``crossings`` begins a pass through the points.
    """
    sums = [(len(flux), float(flux.sum())) for _, flux in crossings()]
    count = sum(rays for rays, _ in sums)
    total = sum(flux for _, flux in sums)
    x = _value_at(0.5 * total, count, lambda: ((points[:, 0], flux) for points, flux in crossings()))
    y = _value_at(0.5 * total, count, lambda: ((points[:, 1], flux) for points, flux in crossings()))

    def distance(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        return np.sqrt((points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2)

    radius = _value_at(_SHARE * total, count, lambda: ((distance(points), flux) for points, flux in crossings()))
    outermost = np.zeros((0, 2))
    for points, _ in crossings():
        outermost = hull_points(np.concatenate([outermost, points[distance(points) <= radius]]))
    return convex_hull(outermost)


def _value_at(wanted: float, count: int, blocks: Callable[[], Iterable[_Values]], sorted_at_once: int = 2**20) -> float:
    """The value below which lies the flux ``wanted``: exact, in constant memory.

    ``blocks`` begins a pass through the ``count`` values. If they are too many to sort, each pass finds further leading
    bits of the value.
    """
    known = 0  # leading bits of the quantile
    bits = 0
    below = 0.0  # flux at values whose leading bits are smaller
    while count > sorted_at_once and bits + _DIGIT <= 64:
        counts = np.zeros(2**_DIGIT, dtype=np.int64)
        fluxes = np.zeros(2**_DIGIT)
        for values, flux in _beginning(blocks(), known, bits):
            digits = (_sortable(values) >> (64 - bits - _DIGIT)).astype(np.int64) & (2**_DIGIT - 1)
            counts += np.bincount(digits, minlength=2**_DIGIT)
            fluxes += np.bincount(digits, flux, minlength=2**_DIGIT)
        reached = below + np.cumsum(fluxes)
        digit = int(np.searchsorted(reached, wanted))
        count = int(counts[digit])
        below = float(reached[digit - 1]) if digit else below
        known = known << _DIGIT | digit
        bits = bits + _DIGIT
    values, flux = map(np.concatenate, zip(*_beginning(blocks(), known, bits), strict=True))
    order = np.argsort(values)
    place = np.searchsorted(below + np.cumsum(flux[order]), wanted)
    return float(values[order[min(int(place), len(order) - 1)]])


def _beginning(blocks: Iterable[_Values], known: int, bits: int) -> Iterator[_Values]:
    """The values whose first ``bits`` bits are ``known``, and the flux at each."""
    for values, flux in blocks:
        matching = _sortable(values) >> (64 - bits) == known
        yield values[matching], flux[matching]


def _sortable(values: Float[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """Integers in the order of the values, beginning with sign, exponent and leading digits."""
    bits = np.ascontiguousarray(values).view(np.uint64)
    return np.where(values < 0.0, ~bits, bits | np.uint64(2**63))


# Proper rotations that take the named direction of the file to +z.
_TO_LENS_AXIS = {
    "+x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    "-x": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)),
    "+y": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "-y": ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "+z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "-z": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
}
_MIRROR = {"none": (1.0, 1.0, 1.0), "x": (-1.0, 1.0, 1.0), "y": (1.0, -1.0, 1.0)}


def placed(rays: RayBundle, origin_mm: Float[np.ndarray, " 3"], placement: Placement) -> RayBundle:
    """Transform ``rays`` of a file to lens coordinates; ``origin_mm``, a point of the file, becomes the lens origin."""
    matrix = np.diag(_MIRROR[placement.mirror]) @ _TO_LENS_AXIS[placement.axis]
    origins = _turned(placement.scale * (rays.origins - origin_mm), matrix)
    moved = replace(rays, origins=origins, directions=_turned(rays.directions, matrix))
    return moved.placed(placement.pose)


def _turned(vectors: Float[np.ndarray, "n 3"], matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3"]:
    """Products with ``matrix``; the identity, as in most files, costs no time."""
    if np.array_equal(matrix, np.eye(3)):
        return vectors + 0.0  # no -0, as in a product
    return np.asarray(vectors @ matrix.T)


@dataclass(frozen=True, eq=False)
class RaySetEmitter:
    """Usable rays of a ray set in lens coordinates; their flux adds up to ``flux_w``.

    Rays that go backwards, or start below z = 0 or beyond the cavity, are kept: the tracer counts them as lost, by
    cause. Only unusable rays are dropped; ``summary`` holds their number, and what else was done to a file: None for
    rays made by a program. ``pose``: of the source in the lens; the outline is drawn there.
    ``rays`` of a large file are not in memory: those of a sample are read when it is drawn.
    """

    rays: Rays
    flux_w: float
    summary: SourceSummary | None = None
    symmetry: str = "none"
    pose: Pose = IN_PLACE

    def __len__(self) -> int:
        return len(self.rays)

    @property
    def ray_count(self) -> int:
        """Number of distinct rays: drawing more adds no information."""
        return len(self)

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays whose flux adds up to ``flux_w``; the same seed gives the same rays.

        Fewer than the file holds: a random choice without replacement, because files are not always shuffled. As many:
        all, in the order of the file. More: every ray is split into equal parts, some into one part more than others;
        so a result, and its noise, are exactly those of the whole file. Jitter would only hide that, and blur the
        source.
        """
        if count < 1:
            raise InputError(f"{count} rays: at least 1")
        copies, remainder = divmod(count, len(self))
        if copies == 0:
            return self._of_flux(self.rays.take(self._some(remainder, seed)))
        times = np.full(len(self), copies)
        times[self._some(remainder, seed)] += 1
        index = np.repeat(np.arange(len(self)), times)
        drawn = self.rays.take(index)
        return self._of_flux(replace(drawn, flux=drawn.flux / times[index]))

    def drawn(self, count: int, seed: int) -> Rays:
        """The rays of ``sample(count, seed)``, at most all of them; those of a large file are read when taken."""
        if isinstance(self.rays, RayBundle) or not 1 <= count < len(self):
            return with_flux(self.rays, self.flux_w) if count == len(self) else self.sample(count, seed)
        return with_flux(chosen(self.rays, self._some(count, seed)), self.flux_w)

    def _some(self, count: int, seed: int) -> Int[np.ndarray, " k"]:
        """Numbers of ``count`` different rays, chosen at random, in the order of the file."""
        return np.sort(np.random.default_rng(seed).choice(len(self), count, replace=False))

    def _of_flux(self, rays: RayBundle) -> RayBundle:
        return replace(rays, flux=rays.flux * (self.flux_w / rays.flux.sum()))

    def split(self, fraction: float, seed: int) -> tuple["RaySetEmitter", "RaySetEmitter"]:
        """Divide the rays between two emitters of the same flux: ``fraction`` to design with, the rest to evaluate.

        A lens that was fitted to the noise of its own rays shows it on the others.
        """
        training = round(fraction * len(self))
        if not 0 < training < len(self):
            raise InputError(f"fraction = {fraction} of {len(self)} rays leaves one part empty: try 0.8")
        order = np.random.default_rng(seed).permutation(len(self)).astype(number_type(len(self)))
        return self._only(np.sort(order[:training])), self._only(np.sort(order[training:]))

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Corners (mm) as of :func:`outline_of`."""
        return self._outline

    @cached_property
    def _outline(self) -> Float[np.ndarray, "k 3"]:
        return outline_of(self.rays, self.pose)

    def _only(self, numbers: Int[np.ndarray, " k"]) -> "RaySetEmitter":
        return replace(self, rays=with_flux(chosen(self.rays, numbers), self.flux_w))
