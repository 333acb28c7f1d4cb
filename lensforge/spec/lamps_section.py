"""Lamps together: the places and turns of a grid, a hexagon, a ring, a table, or an infinite lattice.

All stand on the plane z = 0, their axes along z, but for those of a table, which may have heights and aims. Every
receiver sees the light of all. Receivers keep their places about the origin, the middle of the lamps. All have one
lens, or lenses of several kinds by place.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import atan2, degrees, hypot, pi, sqrt
from typing import Annotated, Literal, Self

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field

from lensforge.optics.pose import ALONG_Z, ORIGIN, Vector
from lensforge.public import public
from lensforge.spec.emitter_section import Turn
from lensforge.spec.lamp_places import KindOfPlace, Lamp, LampKind, aimed_from, in_grid, in_hexagon, kinds_of
from lensforge.spec.spec_section import Coordinate, Millimetres, Section, check
from lensforge.spec.target_sections import Side
from lensforge.surfaces.mirror_group import generators

Place = tuple[float, float]


@dataclass(frozen=True)
class Lamps:
    """Lamps with equal LEDs, each at its place.

    ``period_mm``: width and height of the rectangle that an infinite lattice repeats; the lamps are those of one.
    ``kinds``: two or more that share the lamps out, each with a lens of its own; none where all have the same lens.
    """

    lamps: tuple[Lamp, ...] = (Lamp(),)
    period_mm: tuple[float, float] | None = None
    kinds: tuple[LampKind, ...] = ()

    @staticmethod
    def level(
        places_mm: Iterable[Place], turns_deg: Iterable[float] = (), period_mm: tuple[float, float] | None = None
    ) -> "Lamps":
        """Lamps on the plane z = 0, their axes along z; turned (degrees), from x towards y, where turns are given."""
        places = tuple(places_mm)
        turns = tuple(turns_deg) or (0.0,) * len(places)
        return Lamps(
            tuple(Lamp((*place, 0.0), ALONG_Z, turn) for place, turn in zip(places, turns, strict=True)), period_mm
        )

    def __len__(self) -> int:
        return len(self.lamps)

    @property
    def places_mm(self) -> tuple[Place, ...]:
        """Places (x, y) of their origins."""
        return tuple(lamp.place_mm[:2] for lamp in self.lamps)

    @property
    def turns_deg(self) -> tuple[float, ...]:
        """Turns (degrees) about their axes, from x towards y."""
        return tuple(lamp.turn_deg for lamp in self.lamps)

    @property
    def is_single(self) -> bool:
        """True for one lamp at the origin, as designs without ``[lamps]`` have it."""
        return self == ALONE

    @property
    def posed(self) -> bool:
        """True where a lamp has a height of its own, or an axis that is not along z."""
        return any(lamp.place_mm[2] != 0.0 or lamp.axis != ALONG_Z for lamp in self.lamps)

    @property
    def phrase(self) -> str:
        """Number of lamps, after the receivers that they light; empty for one alone."""
        if self.period_mm is None:
            kinds = f" with lenses of {len(self.kinds)} kinds" if self.kinds else ""
            return "" if self.is_single else f", lit by {len(self)} lamps{kinds}"
        return f", lit by an infinite lattice, {len(self)} in {self.period_mm[0]:g} × {self.period_mm[1]:.4g} mm"

    @property
    def whole(self) -> str:
        """Words on all of them, whose light is told together; empty for one alone."""
        if self.period_mm is not None:
            return "of all lamps of the endless lattice"
        return "" if self.is_single else f"of {len(self)} lamp{'s' * (len(self) > 1)}"

    @property
    def reach_mm(self) -> float:
        """Distance of the farthest lamp from the origin."""
        return max(hypot(*lamp.place_mm) for lamp in self.lamps)

    @property
    def in_far_field(self) -> "Lamps":
        """The same as they are seen from far away, where all are at one place."""
        together = tuple(lamp._replace(place_mm=ORIGIN) for lamp in self.lamps)
        return self if self.is_single else replace(self, lamps=together, period_mm=None)

    def of_kind(self, kind: LampKind) -> "Lamps":
        """The lamps that have one lens."""
        return Lamps(tuple(self.lamps[number] for number in kind.numbers))

    @property
    def kind_of_each(self) -> tuple[int, ...]:
        """Number of its kind, of each lamp; 0 where all have the same lens."""
        numbers = {number: k for k, kind in enumerate(self.kinds) for number in kind.numbers}
        return tuple(numbers.get(number, 0) for number in range(len(self)))

    @property
    def shares_of_rays(self) -> tuple[float, ...]:
        """Share of the rays for each kind: by the root of its lamps, which all see each ray: the least noise."""
        roots = [sqrt(len(kind.numbers)) for kind in self.kinds]
        return tuple(root / sum(roots) for root in roots)

    def has_mirrors(self, group: str) -> bool:
        """True where each mirror of a group takes the lamps to themselves: their light then has the lens's mirrors.

        Of several kinds each lens has the mirrors of its kind.
        """
        swaps = any(mirror[0, 0] == 0.0 for mirror in generators(group))
        if swaps and self.period_mm is not None and self.period_mm[0] != self.period_mm[1]:
            return False
        return all(self._is_mirrored(kind, group) for kind in self.kinds or (LampKind("", tuple(range(len(self)))),))

    def _is_mirrored(self, kind: LampKind, group: str) -> bool:
        lamps = self.of_kind(kind).lamps
        places = np.array([lamp.place_mm for lamp in lamps])
        axes = np.array([lamp.axis for lamp in lamps])
        as_it_is = self._as_rows(places, axes, [lamp.turn_deg for lamp in lamps])
        for mirror in generators(group):
            axis_deg = 0.5 * degrees(atan2(mirror[1, 0], mirror[0, 0]))
            turns = [kind.mirrored_deg(lamp.turn_deg, axis_deg) for lamp in lamps]
            if not np.array_equal(self._as_rows(places @ mirror.T, axes @ mirror.T, turns), as_it_is):
                return False
        return True

    def _as_rows(
        self, places: Float[np.ndarray, "n 3"], axes: Float[np.ndarray, "n 3"], turns_deg: Sequence[float]
    ) -> Float[np.ndarray, "n 7"]:
        """Places, of a lattice within its period, and with turns within 360 degrees, rounded and in one order."""
        if self.period_mm is not None:
            places = np.column_stack([np.round(places[:, :2] / self.period_mm, 6) % 1.0 * self.period_mm, places[:, 2]])
        rows = np.round(np.column_stack([places, np.round(turns_deg, 6) % 360.0, axes]), 6) + 0.0
        return rows[np.lexsort(rows.T)]

    def _between(self) -> tuple[Int[np.ndarray, "2 m"], Float[np.ndarray, "m 3"]]:
        """Numbers of each lamp and of every other one, and the way (mm) to it; in a lattice also to those around."""
        places = np.array([lamp.place_mm for lamp in self.lamps])
        around = (0,) if self.period_mm is None else (-1, 0, 1)
        periods = np.array([(i, j, 0.0) for i in around for j in around]) * np.array([*(self.period_mm or (0, 0)), 0.0])
        one, other, period = np.indices((len(places), len(places), len(periods))).reshape(3, -1)
        apart = (one != other) | periods.any(axis=1)[period]
        ways = places[other] - places[one] + periods[period]
        return np.stack([one, other])[:, apart], ways[apart]

    def nearest_mm(self) -> float:
        """Distance of the nearest two lamps."""
        return float(np.linalg.norm(self._between()[1], axis=1).min(initial=np.inf))

    def widest_square_mm(self) -> float:
        """Side of the largest square bases, turned as the lamps are, of which none overlap.

        Two squares are apart if they are along a side of one, or along the way from one to the other.
        """
        pairs, ways = self._between()
        lengths = np.linalg.norm(ways, axis=1)
        near = lengths <= 2.0 * lengths.min(initial=np.inf)  # those farther apart have room for larger ones
        sides = np.array([lamp.pose.directions(np.eye(3)[:2]) for lamp in self.lamps])[pairs[:, near]]
        ways = ways[near]
        axes = np.concatenate([*np.moveaxis(sides, 2, 1), ways[None] / lengths[near, None]])
        extents = np.abs(np.einsum("ank,pnsk->anps", axes, sides)).sum(axis=(2, 3))
        widths = 2.0 * np.abs(np.einsum("ank,nk->an", axes, ways)) / np.maximum(extents, 1e-12)
        return float(widths.max(axis=0).min(initial=np.inf))


ALONE = Lamps()
_MOST = 2000  # lamps: 41 x 41 show what an endless lattice is
_MOST_KINDS = 7
_Number = Annotated[int, Field(ge=1, le=_MOST)]
_Kinds = Literal["one", "place"]
_Rings = Annotated[int, Field(ge=1, le=3)]
_KindName = Annotated[str, Field(pattern="^[a-z][a-z0-9_]{0,15}$")]


@public
class LampsSection(Section):
    """Fields of every arrangement."""

    kind: str

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        raise NotImplementedError

    @check
    def _can_be(self) -> None:
        if len(self.lamps) > _MOST:
            raise ValueError(f'{len(self.lamps)} lamps, at most {_MOST}; or kind = "endless"')

    @property
    def of_one_kind(self) -> Self:
        """The same places, where all lamps have one lens."""
        kinds = type(self).model_fields.get("kinds")
        return self if kinds is None else self.changed(kinds=kinds.default)

    def of_numbers(self, numbers: Sequence[int]) -> "TableLamps":
        """Some of the lamps, by their numbers, with one lens."""
        places, axes, turns = zip(*(self.lamps.lamps[number] for number in numbers), strict=True)
        aims = [tuple(np.add(place, axis).tolist()) for place, axis in zip(places, axes, strict=True)]
        sides = [aimed_from(ORIGIN, axis)[1] for axis in axes]
        return TableLamps(places_mm=places, aims_mm=aims, turns_deg=tuple(np.subtract(turns, sides).tolist()))


def _by_place(places: Sequence[Place], kinds_of_places: Sequence[KindOfPlace]) -> Lamps:
    """Lamps whose lenses differ by place. Raises ``ValueError`` where all places are of one kind."""
    names, turns, mirrors = (tuple(values) for values in zip(*kinds_of_places, strict=True))
    if len(set(names)) == 1:
        raise ValueError(f'kinds = "place": all {len(places)} lamps are of the kind {names[0]!r}; leave it out')
    return replace(Lamps.level(places, turns), kinds=kinds_of(places, names, mirrors))


def _pair(pitch: Side) -> tuple[float, float]:
    return pitch if isinstance(pitch, tuple) else (pitch, pitch)


@public
class LampsWithRim(LampsSection):
    """Lamps in an arrangement with a rim, along which they may have other lenses."""

    kinds: _Kinds = Field(
        default="one",
        description='Lenses: "one" for all lamps, or "place": other ones along the rim and at the corners, turned '
        "to face outwards.",
    )
    rim_rings: _Rings = Field(
        default=1,
        description="Rings of places, from the rim inwards, with a lens of their own for sides and one for corners.",
    )


@public
class GridLamps(LampsWithRim):
    """Rows and columns about the origin."""

    kind: Literal["grid"] = "grid"
    columns: _Number = Field(description="Lamps along x.")
    rows: _Number = Field(description="Lamps along y.")
    pitch_mm: Side = Field(description="Distance of neighbouring axes; one number, or along x and along y.")

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        across, up = _pair(self.pitch_mm)
        x = [across * (number - 0.5 * (self.columns - 1)) for number in range(self.columns)]
        y = [up * (number - 0.5 * (self.rows - 1)) for number in range(self.rows)]
        places = [(column_x, row_y) for row_y in y for column_x in x]
        if self.kinds == "one":
            return Lamps.level(places)
        size = self.columns, self.rows
        return _by_place(
            places, [in_grid(i, j, *size, self.rim_rings) for j in range(self.rows) for i in range(self.columns)]
        )


@public
class HexagonLamps(LampsWithRim):
    """A lamp at the origin, and hexagons of them around it: 7 with one ring, 19 with two."""

    kind: Literal["hexagon"] = "hexagon"
    rings: Annotated[int, Field(ge=1, le=25)] = Field(description="Hexagons around the middle lamp.")
    pitch_mm: Millimetres = Field(description="Distance of neighbouring axes, along x and at 60 degrees to it.")

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        rings = self.rings
        up = 0.5 * sqrt(3.0)
        steps = [(i, j) for j in range(-rings, rings + 1) for i in range(-rings, rings + 1) if abs(i + j) <= rings]
        places = [(self.pitch_mm * (i + 0.5 * j), self.pitch_mm * up * j) for i, j in steps]
        if self.kinds == "one":
            return Lamps.level(places)
        return _by_place(places, [in_hexagon(i, j, rings, self.rim_rings) for i, j in steps])


@public
class RingLamps(LampsSection):
    """A ring about the origin; its first lamp is on +x."""

    kind: Literal["ring"] = "ring"
    count: _Number = Field(description="Lamps in the ring.")
    diameter_mm: Millimetres = Field(description="Diameter of the circle of their axes.")
    turned: bool = Field(
        default=True, description="Turn each lamp with its place, so that its +x points away from the origin."
    )

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        turns = [360.0 * number / self.count for number in range(self.count)]
        directions = [complex(np.exp(1j * pi * turn / 180.0)) for turn in turns]
        places = [
            (0.5 * self.diameter_mm * direction.real, 0.5 * self.diameter_mm * direction.imag)
            for direction in directions
        ]
        return Lamps.level(places, turns if self.turned else ())


_TablePlace = tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Coordinate]
_Point = tuple[Coordinate, Coordinate, Coordinate]


@public
class TableLamps(LampsSection):
    """Places and turns one by one; also lamps on poles, each with its height and aim."""

    kind: Literal["table"] = "table"
    places_mm: Annotated[tuple[_TablePlace, ...], Field(min_length=1, max_length=_MOST)] = Field(
        description="Place (x, y) or (x, y, z) of each lamp; z, along which lamps shine, is 0 where it is left out."
    )
    aims_mm: Annotated[tuple[_Point, ...], Field(max_length=_MOST)] = Field(
        default=(),
        description="Point (x, y, z) at which the axis of each lamp is aimed; by default all axes are along z. A "
        "tilted lamp is turned so that its +x lies in the tilt direction.",
    )
    turns_deg: Annotated[tuple[Turn, ...], Field(max_length=_MOST)] = Field(
        default=(),
        description="Turn of each lamp about its axis, from x towards y, from there on; by default none is turned.",
    )
    kinds: Annotated[tuple[_KindName, ...], Field(max_length=_MOST)] = Field(
        default=(), description='Lens of each lamp, by a name such as "wide"; by default all have one lens.'
    )

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        places: list[Vector] = [(*place, 0.0)[:3] for place in self.places_mm]
        aims = self.aims_mm or [None] * len(places)
        turns = self.turns_deg or (0.0,) * len(places)
        lamps = []
        for place, aim, turn in zip(places, aims, turns, strict=True):
            axis, side = (ALONG_Z, 0.0) if aim is None else aimed_from(place, aim)
            lamps.append(Lamp(place, axis, turn + side))
        flat = [place[:2] for place in places]
        return Lamps(tuple(lamps), kinds=kinds_of(flat, self.kinds, [""] * len(self.kinds)))

    @check
    def _can_be(self) -> None:
        lists = (
            ("turns_deg", self.turns_deg, "numbers"),
            ("aims_mm", self.aims_mm, "points"),
            ("kinds", self.kinds, "names"),
        )
        for field, given, description in lists:
            if given and len(given) != len(self.places_mm):
                raise ValueError(f"{field} has {len(given)} {description}, places_mm {len(self.places_mm)} places")
        for number, (aim, place) in enumerate(zip(self.aims_mm, self.places_mm, strict=False)):
            if aim == (*place, 0.0)[:3]:
                raise ValueError(f"aims_mm.{number} = {aim}: is the place of the lamp; give a point that it shines at")
        if self.kinds and not 2 <= len(set(self.kinds)) <= _MOST_KINDS:
            raise ValueError(f"kinds: {len(set(self.kinds))} names; give 2 to {_MOST_KINDS}, or leave them out for one")


@public
class EndlessLamps(LampsSection):
    """An infinite lattice, as of a large backlight; its receivers are planes above it of one period each.

    A lamp stands on the origin. The period of a hexagonal lattice is ``pitch_mm`` wide, 1.732 times as high, and has
    two lamps.
    """

    kind: Literal["endless"] = "endless"
    lattice: Literal["rectangle", "hexagon"] = Field(
        default="rectangle", description="Lattice: rows and columns, or each lamp with six neighbours."
    )
    pitch_mm: Side = Field(
        description="Distance of neighbouring axes; one number, or of a rectangle along x and along y."
    )

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        across, up = _pair(self.pitch_mm)
        if self.lattice == "rectangle":
            return Lamps(period_mm=(across, up))
        up *= sqrt(3.0)
        return Lamps.level([(0.0, 0.0), (0.5 * across, 0.5 * up)], period_mm=(across, up))

    @check
    def _hexagons_have_one_pitch(self) -> None:
        if self.lattice == "hexagon" and isinstance(self.pitch_mm, tuple):
            raise ValueError("pitch_mm: a hexagonal lattice has one; give one number")


AnyLamps = Annotated[GridLamps | HexagonLamps | RingLamps | TableLamps | EndlessLamps, Field(discriminator="kind")]


def lamps_of(section: LampsSection | None) -> Lamps:
    """The lamps of a section; without one, one lamp."""
    return ALONE if section is None else section.lamps
