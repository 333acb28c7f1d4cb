"""Equal lamps together: the places and turns of a grid, a hexagon, a ring, a table, or a lattice without an end.

All stand on the plane z = 0, their axes along z, and every receiver sees the light of all. Receivers keep their places
about the origin, the middle of the lamps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi, sqrt
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from lensforge.spec.emitter_section import Turn
from lensforge.spec.part_section import BaseSection
from lensforge.spec.receiver_sections import AnyReceiver, CylinderReceiver, PlaneReceiver, SphereReceiver
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import Coordinate, Millimetres, Section, rounded_up
from lensforge.spec.target_sections import Side
from lensforge.surfaces.mirror_group import generators

Place = tuple[float, float]
_SAME = 1e-9  # relative: rounding of a place, and of the side of a receiver that is a lattice's period


@dataclass(frozen=True)
class Lamps:
    """Equal lamps: places (mm) of their axes on the plane z = 0, and turns (degrees) about these, from x towards y.

    ``period_mm``: width and height of the rectangle that a lattice without an end repeats; the lamps are those of one.
    """

    places_mm: tuple[Place, ...] = ((0.0, 0.0),)
    turns_deg: tuple[float, ...] = (0.0,)
    period_mm: tuple[float, float] | None = None

    def __len__(self) -> int:
        return len(self.places_mm)

    @property
    def alone(self) -> bool:
        """True for one lamp at the origin, as designs without ``[lamps]`` have it."""
        return self == ALONE

    @property
    def words(self) -> str:
        """Number of lamps, after the receivers that they light; empty for one alone."""
        if self.period_mm is None:
            return "" if self.alone else f", lit by {len(self)} lamps"
        return f", lit by a lattice without an end, {len(self)} in {self.period_mm[0]:g} × {self.period_mm[1]:.4g} mm"

    @property
    def reach_mm(self) -> float:
        """Distance of the farthest axis from the origin."""
        return max(hypot(*place) for place in self.places_mm)

    @property
    def from_afar(self) -> "Lamps":
        """The same as they are seen from far away, where all stand at one place."""
        return self if self.alone else Lamps(((0.0, 0.0),) * len(self), self.turns_deg)

    def has_mirrors(self, group: str) -> bool:
        """True where each mirror of a group takes the lamps to themselves: their light then has the lens's mirrors."""
        if group == "square" and self.period_mm is not None and self.period_mm[0] != self.period_mm[1]:
            return False
        places, turns = np.array(self.places_mm), np.array(self.turns_deg)
        own = self._as_rows(places, turns)
        mirrored = (self._as_rows(places @ mirror[:2, :2].T, -turns) for mirror in generators(group))
        return all(np.array_equal(each, own) for each in mirrored)

    def _as_rows(self, places: Float[np.ndarray, "n 2"], turns: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Places, of a lattice within its period, and turns within 360 degrees, rounded and in one order."""
        if self.period_mm is not None:
            places = np.round(places / self.period_mm, 6) % 1.0 * self.period_mm
        rows = np.round(np.column_stack([places, np.round(turns, 6) % 360.0]), 6) + 0.0
        ordered: Float[np.ndarray, "n 3"] = rows[np.lexsort(rows.T)]
        return ordered

    def _between(self) -> Float[np.ndarray, "m 2"]:
        """Ways (mm) from each lamp to every other one, those of a lattice's neighbouring periods included."""
        places = np.array(self.places_mm)
        ways = (places[:, None] - places[None]).reshape(-1, 2)
        ways = ways[np.arange(len(ways)) % (len(places) + 1) != 0]  # not to itself
        if self.period_mm is None:
            return np.asarray(ways)
        periods = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]) * np.array(self.period_mm)
        beside = (np.concatenate([ways, np.zeros((1, 2))])[:, None] + periods).reshape(-1, 2)
        apart: Float[np.ndarray, "m 2"] = beside[np.hypot(*beside.T) > 0.0]
        return apart

    def nearest_mm(self, square: bool = False) -> float:
        """Distance of the nearest two axes; along x or y, the larger of both, for ``square`` bases."""
        ways = np.abs(self._between())
        if not len(ways):
            return float("inf")
        turned = any(turn % 90.0 for turn in self.turns_deg)
        return float((ways.max(axis=1) if square and not turned else np.hypot(*ways.T)).min())


ALONE = Lamps()
_MOST = 2000  # lamps: 41 x 41 show what an endless lattice is
_Number = Annotated[int, Field(ge=1, le=_MOST)]


class LampsSection(Section):
    """Fields of every arrangement."""

    kind: str

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _are_few_enough(self) -> "LampsSection":
        if len(self.lamps) > _MOST:
            raise ValueError(f'{len(self.lamps)} lamps, at most {_MOST}; or kind = "endless"')
        return self


def _pair(pitch: Side) -> tuple[float, float]:
    return pitch if isinstance(pitch, tuple) else (pitch, pitch)


class GridLamps(LampsSection):
    """Rows and columns about the origin."""

    kind: Literal["grid"] = "grid"
    columns: _Number
    """Lamps along x."""
    rows: _Number
    """Lamps along y."""
    pitch_mm: Side
    """Distance of neighbouring axes; one number, or along x and along y."""

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        across, up = _pair(self.pitch_mm)
        x = [across * (number - 0.5 * (self.columns - 1)) for number in range(self.columns)]
        y = [up * (number - 0.5 * (self.rows - 1)) for number in range(self.rows)]
        return _unturned([(each, other) for other in y for each in x])


class HexagonLamps(LampsSection):
    """A lamp at the origin, and hexagons of them around it: 7 with one ring, 19 with two."""

    kind: Literal["hexagon"] = "hexagon"
    rings: Annotated[int, Field(ge=1, le=25)]
    """Hexagons around the middle lamp."""
    pitch_mm: Millimetres
    """Distance of neighbouring axes, along x and at 60 degrees to it."""

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        rings, up = self.rings, 0.5 * sqrt(3.0)
        steps = [(i, j) for j in range(-rings, rings + 1) for i in range(-rings, rings + 1) if abs(i + j) <= rings]
        return _unturned([(self.pitch_mm * (i + 0.5 * j), self.pitch_mm * up * j) for i, j in steps])


class RingLamps(LampsSection):
    """A ring about the origin; its first lamp is on +x."""

    kind: Literal["ring"] = "ring"
    count: _Number
    """Lamps in the ring."""
    diameter_mm: Millimetres
    """Diameter of the circle of their axes."""
    turned: bool = True
    """Turn each lamp with its place, so that its +x points away from the origin."""

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        turns = tuple(360.0 * number / self.count for number in range(self.count))
        directions = [complex(np.exp(1j * pi * turn / 180.0)) for turn in turns]
        places = tuple((0.5 * self.diameter_mm * each.real, 0.5 * self.diameter_mm * each.imag) for each in directions)
        return Lamps(places, turns if self.turned else (0.0,) * self.count)


class TableLamps(LampsSection):
    """Places and turns one by one."""

    kind: Literal["table"] = "table"
    places_mm: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=1, max_length=_MOST)]
    """Place (x, y) of each axis."""
    turns_deg: Annotated[tuple[Turn, ...], Field(max_length=_MOST)] = ()
    """Turn of each lamp about its axis, from x towards y; by default none is turned."""

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        return Lamps(self.places_mm, self.turns_deg or (0.0,) * len(self.places_mm))

    @model_validator(mode="after")
    def _each_has_its_turn(self) -> "TableLamps":
        if self.turns_deg and len(self.turns_deg) != len(self.places_mm):
            raise ValueError(f"turns_deg has {len(self.turns_deg)} numbers, places_mm {len(self.places_mm)} places")
        return self


class EndlessLamps(LampsSection):
    """A lattice without an end, as of a large backlight; its receivers are planes above it of one period each.

    A lamp stands on the origin. The period of a hexagonal lattice is ``pitch_mm`` wide, 1.732 times as high, and has
    two lamps.
    """

    kind: Literal["endless"] = "endless"
    lattice: Literal["rectangle", "hexagon"] = "rectangle"
    """Lattice: rows and columns, or each lamp with six neighbours."""
    pitch_mm: Side
    """Distance of neighbouring axes; one number, or of a rectangle along x and along y."""

    @property
    def lamps(self) -> Lamps:
        """Places and turns."""
        across, up = _pair(self.pitch_mm)
        if self.lattice == "rectangle":
            return Lamps(period_mm=(across, up))
        up *= sqrt(3.0)
        return Lamps(((0.0, 0.0), (0.5 * across, 0.5 * up)), (0.0, 0.0), (across, up))

    @model_validator(mode="after")
    def _hexagons_have_one_pitch(self) -> "EndlessLamps":
        if self.lattice == "hexagon" and isinstance(self.pitch_mm, tuple):
            raise ValueError("pitch_mm: a hexagonal lattice has one; give one number")
        return self


def _unturned(places: Sequence[Place]) -> Lamps:
    return Lamps(tuple(places), (0.0,) * len(places))


AnyLamps = Annotated[GridLamps | HexagonLamps | RingLamps | TableLamps | EndlessLamps, Field(discriminator="kind")]


def lamps_of(section: LampsSection | None) -> Lamps:
    """The lamps of a section; without one, one lamp."""
    return ALONE if section is None else section.lamps


def require_together(
    lamps: Lamps, limits: ConstraintsSection, base: BaseSection, receivers: Sequence[AnyReceiver], lenses: int
) -> None:
    """Raise ``ValueError`` where lamps overlap, a receiver is between them, or ``photometry.lenses`` counts them."""
    _require_apart(lamps, limits, base)
    for receiver in receivers:
        _require_seen_by(receiver, lamps, limits)
    if lenses != 1:
        raise ValueError(f"photometry.lenses = {lenses}: [lamps] are {len(lamps)} already; leave out one of the two")


def _require_apart(lamps: Lamps, limits: ConstraintsSection, base: BaseSection) -> None:
    """Raise ``ValueError`` where two lenses, or their bases, would overlap."""
    lens_mm = 2.0 * limits.max_radius_mm
    if lamps.nearest_mm() < lens_mm * (1.0 - _SAME):
        raise ValueError(
            f"lamps: the nearest two stand {lamps.nearest_mm():.6g} mm apart, lenses of constraints.max_radius_mm = "
            f"{limits.max_radius_mm:g} overlap; allowed: at least {rounded_up(lens_mm)}, or a smaller lens"
        )
    if base.kind in ("none", "step"):
        return
    square = base.kind == "square" and base.flange_diameter_mm is None
    wide_mm = base.side_mm if square else base.flange_diameter_mm or base.diameter_mm
    if lamps.nearest_mm(square) < wide_mm * (1.0 - _SAME):
        raise ValueError(
            f"lamps: the nearest two stand {lamps.nearest_mm(square):.6g} mm apart, their rims of base.kind = "
            f"{base.kind!r} are {wide_mm:g} mm wide; allowed: at least {rounded_up(wide_mm)}, or a smaller base"
        )


def _require_seen_by(receiver: AnyReceiver, lamps: Lamps, limits: ConstraintsSection) -> None:
    """Raise ``ValueError`` for a receiver between the lamps or inside a lens, or one that a lattice cannot light."""
    if lamps.period_mm is not None:
        _require_period(receiver, lamps.period_mm)
    for place in lamps.places_mm:
        away_mm = _clear_mm(receiver, place)
        if away_mm <= limits.max_radius_mm:
            raise ValueError(
                f"receivers: {receiver.name or receiver.kind!r} is between the lamps: that at ({place[0]:.4g}, "
                f"{place[1]:.4g}) mm has {away_mm:.4g} mm to it, its lens needs more than constraints.max_radius_mm = "
                f"{limits.max_radius_mm:g}; move or turn the receiver"
            )
    if isinstance(receiver, PlaneReceiver) and receiver.window_mm not in (None, receiver.size):
        raise ValueError("receivers.window_mm: of lamps together the whole receiver counts; leave it out")


def _clear_mm(receiver: AnyReceiver, place: Place) -> float:
    """Distance from the middle of a lens to a receiver, on its lit side; infinite for the far field."""
    if isinstance(receiver, PlaneReceiver):
        normal = np.array(receiver.facing) / np.linalg.norm(receiver.facing)
        return float(normal @ (np.array(receiver.centre_mm) - (*place, 0.0)))
    if isinstance(receiver, CylinderReceiver | SphereReceiver):
        return receiver.radius_mm - float(np.linalg.norm(np.array(receiver.centre_mm) - (*place, 0.0)))
    return float("inf")


def _require_period(receiver: AnyReceiver, period: tuple[float, float]) -> None:
    """Refuse all but a level plane of one period."""
    level = isinstance(receiver, PlaneReceiver) and not any(receiver.facing[:2]) and receiver.rotation_deg == 0.0
    if not level or not np.allclose(receiver.size, period, rtol=1e-6, atol=0.0):
        raise ValueError(
            f'receivers: {receiver.name or receiver.kind!r}: lamps of kind = "endless" light level planes that are one '
            f"period of the lattice, {period[0]:.7g} x {period[1]:.7g} mm; take such a plane, or lamps of another kind"
        )
