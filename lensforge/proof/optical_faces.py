"""The optical faces of a body, as the casts through its files know them: names, sides, and the events of the light.

A file is cast by its own geometry. The design contributes only the name of the face at a place, on which its coating
depends, and the number of events on the way of the light.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, sin

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.errors import InputError
from lensforge.optics.face_roles import DOUBLE
from lensforge.sources.ray_bundle import RayBundle

NO_FACE = -1  # at or below z = 0 lies no optical face
FAR_MM = 0.05  # facets further from every face of the design are of none of them: as MOST_CHORD_MM of the acceptance
_AT_FLANGE_MM = 1e-3
_FARTHEST = 1e-9  # 1/mm: the face is not met in this direction
_ACROSS = np.array([1.0, 0.0, 1.0])  # faces that are drawn along y are sorted in their section
_CROSSINGS = 2  # into the body, and out of it: each is an event


def faces_away(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """True where a surface with ``normals`` out of the material faces away from the origin, as the lens's outside does.

    All faces are star-shaped about the origin, and the material lies between those of the cavity and the others.
    """
    away: Bool[np.ndarray, " n"] = np.sum(points * normals, axis=1) > 0.0
    return away


@dataclass(frozen=True)
class PlateOfLenses:
    """Lenses of a plate: places (mm) of their axes, turns (rad), and the number of the one that is lit.

    None: all are lit, and coordinates are those of the plate. ``kinds``: number of the kind of each lens; by default
    all are of one.
    """

    places: Float[np.ndarray, "k 2"]
    turns: Float[np.ndarray, " k"]
    lit: int | None
    kinds: tuple[int, ...] = ()

    def of_kinds(self, numbers: Int[np.ndarray, " n"]) -> Iterator[tuple[int, Int[np.ndarray, " m"]]]:
        """Each kind, with the rows whose lens, by its number, is of that kind."""
        kinds = np.array(self.kinds or [0] * len(self.places))[numbers]
        return ((int(kind), np.flatnonzero(kinds == kind)) for kind in np.unique(kinds))

    def nearest(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Number of the lens with the axis nearest to points in the coordinates of the lit lens."""
        from scipy.spatial import cKDTree

        numbers: Int[np.ndarray, " n"] = cKDTree(self._seen).query(points[:, :2])[1]
        return numbers

    def from_lit(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points of the plate in the coordinates of the lit lens."""
        if self.lit is None:
            return points
        moved: Float[np.ndarray, "n 3"] = (points - (*self.places[self.lit], 0.0)) @ _turned(-self.turns[self.lit]).T
        return moved

    def to_local(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Transform points and normals from the lit lens to the local coordinates of the nearest one."""
        local, numbers = self.at_local(points)
        local_normals = normals.copy()
        lit = 0.0 if self.lit is None else self.turns[self.lit]
        for number in np.unique(numbers):
            rows = numbers == number
            local_normals[rows] = normals[rows] @ _turned(lit - self.turns[number]).T
        return local, local_normals

    def at_local(
        self, points: Float[np.ndarray, "n 3"], numbers: Int[np.ndarray, " n"] | None = None
    ) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Transform points from the lit lens to the nearest lens, or to ``numbers``; also that lens's number."""
        numbers = self.nearest(points) if numbers is None else numbers
        lit = 0.0 if self.lit is None else self.turns[self.lit]
        local = points - np.column_stack([self._seen, np.zeros(len(self.places))])[numbers]
        turns = lit - self.turns
        cosine = np.cos(turns)[numbers]
        sine = np.sin(turns)[numbers]
        x, y = local[:, 0].copy(), local[:, 1].copy()
        local[:, 0] = cosine * x - sine * y
        local[:, 1] = sine * x + cosine * y
        return local, numbers

    def turns_to(self, numbers: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 3"]:
        """Rotations from the coordinates of the lit lens to those of the lenses ``numbers``."""
        lit = 0.0 if self.lit is None else self.turns[self.lit]
        turns: Float[np.ndarray, "n 3 3"] = np.stack([_turned(lit - turn) for turn in self.turns])[numbers]
        return turns

    def to_lit_points(
        self, local: Float[np.ndarray, "n 3"], numbers: Int[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 3"]:
        """Transform points from the local coordinates of the lenses ``numbers`` to those of the lit lens."""
        lit: Float[np.ndarray, "n 3"] = np.einsum("nji,nj->ni", self.turns_to(numbers), local)
        lit[:, :2] += self._seen[numbers]
        return lit

    def placed(self, rays: RayBundle, numbers: Int[np.ndarray, " n"]) -> RayBundle:
        """Transform rays from the local coordinates of their lens, by number, to those of the plate."""
        origins = rays.origins.copy()
        directions = rays.directions.copy()
        for number, (place, turn) in enumerate(zip(self.places, self.turns, strict=True)):
            rows = numbers == number
            turned = _turned(turn).T
            origins[rows] = rays.origins[rows] @ turned + np.array([*place, 0.0])
            directions[rows] = rays.directions[rows] @ turned
        return replace(rays, origins=origins, directions=directions)

    @cached_property
    def _seen(self) -> Float[np.ndarray, "k 2"]:
        return self.from_lit(np.column_stack([self.places, np.zeros(len(self.places))]))[:, :2]


def _turned(angle: float) -> Float[np.ndarray, "3 3"]:
    return np.array([[cos(angle), -sin(angle), 0.0], [sin(angle), cos(angle), 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Expansion:
    """A part ``scale`` times as large as in its files, about its seat, ``seat_mm`` below its origin.

    Rays are cast through the part of the files; lengths there are multiplied by ``scale`` for the warm part.
    """

    scale: float = 1.0
    seat_mm: float = 0.0

    def to_files(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Transform points from the warm part to its files."""
        return points if self.scale == 1.0 else (points - self._raised) / self.scale

    def from_files(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Transform points from the files to the warm part."""
        return points if self.scale == 1.0 else self.scale * points + self._raised

    @property
    def _raised(self) -> Float[np.ndarray, "3"]:
        return np.array([0.0, 0.0, self.seat_mm * (self.scale - 1.0)])


AS_IN_FILES = Expansion()


@dataclass(frozen=True)
class OpticalFaces:
    """Names of the faces of a body, True for those that bound it outwards, False for those that bound the cavity.

    ``events``: at most as many times the light is refracted or reflected on the sequential path; with 2 no reflection
    is followed. ``inverse_radii``: of the design, by which a place is sorted where several faces lie on one side: 1
    over the distance from the origin (1/mm), on a square grid of the stereographic chart up to +-1, first index X. By
    default None, and a double lens: in through one face and out through the other. ``plate``: of a part with several
    such bodies, seen from the one that is lit; None for one. ``of_kinds``: of the body of each kind; by default all are
    like these. ``opening``: number of a face at which there is no material: light that rises and meets the part no more
    has left by it. ``flange_face``: number of the face at which a flange begins, ``flange_mm``: its radius; all of the
    part that is farther from the axis above z = 0 counts as it; None without one. ``end_mm``: distance of the ends of a
    part that is drawn along y from its middle, which are the flange then. ``expansion``: of the part at work.
    """

    names: tuple[str, ...] = DOUBLE
    away: tuple[bool, ...] = (False, True)
    events: int = _CROSSINGS
    inverse_radii: Float[np.ndarray, "f m m"] | None = None
    plate: PlateOfLenses | None = None
    of_kinds: tuple["OpticalFaces", ...] = ()
    opening: int | None = None
    flange_face: int | None = None
    flange_mm: float | None = None
    end_mm: float | None = None
    expansion: Expansion = AS_IN_FILES

    def __post_init__(self) -> None:
        if self.events < _CROSSINGS:
            raise InputError(f"events = {self.events}: light passes two faces at least, must be >= {_CROSSINGS}")

    def numbers_of(self, names: Sequence[str]) -> Int[np.ndarray, " f"]:
        """Numbers of the faces ``names``; the last, of index -1, is NO_FACE."""
        return np.array([*map(self.names.index, names), NO_FACE])

    @property
    def flange(self) -> int:
        """Number of the face at which all light ends; an unused number without a flange."""
        return len(self.names) if self.flange_face is None else self.flange_face

    def goes_on(self, event: int | Int[np.ndarray, " n"]) -> bool | Bool[np.ndarray, " n"]:
        """True if rays reflected at ``event`` (from 0), or back in the cavity after it, are followed further."""
        return (self.events > _CROSSINGS) & (event + 1 < self.events)

    def away_at(self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """True where a surface with ``normals`` out of the material faces away from the origin of its own lens."""
        return faces_away(*(points, normals) if self.plate is None else self.plate.to_local(points, normals))

    def at_neighbour(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """True for points above z = 0 that are nearer to another lens of a plate than to the lit one."""
        if self.plate is None or self.plate.lit is None:
            return np.zeros(len(points), dtype=bool)
        beside: Bool[np.ndarray, " n"] = (self.plate.nearest(points) != self.plate.lit) & (points[:, 2] > 0.0)
        return beside

    def sorted(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Number of the face to which each point with this normal out of the material belongs, and its distance (mm).

        It is the nearest of its side; NO_FACE at or below z = 0. Of a face alone on its side the distance is left at 0.
        """
        if self.plate is not None:
            return self._sorted_on(self.plate, points, normals)
        above = points[:, 2] > 0.0
        away = faces_away(points, normals)
        numbers = np.full(len(points), NO_FACE)
        apart = np.zeros(len(points))
        passed = self.opening, None if self.end_mm is None else self.flange_face
        for side in (False, True):
            candidates = np.array([k for k, outward in enumerate(self.away) if outward == side and k not in passed])
            rows = np.nonzero(above & (away == side))[0]
            numbers[rows] = candidates[0]
            if len(candidates) > 1:
                places = points[rows] if self.end_mm is None else points[rows] * _ACROSS
                gaps = self._gaps(places)[candidates]
                numbers[rows] = candidates[np.argmin(gaps, axis=0)]
                slant = np.abs(np.sum(places * normals[rows], axis=1)) / np.linalg.norm(places, axis=1)
                apart[rows] = gaps.min(axis=0) * slant
        if self.flange_mm is not None:
            beyond = above & (np.hypot(points[:, 0], points[:, 1]) > self.flange_mm + _AT_FLANGE_MM)
            numbers[beyond] = self.flange
            apart[beyond] = 0.0
        if self.end_mm is not None:
            numbers[above & (np.abs(points[:, 1]) > self.end_mm - _AT_FLANGE_MM)] = self.flange
        return numbers, apart

    def _sorted_on(
        self, plate: PlateOfLenses, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """The same on a plate, by the faces of the lens nearest to each point."""
        kinds = self.of_kinds or (replace(self, plate=None),)
        nearest = plate.nearest(points)
        points, normals = plate.to_local(points, normals)
        numbers = np.full(len(points), NO_FACE)
        apart = np.zeros(len(points))
        for kind, rows in plate.of_kinds(nearest):
            numbers[rows], apart[rows] = kinds[kind].sorted(points[rows], normals[rows])
        return numbers, apart

    def _gaps(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "f n"]:
        """Radial distance (mm) of points above z = 0 from each face."""
        from scipy.ndimage import map_coordinates

        assert self.inverse_radii is not None
        radius = np.linalg.norm(points, axis=1)
        last = self.inverse_radii.shape[1] - 1
        place = 0.5 * last * (1.0 + points[:, :2] / (radius + points[:, 2])[:, None])
        inverse = np.stack([map_coordinates(table, place.T, order=1, mode="nearest") for table in self.inverse_radii])
        gaps: Float[np.ndarray, "f n"] = np.abs(1.0 / np.maximum(inverse, _FARTHEST) - radius)
        return gaps


USUAL_LENS = OpticalFaces()
