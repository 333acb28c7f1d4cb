"""The faces that bound a medium, one after another from the axis to the rim, and the creases in which they meet.

In each direction the nearest face bounds the medium. Here the faces are nested about the axis: the cap of a cavity and
the side around it, the exit of a body and the wall around it. Each crease is then one closed curve around the axis, and
the domain of each face a disc or a ring of the chart. A crease is known by its distance from the chart's centre over
azimuth, to rounding: a table, and a Newton step on the two faces.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import groupby, pairwise
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.cad.outline import FULL_TURN
from lensforge.cad.patch import Patch
from lensforge.errors import InputError
from lensforge.optics.face_roles import BODY, CAVITY, DOUBLE
from lensforge.results.refined_maximum import Places, in_disc
from lensforge.scene.body import Body, Face
from lensforge.scene.lens import Lens
from lensforge.scene.section_arcs import FaceArc
from lensforge.surfaces.surface import Surface, to_chart, to_sphere

_AZIMUTHS = 360  # of the directions in which faces are compared
_NEAR_EDGE = 1e-4  # of the chart: many times the error of a tabulated edge
_STEPS = 181  # of the table of a crease
_REACH = 1e-3  # relative: a crease of fitted faces is sought this close to that of the exact ones
_SLOPE_STEP = 1e-5  # of the chart
_TINY = 1e-12
_LEAST_SLOPE = 1e-2  # relative to the radius: faces that meet at 0.3 degrees

RIM_CYLINDER = "RIM_CYLINDER"  # where a flange begins: no optical face

_Values = Float[np.ndarray, " n"]
_Chosen = Bool[np.ndarray, " n"] | slice


@runtime_checkable
class StarShaped(Protocol):
    """A surface by its distance (mm) from the origin: of the design, or fitted for the CAD file."""

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the origin in unit ``directions``."""
        ...


Shape = TypeVar("Shape", Surface, Patch)
Other = TypeVar("Other", Surface, Patch)


@dataclass(frozen=True, eq=False)
class Crease:
    """The closed curve in which two faces meet; ``one`` bounds the medium on the side of the axis."""

    one: StarShaped
    other: StarShaped
    table: Any  # a periodic spline over azimuth: distance from the chart's centre, and slope of the gap there

    def radius(self, azimuths: _Values) -> _Values:
        """Distance from the chart's centre at azimuths (rad) of any turn."""
        start, slope = self.table(np.mod(azimuths, FULL_TURN)).T
        return start - _gap(self.one, self.other, azimuths, start) / slope

    def tabulated(self, azimuths: _Values) -> _Values:
        """The same by interpolation in its table, less exact, in a fiftieth of the time."""
        return np.asarray(self.table(np.mod(azimuths, FULL_TURN))[:, 0])

    @property
    def azimuths(self) -> _Values:
        """Azimuths at which it is sampled."""
        return _azimuths()

    def chart(self, azimuths: _Values) -> Float[np.ndarray, "n 2"]:
        """Its chart points."""
        return _on_chart(azimuths, self.radius(azimuths))

    def points(self, azimuths: _Values) -> Float[np.ndarray, "n 3"]:
        """Its points (mm)."""
        directions = to_sphere(self.chart(azimuths))
        return self.one.radius(directions)[:, None] * directions

    @cached_property
    def extent(self) -> tuple[float, float]:
        """Least and largest distance from the chart's centre."""
        radii = self.table(np.linspace(0.0, FULL_TURN, 4 * _AZIMUTHS))[:, 0]
        return float(radii.min()), float(radii.max())


@dataclass(frozen=True)
class SectionEdge:
    """Edge of a narrow band about the section y = 0 of a face that is drawn along y, which is alike all along.

    ``half_width``: of the band, on the chart.
    """

    half_width: float = 0.1

    def radius(self, azimuths: _Values) -> _Values:
        """Distance from the chart's centre at azimuths (rad); 1, the rim, where the edge lies beyond it."""
        return np.minimum(1.0, self.half_width / np.maximum(np.abs(np.sin(azimuths)), self.half_width))

    tabulated = radius

    def chart(self, azimuths: _Values) -> Float[np.ndarray, "n 2"]:
        """Its chart points."""
        return _on_chart(azimuths, self.radius(azimuths))

    @property
    def extent(self) -> tuple[float, float]:
        """Least and largest distance from the chart's centre."""
        return self.half_width, 1.0


@dataclass(frozen=True, eq=False)
class SectionCrease(Crease):
    """The creases of two faces that are drawn along y, ``low_rad`` (below 0) and ``high_rad`` from z in their section.

    On the chart it is one curve, on each side of x = 0 up to the ``edge`` of the band, and then that edge.
    """

    low_rad: float
    high_rad: float
    edge: SectionEdge

    def radius(self, azimuths: _Values) -> _Values:
        """Distance from the chart's centre at azimuths (rad)."""
        cosine = np.cos(azimuths)
        steep = np.tan(np.where(cosine > 0.0, self.high_rad, -self.low_rad)) / np.maximum(np.abs(cosine), _TINY)
        return np.minimum(np.tan(0.5 * np.arctan(steep)), self.edge.radius(azimuths))

    tabulated = radius

    @property
    def azimuths(self) -> _Values:
        """Azimuths at which it is sampled: those of the section."""
        return np.array([0.0, np.pi])

    @cached_property
    def extent(self) -> tuple[float, float]:
        """Half widths on the chart, about its centre: of the largest square without a crease, and of one with all."""
        at = np.abs(np.tan([0.5 * self.low_rad, 0.5 * self.high_rad]))
        # a face that is narrower than the band still reaches the edges of the band
        return min(self.edge.half_width, float(at.min())), max(self.edge.half_width, float(at.max()))


@dataclass(frozen=True, eq=False)
class Domain:
    """Part of the chart where a face bounds its medium, from the crease ``inside`` to that ``outside``.

    None: from the axis, or to the rim. ``section``: edge of a band, within which all counts.
    """

    inside: Crease | None = None
    outside: Crease | None = None
    section: SectionEdge | None = None

    @property
    def edges(self) -> tuple[Crease | SectionEdge, ...]:
        """The creases at which it begins and ends, or the edge of its band."""
        return tuple(edge for edge in (self.inside, self.outer_edge) if edge is not None)

    @property
    def outer_edge(self) -> Crease | SectionEdge | None:
        """Its edge outwards; None for the rim."""
        return self.section if self.outside is None else self.outside

    @property
    def extent(self) -> tuple[float, float]:
        """Least and largest distance from the chart's centre; 0 and 1 for the whole hemisphere."""
        low = 0.0 if self.inside is None else self.inside.extent[0]
        return low, 1.0 if self.outer_edge is None else self.outer_edge.extent[1]

    def radii(self, azimuths: _Values) -> tuple[_Values, _Values]:
        """Distances from the chart's centre at its inner and outer edge."""
        low = np.zeros_like(azimuths) if self.inside is None else self.inside.radius(azimuths)
        return low, np.ones_like(azimuths) if self.outer_edge is None else self.outer_edge.radius(azimuths)

    def tabulated_radii(self, azimuths: _Values) -> tuple[_Values, _Values]:
        """The same distances by the tables of the edges, much faster."""
        low = np.zeros_like(azimuths) if self.inside is None else self.inside.tabulated(azimuths)
        return low, np.ones_like(azimuths) if self.outer_edge is None else self.outer_edge.tabulated(azimuths)

    def holds(self, places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Mask of the chart points that lie in it."""
        if not self.edges:
            return np.sum(places**2, axis=1) <= 1.0
        azimuths, radius = _polar(places)
        beyond = _beyond(radius, *self.tabulated_radii(azimuths))
        near = np.abs(beyond) < _NEAR_EDGE
        beyond[near] = _beyond(radius[near], *self.radii(azimuths[near]))
        return beyond <= 0.0

    def held(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 3"]:
        """Select the directions above z = 0 that lie in it."""
        return directions[self.holds(to_chart(directions))] if self.edges else directions

    def within(self, places: Places, *, tabulated: bool = False) -> Places:
        """Move chart points that lie outside along their meridian to the edge, or to the ``tabulated`` edge."""
        if not self.edges:
            return in_disc(places)
        radii = self.tabulated_radii if tabulated else self.radii
        azimuths, radius = _polar(places.reshape(-1, 2))
        return _on_chart(azimuths, np.clip(radius, *radii(azimuths))).reshape(places.shape)


def _beyond(radius: _Values, low: _Values, high: _Values) -> _Values:
    """Distance from the nearer of two edges, negative between them."""
    return np.maximum(low - radius, radius - high)


WHOLE = Domain()


@dataclass(frozen=True, eq=False)
class TrimmedFace(Generic[Shape]):
    """A face of a boundary: its name, its shape, and its domain.

    ``is_open``: an opening of the cavity. It has no material within the body's inner rim; the body ends in the ring
    around that. ``is_flange``: the cylinder at which a flange begins.
    """

    name: str
    shape: Shape
    domain: Domain = WHOLE
    is_open: bool = False
    is_flange: bool = False

    @property
    def is_ring(self) -> bool:
        """True for the ring in which a body ends around an opening."""
        return self.is_open and self.domain.inside is not None

    @property
    def label(self) -> str:
        """Name of its face in the solid."""
        if self.is_flange:
            return RIM_CYLINDER
        return f"{self.name.upper()}_RIM" if self.is_open else optical_name(self.name)


def optical_name(name: str) -> str:
    """The name in the solid of the face ``name`` of a lens."""
    return f"OPTICAL_{name.upper()}"


@dataclass(frozen=True, eq=False)
class Boundary(Generic[Shape]):
    """The faces that bound a medium, from the axis to the rim; together they are star-shaped, as each is."""

    faces: tuple[TrimmedFace[Shape], ...]

    @property
    def opening(self) -> Crease | None:
        """The inner rim of the body around an opening; None for a body without one."""
        first = self.faces[0]
        return (first.domain.inside or first.domain.outside) if first.is_open else None

    @property
    def of_material(self) -> tuple[TrimmedFace[Shape], ...]:
        """The faces with material on one side."""
        return tuple(face for face in self.faces if face.is_ring or not face.is_open)

    def closed(self, directions: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """True in directions that meet material."""
        if self.opening is None:
            return np.ones(len(directions), dtype=bool)
        azimuths, radius = _polar(to_chart(directions))
        return np.asarray(radius > self.opening.radius(azimuths))

    @property
    def section(self) -> SectionEdge | None:
        """Edge of the band about the section of faces that are drawn along y; None for any other."""
        return self.faces[0].domain.section

    @property
    def creases(self) -> tuple[Crease, ...]:
        """Creases between each face and the next, from the axis on."""
        return tuple(face.domain.outside for face in self.faces if face.domain.outside is not None)

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> _Values:
        """Distance (mm) from the origin in unit ``directions``, also a little below z = 0."""
        return self.by_face(to_chart(directions), lambda face, chosen: face.shape.radius(directions[chosen]))

    def by_face(
        self, chart: Float[np.ndarray, "n 2"], figure: Callable[[TrimmedFace[Shape], _Chosen], Float[np.ndarray, "..."]]
    ) -> Float[np.ndarray, "..."]:
        """``figure`` at each of the ``chart`` points, evaluated for the face that bounds the medium there."""
        if not self.creases:
            return figure(self.faces[0], slice(None))
        numbers = self.numbers(chart)
        parts: list[Any] = [figure(face, numbers == k) for k, face in enumerate(self.faces)]
        selected = np.empty((len(numbers), *parts[0].shape[1:]))
        for k, part in enumerate(parts):
            selected[numbers == k] = part
        return selected

    def numbers(self, chart: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
        """Number of the face that bounds the medium at each of the ``chart`` points."""
        azimuths, radius = _polar(chart)
        faces = np.zeros(len(chart), dtype=int)
        for crease in self.creases:
            faces += radius > crease.radius(azimuths)
        return faces

    def of(self, shapes: Sequence[Other]) -> "Boundary[Other]":
        """The same boundary with similar ``shapes``; creases lie where these meet."""
        if len(self.faces) == 1 or self.section is not None:
            pairs = zip(self.faces, shapes, strict=True)
            return Boundary(tuple(TrimmedFace(face.name, shape, face.domain) for face, shape in pairs))
        radii = [crease.radius(_azimuths()) for crease in self.creases]
        return _nested(self.faces, shapes, [(radius * (1.0 - _REACH), radius * (1.0 + _REACH)) for radius in radii])


Pair = tuple[Boundary[Shape], Boundary[Shape]]


@dataclass(frozen=True)
class SharpestEdge:
    """The least angle (degrees) between two ``faces`` along their crease, and where (mm)."""

    faces: tuple[str, str]
    angle_deg: float
    point_mm: Float[np.ndarray, "3"]


def sharpest_edges(boundary: Boundary[Shape]) -> Iterator[SharpestEdge]:
    """The sharpest place of each crease of ``boundary``, sampled every half degree."""
    for (inner, outer), crease in zip(pairwise(boundary.faces), boundary.creases, strict=True):
        chart = crease.chart(crease.azimuths)
        turned = np.sum(_normals(inner.shape, chart) * _normals(outer.shape, chart), axis=1)
        around = inner.is_open and not inner.is_ring  # the body is on the other side of its opening
        angles = np.degrees(np.arccos(np.clip(turned if around else -turned, -1.0, 1.0)))
        least = int(np.argmin(angles))
        (point,) = crease.points(crease.azimuths[[least]])
        yield SharpestEdge((inner.name, outer.name), float(angles[least]), point)


def _normals(shape: Surface | Patch, chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    return shape.normals(chart) if isinstance(shape, Patch) else shape.normal(to_sphere(chart))


def as_pair(cavity: Shape | Boundary[Shape], envelope: Shape | Boundary[Shape]) -> Pair[Shape]:
    """Boundaries of cavity and body; a single face gets its name in a double-freeform lens."""
    inwards, outwards = (
        boundary if isinstance(boundary, Boundary) else Boundary((TrimmedFace(name, boundary),))
        for name, boundary in zip(DOUBLE, (cavity, envelope), strict=True)
    )
    return inwards, outwards


def domain_of(lens: Lens, name: str) -> Domain:
    """Part of the chart on which the face ``name`` bounds the body of ``lens``."""
    return next(
        face.domain
        for lens_boundary in lens_boundaries(lens)
        for face in lens_boundary.of_material
        if face.name == name
    )


def boundaries(body: Body) -> Pair[Surface]:
    """Boundaries of the cavity of ``body``, and of its material outwards.

    Raises :class:`InputError` for a body that is not closed, and for faces that are not nested about the axis.
    """
    if len(body.cavity) != 1 or len(body.envelope) != 1:
        body.require_sound()
    pair = _boundary(body.cavity), _boundary(body.envelope)
    return _around_opening(*pair) if any(face.is_open for face in body.faces) else pair


def of_shapes(pair: Pair[Shape], shapes: Mapping[str, Other]) -> Pair[Other]:
    """The same boundaries with other shapes, by the names of their faces, each similar to the one before."""
    cavity, envelope = (boundary.of([shapes[face.name] for face in boundary.faces]) for boundary in pair)
    return (cavity, envelope) if pair[0].opening is None else _around_opening(cavity, envelope)


def _around_opening(cavity: Boundary[Shape], envelope: Boundary[Shape]) -> Pair[Shape]:
    """Boundaries that both begin at an opening, which is a ring of the body between their creases."""
    (first, *inside) = cavity.faces
    (next_face, *outside) = envelope.faces
    rims = [face.domain.outside for face in (first, next_face)]
    if first.name != next_face.name or None in rims:
        raise InputError(
            f"faces {first.name} and {next_face.name}: an opening must be met by the axis, and be one alone"
        )
    inner, outer = (rim.radius(_azimuths()) for rim in rims if rim is not None)
    if not (outer - inner).min() > 0.0:
        raise InputError(
            f"face {first.name}: {cavity.faces[1].name} and {envelope.faces[1].name} meet in it; no wall is left at "
            "its rim"
        )
    ring = replace(next_face, domain=Domain(rims[0], rims[1]), is_open=True)
    return Boundary((replace(first, is_open=True), *inside)), Boundary((ring, *outside))


@lru_cache(maxsize=4)  # sections and drawing ask for it
def lens_boundaries(lens: Lens) -> Pair[Surface]:
    """The boundaries of the body of ``lens``; of faces that are drawn along y within a band about their section."""
    if lens.spec.lens.drawn_mm is None:
        return boundaries(lens.body)
    if lens.spec.lens.has_creases:
        lens.body.require_sound()
    return _about_section(lens.body.arcs(CAVITY)), _about_section(lens.body.arcs(BODY))


def _about_section(arcs: Sequence[FaceArc]) -> Boundary[Surface]:
    """The boundary of faces that are drawn along y, from the middle arc on, each with the arcs on both sides."""
    edge = SectionEdge()
    middle = len(arcs) // 2
    outward = arcs[middle:]
    corners = [
        SectionCrease(inner.face, outer.face, None, left.low_rad, inner.high_rad, edge)
        for left, (inner, outer) in zip(arcs[middle::-1], pairwise(outward), strict=False)
    ]
    ends = zip([None, *corners], [*corners, None], strict=True)
    domains = [Domain(inside, outside, edge) for inside, outside in ends]
    return Boundary(
        tuple(TrimmedFace(arc.name, arc.face, domain) for arc, domain in zip(outward, domains, strict=True))
    )


def _boundary(faces: tuple[Face, ...]) -> Boundary[Surface]:
    if len(faces) == 1:
        return Boundary((TrimmedFace(faces[0].name, faces[0].surface),))
    azimuths = _azimuths()
    steps = np.linspace(0.0, 1.0, _STEPS)
    turns, radii = (mesh.ravel() for mesh in np.meshgrid(azimuths, steps, indexing="ij"))
    directions = to_sphere(_on_chart(turns, radii))
    lengths = np.stack([face.surface.radius(directions) for face in faces])
    nearest = lengths.argmin(axis=0).reshape(_AZIMUTHS, _STEPS)
    order = list(dict.fromkeys(nearest[0].tolist()))
    place = np.full(len(faces), -1)
    place[order] = np.arange(len(order))
    places = place[nearest]
    change = np.diff(places, axis=1)
    nested = ((change == 0) | (change == 1)).all(axis=1) & (places[:, 0] == 0) & (places[:, -1] == len(faces) - 1)
    if not nested.all():
        wrong = int(np.argmin(nested))
        raise _not_nested(faces, float(np.degrees(azimuths[wrong])), nearest[wrong])
    ordered = [faces[k] for k in order]
    last = [np.sum(places <= k, axis=1) - 1 for k in range(len(faces) - 1)]
    brackets = [(steps[index], steps[index + 1]) for index in last]
    return _nested(ordered, [face.surface for face in ordered], brackets)


def _not_nested(faces: tuple[Face, ...], azimuth_deg: float, nearest: Int[np.ndarray, " k"]) -> InputError:
    names, met = (
        ", ".join(faces[k].name for k in numbers) for numbers in (range(len(faces)), [k for k, _ in groupby(nearest)])
    )
    return InputError(
        f"faces {names}: from the axis to the rim at azimuth {azimuth_deg:.0f} degrees the {faces[0].before} is "
        f"bounded by {met}: must be each of them once, in one order all around; move one of them, or leave it out"
    )


def _nested(
    faces: Sequence[Face | TrimmedFace[Any]], shapes: Sequence[Shape], brackets: list[tuple[_Values, _Values]]
) -> Boundary[Shape]:
    """The boundary by ``shapes`` from the axis to the rim; ``brackets``: chart radii between which each crease lies."""
    names = [face.name for face in faces]
    creases: list[Crease] = [
        _crease(names[k : k + 2], shapes[k], shapes[k + 1], low, high) for k, (low, high) in enumerate(brackets)
    ]
    domains = [Domain(*ends) for ends in zip([None, *creases], [*creases, None], strict=True)]
    trimmed = zip(faces, shapes, domains, strict=True)
    return Boundary(tuple(TrimmedFace(of.name, shape, domain, False, of.is_flange) for of, shape, domain in trimmed))


def _crease(names: Sequence[str], inner: StarShaped, outer: StarShaped, low: _Values, high: _Values) -> Crease:
    from scipy.interpolate import make_interp_spline
    from scipy.optimize.elementwise import find_root

    azimuths = _azimuths()
    root = find_root(lambda radius, turn: _gap(inner, outer, turn, radius), (low, high), args=(azimuths,))
    ahead, back = (_gap(inner, outer, azimuths, root.x + step) for step in (_SLOPE_STEP, -_SLOPE_STEP))
    slope = (ahead - back) / (2.0 * _SLOPE_STEP)
    if (
        not root.success.all()
        or slope.min() < _LEAST_SLOPE * inner.radius(to_sphere(_on_chart(azimuths, root.x))).max()
    ):
        raise InputError(
            f"faces {names[0]} and {names[1]}: almost touch along their crease; let them meet at 1 degree or more"
        )
    table = np.stack([root.x, slope], axis=1)
    return Crease(
        inner,
        outer,
        make_interp_spline(np.append(azimuths, FULL_TURN), np.concatenate([table, table[:1]]), k=5, bc_type="periodic"),
    )


def _gap(inner: StarShaped, outer: StarShaped, azimuths: _Values, radius: _Values) -> _Values:
    """Distance (mm) by which ``inner`` is farther than ``outer`` at chart points."""
    directions = to_sphere(_on_chart(azimuths, radius))
    return inner.radius(directions) - outer.radius(directions)


def _azimuths() -> _Values:
    return np.linspace(0.0, FULL_TURN, _AZIMUTHS, endpoint=False)


def _on_chart(azimuths: _Values, radius: _Values) -> Float[np.ndarray, "n 2"]:
    return radius[:, None] * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)


def _polar(chart: Float[np.ndarray, "n 2"]) -> tuple[_Values, _Values]:
    """Azimuth (rad) and distance from the centre of chart points."""
    return np.arctan2(chart[:, 1], chart[:, 0]), np.hypot(chart[:, 0], chart[:, 1])
