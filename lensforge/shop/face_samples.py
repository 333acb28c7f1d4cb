"""An exported optical face, the spline of the STEP file, sampled with normals, curvatures and areas; its least draft.

Samples are the nodes of a square chart grid within the domain of the face, so that values per sample are also a map,
and the nodes just outside of the rim, moved onto it: extremes often lie there. Extremes are then searched for between
the samples, up to the creases in which the face meets others.

Integrals over the area take points of their own, since the cells of a square grid fit a round rim poorly:
Gauss-Legendre in the chart's radius times the trapezoidal rule in azimuth. Areas of spheres, spheroids and ellipsoids
come out to 1e-9, the share of a hemisphere below a draft, whose edge is located along each radius, to 3e-5.

Draft is the angle of the face to the optical axis, along which a mould opens: ``asin(n . z)`` with the outward normal,
since the core of the cavity is drawn along -z; with the opposite one of a wall, which the lower half of the mould makes
together with the core. A negative draft is an undercut.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import cache, cached_property

import numpy as np
from jaxtyping import Bool, Float

from lensforge.cad.boundary import WHOLE, Domain
from lensforge.cad.face_tolerance import FINEST_MRAD
from lensforge.cad.patch import Jet, Patch, PrincipalCurvatures, principal_curvatures
from lensforge.optics.face_roles import CAVITY
from lensforge.results.refined_maximum import refined_maximum
from lensforge.scene.body import Face
from lensforge.spec.part_section import ManufactureSection
from lensforge.surfaces.surface import HALF_WIDTH

RADII = 96
AZIMUTHS = 192
_ALONG_EDGE = 360  # places at which an extreme on a crease is looked for


@dataclass(frozen=True)
class AreaRule:
    """Integration points on the unit disc, radius slowest, and their weights in chart area.

    Over the domain of a face the radius stands for the share of the way from its beginning to its end.
    """

    chart: Float[np.ndarray, "q 2"]
    weights: Float[np.ndarray, " q"]
    nodes: Float[np.ndarray, " r"]
    edges: Float[np.ndarray, " r1"]  # of the stretch of radius that each node stands for

    def over(self, domain: Domain) -> tuple[Float[np.ndarray, "q 2"], Float[np.ndarray, " q"]]:
        """Points and weights of the rule over ``domain``."""
        if not domain.edges:
            return self.chart, self.weights
        share = np.repeat(self.nodes, len(self.chart) // len(self.nodes))
        low, high = domain.radii(np.arctan2(self.chart[:, 1], self.chart[:, 0]))
        farther = low / share + high - low  # radius over share
        return farther[:, None] * self.chart, self.weights * farther * (high - low)

    def share_below(self, values: Float[np.ndarray, " q"], limit: float, areas: Float[np.ndarray, " q"]) -> float:
        """Share of the area in which ``values`` are below ``limit``; ``areas``: area of the face at each point."""
        excess = values.reshape(len(self.nodes), -1) - limit
        slope = np.gradient(excess, self.nodes, axis=0)
        inner = excess + slope * (self.edges[:-1] - self.nodes)[:, None]
        outer = excess + slope * (self.edges[1:] - self.nodes)[:, None]
        low, high = np.minimum(inner, outer), np.maximum(inner, outer)
        rise = np.where(high > low, high - low, 1.0)
        below = np.where(high <= 0.0, 1.0, np.where(low >= 0.0, 0.0, -low / rise))
        return float(np.sum(areas * below.ravel()) / np.sum(areas))


@cache
def area_rule(radii: int = RADII, azimuths: int = AZIMUTHS) -> AreaRule:
    """The rule with ``radii`` x ``azimuths`` points."""
    node, weight = np.polynomial.legendre.leggauss(radii)
    node = (node + 1.0) / 2.0
    weight = weight / 2.0
    azimuth = np.arange(azimuths) * (2.0 * np.pi / azimuths)
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    return AreaRule(
        chart=(node[:, None, None] * circle).reshape(-1, 2),
        weights=np.repeat(weight * node * (2.0 * np.pi / azimuths), azimuths),
        nodes=node,
        edges=np.concatenate([[0.0], np.cumsum(weight)]),  # Gauss weights interlace with their nodes
    )


_UNDERCUT = 1e-3 * FINEST_MRAD  # a hemisphere's rim has n.z = 0 up to the error of the exported normals


class AirSide(IntEnum):
    """Side of the face on which air and cutter are: the sign that turns the outward normal into the air."""

    OUTSIDE = 1  # the envelope
    INSIDE = -1  # the cavity


def air_side(face: Face, shop: ManufactureSection) -> AirSide:
    """Air side of ``face`` as it is cut: a mould insert has air where the lens has material."""
    around_cavity = face.before == CAVITY and not face.is_open
    return AirSide.OUTSIDE if around_cavity == (shop.cuts == "inserts") else AirSide.INSIDE


@dataclass(frozen=True)
class OpticalFace:
    """An exported face and its air side; the rim is the unit circle of the stereographic chart.

    ``domain``: the part of the chart on which it bounds its medium; ``beside``: the faces that bound the rest of the
    medium. ``sense``: -1 for a face of the envelope that is made and cut from below, as the cavity is. ``drawn_mm``:
    length along y of a face of a linear lens, whose ``domain`` is a band about its section; None for any other.
    """

    patch: Patch
    air: AirSide
    domain: Domain = WHOLE
    beside: "tuple[OpticalFace, ...]" = ()
    sense: int = 1
    drawn_mm: float | None = None

    @property
    def away(self) -> Float[np.ndarray, "3"]:
        """Unit vector from the face to the holder of a tool along the axis."""
        return np.array([0.0, 0.0, float(self.sense * self.air)])

    def distances(self, points: Float[np.ndarray, "n 3"], centre: Float[np.ndarray, "3"]) -> Float[np.ndarray, " n"]:
        """Distances (mm) from the ``centre`` of its best-fit sphere, or of a drawn face from a line along y there."""
        away = points - centre
        return np.linalg.norm(away if self.drawn_mm is None else away[:, ::2], axis=1)

    def radius(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the origin at chart ``points``; outside the patch's square, the value at its edge."""
        return np.asarray(np.linalg.norm(self.patch.points(np.clip(points, -HALF_WIDTH, HALF_WIDTH)), axis=1))

    def rim_mm(self, turn: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) of the medium's rim from the axis at points of the unit circle."""
        return np.asarray(np.min([face.radius(turn) for face in (self, *self.beside)], axis=0))

    def air_normal(self, jet: Jet) -> Float[np.ndarray, "n 3"]:
        """Unit normals that point from the material into the air."""
        return float(self.air) * jet.normal

    def curvatures(self, points: Float[np.ndarray, "n 2"]) -> PrincipalCurvatures:
        """Principal curvatures (1/mm) at chart ``points``, seen from the air."""
        jet = self.patch.jet(points)
        return principal_curvatures(jet, self.air_normal(jet))


@dataclass(frozen=True)
class ChartGrid:
    """``nodes`` x ``nodes`` chart points over [-1, 1], first index X; those ``inside`` are a face's first samples."""

    axis: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, "n n"]

    @property
    def step(self) -> float:
        """Node spacing in chart units."""
        return float(self.axis[1] - self.axis[0])

    def to_map(self, values: Float[np.ndarray, "k *c"]) -> Float[np.ndarray, "n n *c"]:
        """Values per sample as a map, NaN outside the rim; samples on the rim itself fall between the nodes."""
        values_map = np.full((*self.inside.shape, *values.shape[1:]), np.nan)
        values_map[self.inside] = values[: np.count_nonzero(self.inside)]
        return values_map


@dataclass(frozen=True)
class FaceSamples:
    """A face at ``k`` chart points: points (mm), unit air-side normals, areas (mm^2) and curvatures (1/mm)."""

    face: OpticalFace
    grid: ChartGrid
    chart: Float[np.ndarray, "k 2"]
    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    areas: Float[np.ndarray, " k"]
    curvatures: PrincipalCurvatures

    @property
    def outward(self) -> Float[np.ndarray, "k 3"]:
        """Unit normals pointing away from the origin, whichever side the air is on."""
        return float(self.face.air) * self.normals

    @property
    def upward(self) -> Float[np.ndarray, " k"]:
        """Axial component of the outward normal, positive towards the side from which the face is made."""
        return self.face.sense * self.outward[:, 2]

    @cached_property
    def area(self) -> "FaceArea":
        """The face's integration points; they differ from the samples. Of a drawn face they lie in its section."""
        length_mm = self.face.drawn_mm
        if length_mm is not None:
            rule = area_rule(azimuths=2)
            chart, weights = rule.over(self.face.domain)
            jet = self.face.patch.jet(chart)
            on_radius = weights / (np.pi * np.abs(chart[:, 0]))  # two azimuths: each a half of the disc
            areas = on_radius * np.linalg.norm(jet.x, axis=1) * length_mm
            return FaceArea(rule, jet.point, jet.normal, areas, self.face.sense)
        rule = area_rule()
        chart, weights = rule.over(self.face.domain)
        jet = self.face.patch.jet(chart)
        return FaceArea(rule, jet.point, jet.normal, weights * jet.area_element, self.face.sense)

    def largest(
        self, figure: Callable[[Float[np.ndarray, "m 2"]], Float[np.ndarray, " m"]], values: Float[np.ndarray, " k"]
    ) -> float:
        """Largest ``figure``, refined between the samples and at the creases; ``values``: the figure at the samples."""
        domain = self.face.domain
        edges = [edge.chart(np.linspace(0.0, 2.0 * np.pi, _ALONG_EDGE, endpoint=False)) for edge in domain.edges]
        places = np.concatenate([self.chart, *edges])
        known = np.concatenate([values, *map(figure, edges)])
        return refined_maximum(figure, places, known, self.grid.step, within=domain.within)[1]

    def lowest_curvature(self) -> float:
        """Lowest curvature (1/mm) of the face, refined between the samples."""
        return -self.largest(lambda points: -self.face.curvatures(points).minimum, -self.curvatures.minimum)

    def highest_curvature(self) -> float:
        """Highest curvature (1/mm) of the face, refined between the samples."""
        return self.largest(lambda points: self.face.curvatures(points).maximum, self.curvatures.maximum)

    def fraction(self, where: Bool[np.ndarray, " k"]) -> float:
        """Share of the face's area in which ``where`` is True, to one cell along the edge of that part."""
        return float(self.areas[where].sum() / self.areas.sum())


@dataclass(frozen=True)
class FaceArea:
    """A face at ``q`` integration points: points (mm), unit outward normals, the area (mm^2) of each, its sense."""

    rule: AreaRule
    points: Float[np.ndarray, "q 3"]
    outward: Float[np.ndarray, "q 3"]
    areas: Float[np.ndarray, " q"]
    sense: int = 1

    @property
    def total_mm2(self) -> float:
        """Area of the face (mm^2)."""
        return float(self.areas.sum())

    @property
    def shares(self) -> Float[np.ndarray, " q"]:
        """Share of the area of each point."""
        return self.areas / self.total_mm2

    @property
    def undercut_fraction(self) -> float:
        """Share of the area that neither a two-part mould nor an untilted cutter reaches along the axis."""
        return self.rule.share_below(self.sense * self.outward[:, 2], -_UNDERCUT, self.areas)


def sample_face(face: OpticalFace, nodes: int) -> FaceSamples:
    """Sample ``face`` on a grid of ``nodes`` x ``nodes`` chart points."""
    grid, points, cells = _in_domain(face.domain, *_disc(nodes))
    jet = face.patch.jet(points)
    normals = face.air_normal(jet)
    return FaceSamples(
        face=face,
        grid=grid,
        chart=points,
        points=jet.point,
        normals=normals,
        areas=cells * jet.area_element,
        curvatures=principal_curvatures(jet, normals),
    )


def all_points(face: OpticalFace, nodes: int) -> Float[np.ndarray, "m 3"]:
    """Points (mm) of ``face`` and its neighbours on grids of ``nodes`` x ``nodes``: what a tool must not cut."""
    return np.concatenate([sample_face(part, nodes).points for part in (face, *face.beside)])


def _disc(nodes: int) -> tuple[ChartGrid, Float[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
    """Grid, sample points of the unit disc, and the chart area of each: the share of its cell inside the disc."""
    axis = np.linspace(-1.0, 1.0, nodes)
    step = axis[1] - axis[0]
    padded = np.concatenate([[-1.0 - step], axis, [1.0 + step]])
    square = np.stack(np.meshgrid(padded, padded, indexing="ij"), axis=-1)
    distance = np.linalg.norm(square, axis=-1)
    # Across the cells on the rim the share inside falls almost linearly, over the width of a cell normal to the rim.
    width = step * np.abs(square).sum(axis=-1) / np.maximum(distance, step)
    share = np.clip(0.5 + (1.0 - distance) / np.maximum(width, step), 0.0, 1.0)
    inside = distance <= 1.0 + 1e-12
    rim = ~inside & (share > 0.0)
    moved = square[rim] / distance[rim][:, None]
    points = np.concatenate([square[inside], moved])
    cells = np.concatenate([share[inside], share[rim]]) * step**2
    return ChartGrid(axis, inside[1:-1, 1:-1]), points, cells


def _in_domain(
    domain: Domain, grid: ChartGrid, points: Float[np.ndarray, "k 2"], cells: Float[np.ndarray, " k"]
) -> tuple[ChartGrid, Float[np.ndarray, "m 2"], Float[np.ndarray, " m"]]:
    """Samples of the disc that lie in ``domain``; a cell counts if its node does."""
    if not domain.edges:
        return grid, points, cells
    low, high = domain.radii(np.arctan2(points[:, 1], points[:, 0]))
    radius = np.hypot(points[:, 0], points[:, 1])
    chosen = (radius >= low) & (radius <= high + 1e-12)
    inside = grid.inside.copy()
    inside[grid.inside] = chosen[: np.count_nonzero(grid.inside)]
    return ChartGrid(grid.axis, inside), points[chosen], cells[chosen]


def least_draft_rad(samples: FaceSamples) -> float:
    """Least draft angle (rad) of the face, refined between the samples."""
    patch = samples.face.patch
    sense = samples.face.sense
    steepest = samples.largest(lambda points: -sense * patch.normals(points)[:, 2], -samples.upward)
    return -float(np.arcsin(np.clip(steepest, -1.0, 1.0)))
