"""Light that crosses a crease of the cavity as its faces move: the part of a derivative that the adjoint leaves out.

The adjoint keeps the faces that each ray meets. But where two faces of the cavity meet, a ray just beside their crease
takes one way, and a ray on its other side another. Where the crease moves by ``dc``, the flux that goes over from one
way to the other is, for light from a point at the distance d,

    I w . (c' x dc) / d^2 dphi,    n_a . dc = drho_a,    n_b . dc = drho_b,

I the intensity (W/sr) along the unit vector w, c' the derivative of the crease by the azimuth phi, and n the normals of
both faces, of such lengths that n . u = 1 along their radius u. As c' is along ``n_a x n_b``, ``c' x dc`` is in
proportion to ``n_b drho_a - n_a drho_b``: the faces need not meet at any least angle. The derivative of a merit is this
flux times what a further watt is worth on one way more than on the other (T.-M. Li et al., ACM Trans. Graph. 37, 222
(2018), for edges of triangles). Each way is that of a ray beside the crease.

Left out: creases that rays meet later, for which there is ``light.later_creases``; the edge of total reflection; the
rim; and rays that only just touch a face.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.bicubic import FaceBounds
from lensforge.kernels.image_sums import SAFE_SIN2, SIN2_SCALE, ByRaysAtReceiver, RaysAtReceiver, collect_adjoint
from lensforge.light.table_trace import Scene, Tables, TracedBundle
from lensforge.optics.face_roles import CAVITY
from lensforge.scene.receiver import PosedReceiver
from lensforge.seeds import sobol
from lensforge.sources.ray_bundle import RayBundle, Source, towards
from lensforge.surfaces.bicubic_table import TableGrid, cubic_basis, evaluate_table
from lensforge.surfaces.surface import gradient_on_sphere, to_chart, to_sphere

RayAdjoint = Callable[[TracedBundle], Float[np.ndarray, " n"]]
"""Derivative of a merit by the flux (W) with which each ray leaves the source; the rays have 1 W each."""
Trace = Callable[[RayBundle], TracedBundle]
"""Rays through the faces of one lens."""

_MERIDIANS = 256  # on which creases are sought
_PLACES = 256  # along a straight crease of faces that are drawn along y, even in the angle under which they are seen
_ACROSS = np.array([1.0, 0.0, 1.0])
_STEPS = 32  # of the chart's radius from the axis to the rim
_NEWTON_STEPS = 6  # from the middle of a step to rounding
BESIDE = 1e-6  # rad: rays on both sides pass the crease at this angle

_Vectors = Float[np.ndarray, "p 3"]
_Values = Float[np.ndarray, " p"]


def crease_gradients(
    tables: Tables,
    scene: Scene,
    source: Source,
    worth: RayAdjoint,
    count: int = 2**11,
    seed: int = 0,
    bounds: FaceBounds | None = None,
) -> Tables:
    """Gradients of a merit by all ``tables`` for light that crosses the creases of the cavity; 0 where it has none.

    ``count`` start points of ``source`` are drawn by ``seed``, each with a point of a crease and two rays. ``worth``
    says what light on each way adds to the merit: see :func:`adjoint_on`. ``bounds``: of the faces, if they are known.
    Of a lens as made the roughness is left out.
    Raises :class:`InputError` for a source that cannot say how much light goes into a direction, such as rays of a file
    that are not turned.
    """
    scene = without_roughness(scene)
    points = sobol(count, 5, seed)[:, 4]
    turn = np.random.default_rng(seed).random()
    creases = CreasePoints.of(tables, scene, turn)
    total: Tables = np.zeros(tables.shape)
    if not len(creases):
        return total
    numbers = (points * len(creases)).astype(int)
    crossing = creases.take(numbers)
    rays = towards(source, _seen_from_source(scene, crossing.one.points), seed)
    trace = partial(TracedBundle.of, tables, scene, bounds=bounds)
    change = rays.flux * _gain(trace, scene, rays, crossing, worth) * (len(creases) * creases.spacing_rad)
    for side, by_radius in zip((creases.one, creases.other), crossing.flows(in_lens(scene, rays)), strict=True):
        side.add(np.bincount(numbers, change * by_radius, len(creases)), total)
    return total


def without_roughness(scene: Scene) -> Scene:
    """The scene without roughness of the lens as made: its noise would differ between two close rays."""
    return scene if scene.made is None else replace(scene, made=replace(scene.made, slopes={}))


def in_lens(scene: Scene, rays: RayBundle) -> RayBundle:
    """Rays of the source in the frame of the faces, if these are displaced relative to it."""
    if scene.made is None:
        return rays
    placed = scene.made.placed
    origins = placed.into.points(rays.origins, placed.factor_in)
    return replace(rays, origins=origins, directions=placed.into.directions(rays.directions))


def _seen_from_source(scene: Scene, points: _Vectors) -> _Vectors:
    if scene.made is None:
        return points
    placed = scene.made.placed
    return placed.into.to_local_points(points) / placed.factor_in


def adjoint_on(
    receivers: Sequence[PosedReceiver],
    by_images: Sequence[Float[np.ndarray, "h w"]],
    by_sums: Sequence[Float[np.ndarray, "3"]],
) -> RayAdjoint:
    """Sensitivities to rays from the derivatives of the merit by the sums that a search collects on each receiver.

    ``by_images``: by the flux (W) of each pixel; ``by_sums``: by that in the window, by that off the receiver, and by
    that of total reflection, as :class:`~lensforge.search.light_path.Collected` has them.
    """

    def worth(traced: TracedBundle) -> Float[np.ndarray, " n"]:
        emitted = traced.rays.flux
        sin2_exit = traced.exits.sin2_exit
        total = np.zeros(len(emitted))
        for receiver, by_image, by_sum in zip(receivers, by_images, by_sums, strict=True):
            landed = receiver.land(traced.exits)
            grid = receiver.grid
            rays = RaysAtReceiver(landed.hits, landed.flux, sin2_exit, landed.landed, emitted)
            by_rays = ByRaysAtReceiver.empty(len(total))
            collect_adjoint(rays, grid.size, receiver.window.packed(), by_image, by_sum, by_rays)
            outside = np.maximum(np.abs(landed.hits) / (0.5 * np.array(grid.size)) - 1.0, 0.0)
            off = np.where(landed.landed, _bounded((outside**2).sum(axis=1)), 1.0)
            total += by_rays.by_flux * landed.flux + by_sum[1] * off
            total += by_sum[2] * _bounded(np.maximum(sin2_exit - SAFE_SIN2, 0.0) / SIN2_SCALE)
        return total

    return worth


def _bounded(excess: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return excess / (1.0 + excess)


@dataclass(frozen=True)
class OnFaces:
    """Points on faces by their tables: number of the ``face`` and chart point of each.

    ``radius`` (mm) and its ``slopes`` over the chart; ``corner``: row and column of the first of the 4 x 4 coefficients
    that act there, ``weights``: of each on the radius. ``along_mm``: y on faces that are drawn along y, which the chart
    has in their section.
    """

    face: Int[np.ndarray, " p"]
    chart: Float[np.ndarray, "p 2"]
    radius: _Values
    slopes: Float[np.ndarray, "p 2"]
    corner: Int[np.ndarray, "p 2"]
    weights: Float[np.ndarray, "p 4 4"]
    along_mm: _Values | None = None

    @staticmethod
    def at(tables: Tables, scene: Scene, face: Int[np.ndarray, " p"], points: _Vectors) -> "OnFaces":
        """The tables of these faces at points (mm)."""
        if scene.drawn_half_mm is None:
            return OnFaces.of(tables, scene.grid, face, to_chart(points))
        in_section = OnFaces.of(tables, scene.grid, face, to_chart(points * _ACROSS))
        return replace(in_section, along_mm=points[:, 1])

    @staticmethod
    def of(tables: Tables, grid: TableGrid, face: Int[np.ndarray, " p"], chart: Float[np.ndarray, "p 2"]) -> "OnFaces":
        """The tables of these faces at chart points."""
        position = (chart - grid.origin) / grid.step
        cell = np.clip(np.floor(position).astype(int), 1, grid.side - 3)
        (x, y), (dx, dy) = (
            [np.stack(cubic_basis(position[:, axis] - cell[:, axis], order), axis=1) for axis in (0, 1)]
            for order in (0, 1)
        )
        products = (x, y), (dx / grid.step, y), (x, dy / grid.step)
        weights, by_x, by_y = (x_weights[:, :, None] * y_weights[:, None, :] for x_weights, y_weights in products)
        near = tables[_places(face, cell - 1)]
        radius, *slopes = (np.sum(near * factors, axis=(1, 2)) for factors in (weights, by_x, by_y))
        return OnFaces(face, chart, radius, np.stack(slopes, axis=1), cell - 1, weights)

    @property
    def points(self) -> _Vectors:
        """The points in space (mm)."""
        points = self.radius[:, None] * to_sphere(self.chart)
        return points if self.along_mm is None else np.column_stack([points[:, 0], self.along_mm, points[:, 2]])

    @property
    def normals(self) -> _Vectors:
        """Normals away from the origin, or the y axis, scaled so that their radial component is 1."""
        normals = to_sphere(self.chart) - gradient_on_sphere(self.chart, self.slopes) / self.radius[:, None]
        return normals if self.along_mm is None else normals * _ACROSS

    def take(self, rows: Int[np.ndarray, " k"]) -> "OnFaces":
        """Select points by row."""
        kept: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        return replace(self, **{name: values[rows] for name, values in kept.items() if values is not None})

    def drawn(self, along_mm: Float[np.ndarray, "m p"]) -> "OnFaces":
        """Each point of a section, at several places along y."""
        count = len(along_mm)
        return replace(self.take(np.tile(np.arange(len(self.face)), count)), along_mm=along_mm.ravel())

    def add(self, by_radius: _Values, total: Tables) -> None:
        """Add derivatives by the radius at each point to those by the coefficients of the tables."""
        np.add.at(total, _places(self.face, self.corner), by_radius[:, None, None] * self.weights)


@dataclass(frozen=True)
class CreasePoints:
    """Points of the creases of a cavity, each on faces ``one`` and ``other``, even in the azimuth.

    Those of faces that are drawn along y are even in the angle under which y is seen from the axis.
    """

    one: OnFaces
    other: OnFaces

    @property
    def spacing_rad(self) -> float:
        """Angle between neighbouring points of a crease."""
        return 2.0 * np.pi / _MERIDIANS if self.one.along_mm is None else np.pi / _PLACES

    @staticmethod
    def of(tables: Tables, scene: Scene, turn: float = 0.0) -> "CreasePoints":
        """Find all creases on the meridians; ``turn``, as a share of their spacing, moves all points."""
        drawn = scene.drawn_half_mm is not None
        meridians = np.array([0.0, np.pi]) if drawn else 2.0 * np.pi * (np.arange(_MERIDIANS) + turn) / _MERIDIANS
        faces, azimuths, ends = _brackets(tables, scene, meridians)
        axes = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
        place = ends.mean(axis=0)
        for _ in range(_NEWTON_STEPS):
            one, other = (OnFaces.of(tables, scene.grid, face, place[:, None] * axes) for face in faces)
            slope = ((one.slopes - other.slopes) * axes).sum(axis=1)
            place = np.clip(place - (one.radius - other.radius) / slope, *ends)
        if drawn:
            slopes = np.tan(np.pi * ((np.arange(_PLACES) + turn) / _PLACES - 0.5))
            one, other = (side.drawn(slopes[:, None] * one.radius) for side in (one, other))
        points = CreasePoints(one, other)
        return points.take(np.flatnonzero(np.abs(points.rate) > 0.0))

    @cached_property
    def tangents(self) -> _Vectors:
        """Vectors along the crease: the cross product of both normals."""
        return np.cross(self.one.normals, self.other.normals)

    @cached_property
    def rate(self) -> _Values:
        """Change of the azimuth, or of the angle under which y is seen, along the tangent (rad/mm)."""
        if self.one.along_mm is not None:
            radius = self.one.radius
            return self.tangents[:, 1] * radius / (radius**2 + self.one.along_mm**2)
        x, y, _ = self.one.points.T
        along_x, along_y, _ = self.tangents.T
        return (x * along_y - y * along_x) / (x**2 + y**2)

    def __len__(self) -> int:
        return len(self.one.face)

    def take(self, rows: Int[np.ndarray, " k"]) -> "CreasePoints":
        """Select points by row."""
        return CreasePoints(self.one.take(rows), self.other.take(rows))

    def across(self, directions: _Vectors) -> _Vectors:
        """Unit vectors perpendicular to the crease and to rays in ``directions``."""
        across = np.cross(directions, self.tangents) * np.sign(self.rate)[:, None]
        return across / np.linalg.norm(across, axis=1, keepdims=True)

    def flows(self, rays: RayBundle) -> tuple[_Values, _Values]:
        """Solid angle (sr per radian of azimuth) that crosses over per mm of growth of either radius, for each ray.

        It leaves the side of :meth:`across`.
        """
        scale = 1.0 / (self.rate * ((self.one.points - rays.origins) ** 2).sum(axis=1))
        by_one, by_other = ((rays.directions * side.normals).sum(axis=1) * scale for side in (self.other, self.one))
        return by_one, -by_other


def _brackets(
    tables: Tables, scene: Scene, azimuths: Float[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, "2 p"], Float[np.ndarray, " p"], Float[np.ndarray, "2 p"]]:
    """The two faces that meet at each crease point, its meridian, and chart radii that bracket it."""
    before = () if scene.chain is None else scene.chain.before
    bounding = [face for face, medium in enumerate(before) if medium == CAVITY]
    steps = np.linspace(0.0, 1.0, _STEPS + 1)
    chart = steps[:, None] * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)[:, None]
    directions = to_sphere(chart).reshape(-1, 3)
    radii = [evaluate_table(scene.grid, tables[face], directions) for face in bounding]
    nearest = (
        np.array(bounding)[np.argmin(radii, axis=0)] if len(bounding) > 1 else np.zeros(len(directions), dtype=int)
    )
    nearest = nearest.reshape(len(azimuths), -1)
    meridian, step = np.nonzero(nearest[:, 1:] != nearest[:, :-1])
    faces = np.stack([nearest[meridian, step], nearest[meridian, step + 1]])
    return faces, azimuths[meridian], np.stack([steps[step], steps[step + 1]])


def _places(face: Int[np.ndarray, " p"], corner: Int[np.ndarray, "p 2"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices, among the coefficients of all tables, of those that act at each point."""
    rows, columns = (corner[:, axis, None] + np.arange(4) for axis in (0, 1))
    return face[:, None, None], rows[:, :, None], columns[:, None, :]


def _gain(
    trace: Trace, scene: Scene, rays: RayBundle, crossing: CreasePoints, worth: RayAdjoint
) -> Float[np.ndarray, " n"]:
    """Difference in worth of light on both sides of the crease for each ray: it leaves the side of ``across``.

    A ray that meets a face before the crease is worth the same on both sides.
    """
    across = crossing.across(in_lens(scene, rays).directions)
    if scene.made is not None:
        across = scene.made.placed.into.to_local_directions(across)
    beside = []
    for sign in (1.0, -1.0):
        directions = rays.directions + sign * BESIDE * across
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        beside.append(replace(rays, directions=directions, flux=np.ones(len(rays))))
    from_side, to_side = worth(trace(RayBundle.joined(beside))).reshape(2, -1)
    return to_side - from_side
