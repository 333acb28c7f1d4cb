"""Views of the lens by eyes: pictures of its luminance, by the rays that leave it.

The picture is on a plane through the lens across the line of sight. A ray crosses it along d. Few rays just meet an
eye, so that each counts by a smooth kernel of its angle with the line e from there to the eye, whose integral over
directions is 1. With x = (1 - d e) / h, per sr,

    K = 3 / (2 pi h) (1 - x)^2    for x < 1,    h = 1 - cos(blur).

The mean of d e under the kernel is 1 - h / 4: over that, a luminance that is the same to all sides keeps its value.
"""

from dataclasses import dataclass, field, fields, replace
from math import asin, ceil, cos, pi, radians, sin, sqrt, tan

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.spatial import ConvexHull

from lensforge.errors import InputError
from lensforge.optics.arrays import Array, lengths, like, module_of, replaced, rows_of
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.scene.housing import Housing
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import Landings
from lensforge.scene.receiver_shapes import Plane
from lensforge.spec import Spec
from lensforge.spec.housing_sections import bodies_of
from lensforge.spec.light_limits import LuminanceLimit
from lensforge.surfaces.placed_bodies import reach_mm

_MINUTE_DEG = 1.0 / 60.0  # of arc
_ON_AXIS = 1e-9  # sine: eyes on the axis see x to the right, all others the axis upright
_FAR_MM = 1e7  # of an eye in a direction: lines from the lens to it are parallel within 1e-6 rad
_AROUND = 1.05  # of the picture over the space of the lens
_DEPTH = 0.5  # of the plane towards the eye, over the reach of that space: exits are about there
_PIXELS_OF_SPOT = 8  # across a spot
_MOST_PIXELS = 512  # along a side of the picture
_LEAST_OF_SPOT = 4  # pixels across a fine spot
_MOST_OF_ALL = 768  # pixels along a side of the picture in a search
_WIDENED = 2.0 / 3.0  # of the square of a pixel, by which the square of a spot's radius is less
_FINER = 8  # sub-pixels along a side, by which pixels are shared with the disc of a spot
# A step of a search has few rays: a spot is at least this part of the picture's width, the kernel at least so wide.
_SEARCHED_SPOT = 1.0 / 16.0
_SEARCHED_BLUR_DEG = 5.0


@dataclass(frozen=True)
class EyeView(Plane):
    """The plane of the pose through the lens, as an eye on its z axis sees it from ``distance_mm``: x is to the right.

    Flux lands times the kernel that ends at ``blur_rad``: over the area of a pixel it is radiance, W/(m² sr).
    ``spot_mm``: diameter of a spot on the plane. ``wide_rad``: half angle at which the eye sees the lens. ``label``: of
    the limit; ``of_mean``: it bounds the mean, for which the picture is divided by the area (mm²) of the outline.
    """

    distance_mm: float = field(kw_only=True)
    wide_rad: float = field(kw_only=True)
    spot_mm: float = field(kw_only=True)
    blur_rad: float = field(kw_only=True)
    label: str = field(kw_only=True)
    of_mean: bool = field(kw_only=True)

    def _land(self, rays: ExitRays) -> Landings:
        return self._land_by_arrays(rays)

    def _reach_mm(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], landings: Landings
    ) -> Float[np.ndarray, " n"]:
        """Path (mm) of each ray until it passes the eye."""
        eye = self.pose.points(np.array([0.0, 0.0, self.distance_mm]))
        return np.asarray(((eye - points) * directions).sum(axis=1))

    def _land_by_arrays(self, rays: ExitRays) -> Landings:
        """Land ``rays``, with their flux times the kernel; NumPy or torch."""
        rows = self._near(rays)
        points = self.pose.to_local_points(rays.points[rows])
        directions = self.pose.to_local_directions(rays.directions[rows])
        on_chart = self._chart(points, directions)
        hits = replaced(module_of(on_chart).zeros_like(rays.points[:, :2]), rows, on_chart)
        lines, _, rest, scale = self._terms(on_chart, directions)
        flux = rays.flux[rows] * scale * rest**2 / lines[:, 2]  # per area that the eye sees of the plane
        flux = replaced(module_of(flux).zeros_like(rays.flux), rows, flux)
        return Landings(hits, flux, rays.left_lens, rays.left_lens & False)  # with or without flux all that left

    def passed(self, rays: ExitRays) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Places of ``rays`` on the plane, and what their directions have across the lines from there to the eye."""
        points = self.pose.to_local_points(rays.points)
        directions = self.pose.to_local_directions(rays.directions)
        left = rays.left_lens
        places = np.zeros((len(left), 2))
        beside = np.zeros((len(left), 2))
        places[left] = self._chart(points[left], directions[left])
        lines, *_ = self._terms(places[left], directions[left])
        beside[left] = (directions[left] - lines)[:, :2]
        return places, beside

    def _near(self, rays: ExitRays) -> Int[Array, " k"]:
        """Numbers of the few rays that the kernel may count."""
        least = cos(self.blur_rad + self.wide_rad)
        return rows_of(rays.left_lens & (rays.directions @ like(rays.directions, self.pose.axis) > least))

    @property
    def _width(self) -> float:
        """Width h of the kernel: 1 less the cosine at which it ends."""
        return 2.0 * sin(0.5 * self.blur_rad) ** 2

    def _terms(
        self, hits: Float[Array, "n 2"], directions: Float[Array, "n 3"]
    ) -> tuple[Float[Array, "n 3"], Float[Array, " n"], Float[Array, " n"], float]:
        """Lines e to the eye from places of the plane, their lengths (mm), 1 - x, or 0, and the kernel's factor."""
        xp = module_of(hits)
        away = xp.stack([-hits[:, 0], -hits[:, 1], self.distance_mm + 0.0 * hits[:, 0]], 1)
        distances = lengths(away)
        lines = away / distances[:, None]
        rest = 1.0 - 0.5 * ((lines - directions) ** 2).sum(1) / self._width
        scale = 1.5 / (pi * self._width * (1.0 - 0.25 * self._width))
        return lines, distances, xp.where(rest > 0.0, rest, 0.0), scale

    def _adjoint(
        self, rays: ExitRays, by_hits: Float[np.ndarray, "n 2"], by_flux: Float[np.ndarray, " n"]
    ) -> tuple[Sensitivities, Float[np.ndarray, " n"]]:
        """Sensitivities to exit rays and to their flux from those to their hits and to the flux that lands."""
        rows = self._near(rays)
        directions = self.pose.to_local_directions(rays.directions[rows])
        hits = self._chart(self.pose.to_local_points(rays.points[rows]), directions)
        lines, distances, rest, scale = self._terms(hits, directions)
        towards = (2.0 * scale * rest / (lines[:, 2] * self._width))[:, None]  # of the kernel, by d along e
        by_lines = towards * directions - (scale * (rest / lines[:, 2]) ** 2)[:, None] * np.array([0.0, 0.0, 1.0])
        by_lines -= (by_lines * lines).sum(axis=1)[:, None] * lines  # a unit vector turns
        carried = (by_flux * rays.flux)[rows, None]
        moved = by_hits.copy()
        moved[rows] -= carried * by_lines[:, :2] / distances[:, None]
        by = self.sensitivities(rays, moved)
        of_flux = np.zeros_like(by_flux)
        by.by_directions[rows] += self.pose.directions(carried * towards * lines)
        of_flux[rows] = by_flux[rows] * scale * rest**2 / lines[:, 2]
        return by, of_flux

    def outline(self, rays: ExitRays) -> Float[np.ndarray, "k 2"]:
        """Corners (mm), as the eye sees them, of the convex outline of all places that light leaves to any side."""
        points = self.pose.to_local_points(rays.points[rays.left_lens & (rays.flux > 0.0)])
        seen = points[:, :2] / (1.0 - points[:, 2:] / self.distance_mm)
        return np.asarray(seen[ConvexHull(seen).vertices]) if len(seen) > 2 else np.zeros((0, 2))

    def averaged_over_mm2(self, rays: ExitRays) -> float:
        """Area of the outline where the limit is on the mean."""
        return self.outline_mm2(rays) if self.of_mean else 1.0

    def outline_mm2(self, rays: ExitRays) -> float:
        """Area of the outline; infinite where no light leaves, so that its mean is 0."""
        corners = self.outline(rays)
        return float(ConvexHull(corners).volume) if len(corners) else np.inf  # in two dimensions the area

    @property
    def members(self) -> tuple["EyeView", ...]:
        """Views of single eyes, whose pictures are one above another."""
        return (self,)

    def raised(self, number: int) -> float:
        """Height (mm) of the picture of member ``number`` above the middle of all."""
        return (number - 0.5 * (len(self.members) - 1)) * self.members[0].grid.height

    def coarser_spots(self) -> sparse.csr_array:
        """Matrix from pixels to :meth:`spots` by half as many pixels along a side, an even number."""
        rows, columns = (
            sparse.kron(sparse.eye_array(count // 2), np.full((1, 2), 1.0), format="csr") for count in self.grid.shape
        )
        coarse = replace(self, grid=self.grid.halved())
        return sparse.csr_array(0.25 * coarse.spots() @ sparse.kron(rows, columns, format="csr"))

    def spots(self) -> sparse.csr_array:
        """Matrix from pixels to the means over a spot about the centre of each.

        Light is even over a pixel, and a pixel counts by its share in the disc: that widens the spot by 1/6 of a
        pixel's square in variance along a line, of which that of a disc has a quarter of its radius's.
        """
        pixel = self.grid.pixel[0]
        radius = sqrt(max(0.25 * self.spot_mm**2 - _WIDENED * pixel**2, 0.25 * pixel**2))
        reach = ceil(radius / pixel + 0.5)
        fine = (np.arange((2 * reach + 1) * _FINER) + 0.5) / _FINER - reach - 0.5  # in pixels
        disc = np.hypot(fine, fine[:, None]) * pixel <= radius
        shares = disc.reshape(2 * reach + 1, _FINER, 2 * reach + 1, _FINER).sum(axis=(1, 3)) / disc.sum()
        return _sums_about(self.grid.shape, shares)


@dataclass(frozen=True)
class RingView(EyeView):
    """Views of several ``eyes`` far away, whose pictures are one above another; no ray counts for two of them."""

    eyes: tuple[EyeView, ...] = field(kw_only=True)

    @staticmethod
    def of(eyes: tuple[EyeView, ...], label: str) -> "RingView":
        """The views of ``eyes``, of the same size and number of pixels."""
        first = eyes[0]
        count = len(eyes)
        grid = replace(first.grid, height=count * first.grid.height, rows=count * first.grid.rows)
        values = {field.name: getattr(first, field.name) for field in fields(first)}
        return RingView(**{**values, "grid": grid, "label": label, "eyes": eyes})

    @property
    def members(self) -> tuple[EyeView, ...]:
        """Its eyes."""
        return self.eyes

    def _land_by_arrays(self, rays: ExitRays) -> Landings:
        """Land ``rays``, each on the picture of the eye that it comes near; NumPy or torch."""
        first, *further = (self._landed(number, rays) for number in range(len(self.eyes)))
        hits = first.hits
        flux = first.flux
        for landed in further:
            hits = module_of(flux).where((landed.flux > 0.0)[:, None], landed.hits, hits)
            flux = flux + landed.flux
        return replace(first, hits=hits, flux=flux)

    def _landed(self, number: int, rays: ExitRays) -> Landings:
        """Landings on the picture of one eye; beyond it is that of another."""
        landed = self.eyes[number]._land_by_arrays(rays)
        across = landed.hits[:, 0]
        up = landed.hits[:, 1]
        within = abs(up) <= 0.5 * self.eyes[number].grid.height
        hits = module_of(up).stack([across, up + self.raised(number)], 1)
        return replace(landed, hits=hits, flux=landed.flux * within)

    def _adjoint(
        self, rays: ExitRays, by_hits: Float[np.ndarray, "n 2"], by_flux: Float[np.ndarray, " n"]
    ) -> tuple[Sensitivities, Float[np.ndarray, " n"]]:
        """Sensitivities to exit rays and to their flux, each by the eye that it comes near."""
        points = np.zeros_like(rays.points)
        directions = np.zeros_like(rays.directions)
        of_flux = np.zeros_like(by_flux)
        for number, eye in enumerate(self.eyes):
            near = self._landed(number, rays).arrived
            by, by_flux_of_eye = eye._adjoint(rays, by_hits * near[:, None], by_flux * near)
            points += by.by_points
            directions += by.by_directions
            of_flux += by_flux_of_eye
        return Sensitivities(points, directions), of_flux

    def spots(self) -> sparse.csr_array:
        """Matrix from pixels to the means over spots, none of which reaches into the picture of another eye."""
        return sparse.csr_array(sparse.kron(sparse.eye_array(len(self.eyes)), self.eyes[0].spots(), format="csr"))

    def coarser_spots(self) -> sparse.csr_array:
        """The same by half as many pixels along a side."""
        blocks = sparse.eye_array(len(self.eyes))
        return sparse.csr_array(sparse.kron(blocks, self.eyes[0].coarser_spots(), format="csr"))


def _sums_about(shape: tuple[int, int], shares: Float[np.ndarray, "m m"]) -> sparse.csr_array:
    """Matrix from pixels to the sum of those about each, by their ``shares``; none lies beyond the picture."""
    numbers = np.arange(shape[0] * shape[1]).reshape(shape)
    reach = len(shares) // 2
    around = np.pad(numbers, reach, constant_values=-1)
    rows = []
    columns = []
    values = []
    for (down, across), share in np.ndenumerate(shares):
        neighbours = around[down : down + shape[0], across : across + shape[1]].ravel()
        inside = np.flatnonzero(neighbours >= 0) if share else np.zeros(0, dtype=int)
        rows.append(inside)
        columns.append(neighbours[inside])
        values.append(np.full(len(inside), share))
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array(entries, shape=(numbers.size, numbers.size))


def eye_views(spec: Spec, *, searched: bool = False) -> tuple[EyeView, ...]:
    """Views by all eyes of the luminance limits of ``spec``, in their order, of the lens of its first lamp.

    ``searched``: as coarse as the few rays of a step need it. Raises :class:`InputError` for an eye within the space of
    the lens, and for spots too fine for a picture of it.
    """
    limits = [(number, limit) for number, limit in enumerate(spec.limits) if isinstance(limit, LuminanceLimit)]
    if not limits:
        return ()
    reach = max(spec.lens.extent_mm(spec.constraints), reach_mm(spec.media.bodies))
    lamp = spec.all_lamps.lamps[0].pose
    housing = Housing.of(bodies_of(spec.scene, from_afar=True))
    black = housing and housing.black  # the eye looks at the lens alone
    housing = black and black.seen_from(lamp)
    views: list[EyeView] = []
    for number, limit in limits:
        labelled = zip(limit.eye_labels(number), limit.eyes(), strict=True)
        eyes = tuple(
            _view(limit, label, lamp.to_local_points(_place(eye)), reach, searched) for label, (_, eye) in labelled
        )
        views += eyes if limit.from_deg is None else [RingView.of(eyes, *limit.labels(number))]
    return tuple(replace(view, housing=housing) for view in views)


def _place(eye: tuple[float, ...]) -> Float[np.ndarray, "3"]:
    """Place (mm) of an eye, or of one so far away in a direction (degrees along x and y)."""
    if len(eye) > 2:
        return np.array(eye)
    x, y = np.radians(eye)
    gamma = np.hypot(x, y)
    return _FAR_MM * np.array([np.sinc(gamma / pi) * x, np.sinc(gamma / pi) * y, np.cos(gamma)])


def _view(limit: LuminanceLimit, label: str, eye: Float[np.ndarray, "3"], reach: float, searched: bool) -> EyeView:
    away = float(np.linalg.norm(eye))
    if away <= _AROUND * reach:
        raise InputError(f"{label}: it lies in the lens's space, to {_AROUND * reach:.4g} mm; move it farther away")
    distance = away - _DEPTH * reach
    wide = asin(_AROUND * reach / away)
    side = 2.0 * distance * tan(wide)
    spot = limit.spot_mm or 2.0 * distance * tan(0.5 * radians(limit.spot_deg or _MINUTE_DEG))
    blur = limit.blur_deg
    if searched:
        spot = max(spot, _SEARCHED_SPOT * side)
        blur = max(blur, _SEARCHED_BLUR_DEG)
    pixels = ceil(_LEAST_OF_SPOT * side / spot)
    if pixels > _MOST_OF_ALL:
        least = _LEAST_OF_SPOT * side / _MOST_OF_ALL
        raise InputError(
            f"{label}: a spot of {spot:.2g} mm is too fine for a picture of {side:.3g} mm; give spot_mm = {least:.2g} "
            "or more, or move the eye farther away"
        )
    if not searched:
        pixels = 2 * ceil(0.5 * max(pixels, min(_PIXELS_OF_SPOT * side / spot, _MOST_PIXELS)))
    z = eye / away
    x = np.cross([0.0, 0.0, 1.0], z) if np.hypot(*z[:2]) > _ON_AXIS else np.array([1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return EyeView(
        Pose.of_axes(np.stack([x, np.cross(z, x), z]), _DEPTH * reach * z),
        PixelGrid.square(side, pixels),
        distance_mm=distance,
        wide_rad=wide,
        spot_mm=min(spot, side),
        blur_rad=radians(blur),
        label=label,
        of_mean=limit.of == "mean",
    )
