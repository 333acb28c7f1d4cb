"""A mould of two halves that opens along the axis of the lens: what each half releases, and the parting line.

As the halves open, a point moves along z, and so stays at its azimuth and its distance from the axis: whether the body
is in its way is seen in the section on one side of the axis. A half draws a place that faces it, with nothing of the
body in between. What is upright to the tolerance of angles is no undercut.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped
from scipy.spatial import cKDTree

from lensforge.cad.boundary import Boundary, Pair, TrimmedFace
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.flange import FlangeRing, flange_heights_mm, ring_of
from lensforge.cad.outline import FULL_TURN, circle
from lensforge.cad.part_limits import ANGLE_TOLERANCE_DEG
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Corner, Plan, base_corners, lay_out, rim_directions, rim_points, rim_radius
from lensforge.cad.plate_layout import PlateLayout, layout_of
from lensforge.cad.wall import largest_ball
from lensforge.scene.lens import Lens
from lensforge.shop.check_measures import (
    BASE,
    FLANGE,
    PLATE,
    InscribedBall,
    Mould,
    MouldedFace,
    PartingLine,
    UprightCylinder,
)
from lensforge.shop.mould_facts import plastic_of

_AZIMUTHS = 192  # of the points of a face
_ALONG = 512  # points of a face on a meridian
_ON_EDGE = 64  # points between two corners
_UPRIGHT = float(np.sin(np.deg2rad(ANGLE_TOLERANCE_DEG)))
_SAME_MM = 1e-6
_BALL = 360, 96  # azimuths and points of each face, about as far apart all over
_OF_PLATE = PartingLine(places=(PLATE,), radius_mm=None, low_mm=0.0, high_mm=0.0)

_Values = Float[np.ndarray, "a m"]
_Names = Shaped[np.ndarray, " n"]
_Marks = Bool[np.ndarray, "_ _"]


@dataclass(frozen=True, eq=False)
class Moulding:
    """A lens between the halves of its mould: ``plan`` with its base and flange, ``around`` it the plate, if any."""

    lens: Lens
    envelope: Boundary[Patch]
    plan: Plan[Patch]
    around: list[Corner]

    @staticmethod
    def of(lens: Lens, pair: Pair[Patch]) -> "Moulding":
        """The mould of ``lens`` by its fitted faces, with its base, flange or plate; a base from a file is left out."""
        plan = replace(lay_out(*pair, base_with_room(lens)), rim_flange=ring_of(lens, pair[1]))
        layout = layout_of(lens)
        around = [] if layout is None else _around(plan, layout, lens.spec.constraints.max_radius_mm)
        return Moulding(lens, pair[1], plan, around)

    @cached_property
    def halves(self) -> "TwoHalves":
        """Halves of the mould, and the places that each releases."""
        return TwoHalves.of(pieces_of(self.plan, self.around))

    def mould(self) -> Mould:
        """The record of the mould."""
        lens = self.lens
        plate = lens.spec.plate
        ring = self.plan.rim_flange
        pieces = pieces_of(self.plan, self.around, *_BALL)
        diameter_mm, centre = largest_ball(np.concatenate([piece.points for piece in pieces], axis=1))
        plastic = plastic_of(lens.spec.lens.material)
        sides = {PLATE: plate is not None, FLANGE: ring is not None, BASE: self.plan.base.kind != "none"}
        return Mould(
            faces=self.halves.faces([name for name in lens.surfaces if lens.body.face(name).is_optical]),
            parting=self.halves.parting() if plate is None else _OF_PLATE,
            thickest=InscribedBall(diameter_mm=diameter_mm, centre_mm=tuple(centre.tolist())),
            upright=() if ring is None else tuple(_upright_beside(ring, *flange_heights_mm(self.envelope))),
            gate=next((name for name, present in sides.items() if present), None),
            cooling_s=None if plastic is None else plastic.cooling_s(diameter_mm),
        )

    def undercut(self, name: str, points: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
        """True where neither half releases the face ``name``, at the places nearest to ``points`` (mm)."""
        piece, drawn = next(pair for pair in self.halves.drawn() if pair[0].name == name)
        within = piece.areas > 0.0
        _, nearest = cKDTree(piece.points[within]).query(points)
        return np.asarray(drawn.undercut[within][nearest])


def _upright_beside(ring: FlangeRing, wall_mm: float, exit_mm: float) -> Iterator[UprightCylinder]:
    """The upright cylinder from the wall's highest place to the flange, and from there to the exit rim's lowest."""
    for low, high in ((wall_mm, ring.low_mm), (ring.high_mm, exit_mm)):
        if high - low > _SAME_MM:
            yield UprightCylinder(radius_mm=ring.inner_mm, low_mm=low, high_mm=high)


def _around(plan: Plan[Patch], layout: PlateLayout, lens_mm: float) -> list[Corner]:
    """Corners of the plate around a lens of at most ``lens_mm`` radius, as far as they can hide it from a half."""
    rim = rim_radius(plan.cavity)
    scale = layout.bore_scale(rim_points(plan.cavity))
    thickness_mm = layout.plate.thickness_mm
    wide = circle(lens_mm + thickness_mm).radius
    foot = Corner(lambda azimuths: scale * rim(azimuths), thickness_mm, "")
    return [Corner(wide, 0.0, ""), Corner(wide, thickness_mm, ""), foot]


@dataclass(frozen=True, eq=False)
class SectionPiece:
    """A stretch of the sections at even azimuths, from the axis around the outside to the cavity.

    ``points`` (mm); ``facing``: z of the unit normal out of the material; ``areas``: shares of the face's own area that
    the points stand for. Both are 0 for pieces that are no optical face.
    """

    name: str
    points: Float[np.ndarray, "a m 3"]
    facing: _Values
    areas: _Values

    @property
    def across(self) -> _Values:
        """Distance (mm) from the axis."""
        return np.asarray(np.hypot(self.points[..., 0], self.points[..., 1]))

    @property
    def height(self) -> _Values:
        """Height (mm)."""
        return np.asarray(self.points[..., 2])


def pieces_of(
    plan: Plan[Patch], plate: Sequence[Corner] = (), azimuths: int = _AZIMUTHS, along: int = _ALONG
) -> list[SectionPiece]:
    """The pieces of a body at ``azimuths`` azimuths, with ``along`` points of each face.

    ``plate``: corners of the plate around the lens, from the outer rim to the cavity's, in place of its base.
    """
    turn = np.linspace(0.0, FULL_TURN, azimuths, endpoint=False)
    outside = [piece for face in plan.envelope.of_material for piece in _pieces_of_face(face, plan, turn, along, 1)]
    inside = [piece for face in plan.cavity.of_material for piece in _pieces_of_face(face, plan, turn, along, -1)]
    corners = plate or base_corners(plan)[1:]
    chain = [outside[-1].points[:, -1:], *(_corner(corner, turn) for corner in corners), inside[-1].points[:, -1:]]
    name = PLATE if plate else BASE
    return [*outside, _upright(name, _filled(chain)), *(_turned_back(piece) for piece in reversed(inside))]


def _pieces_of_face(
    face: TrimmedFace[Patch], plan: Plan[Patch], turn: Float[np.ndarray, " a"], along: int, sense: int
) -> Iterator[SectionPiece]:
    """A face from the axis outwards; ``sense``: 1 where its outward normal leaves the material."""
    shares = np.concatenate([[0.0], (np.arange(along) + 0.5) / along, [1.0]])
    low, high = face.domain.radii(turn)
    radius = low[:, None] + (high - low)[:, None] * shares
    chart = radius[..., None] * rim_directions(turn)[:, None, :2]
    points, along_x, along_y = (
        tangent.reshape(*radius.shape, 3) for tangent in face.shape.tangents(chart.reshape(-1, 2))
    )
    normal = np.cross(along_x, along_y)
    element = np.linalg.norm(normal, axis=-1)
    if face.is_flange and plan.rim_flange is not None:
        corners = (Corner(circle(radius_mm).radius, -z, "") for radius_mm, z in plan.rim_flange.corners.tolist())
        yield _upright(FLANGE, _filled([points[:, :1], *(_corner(corner, turn) for corner in corners), points[:, -1:]]))
        return
    areas = element * radius * (high - low)[:, None]
    areas[:, [0, -1]] = 0.0  # the ends alone stand for nothing
    yield SectionPiece(face.name, points, sense * normal[..., 2] / element, areas / areas.sum())


def _corner(corner: Corner, turn: Float[np.ndarray, " a"]) -> Float[np.ndarray, "a 1 3"]:
    points = corner.radius(turn)[:, None] * rim_directions(turn)
    points[:, 2] = -corner.depth_mm
    return np.asarray(points[:, None])


def _filled(chain: Sequence[Float[np.ndarray, "a 1 3"]]) -> Float[np.ndarray, "a k 3"]:
    """Points along a chain of corners, the last one included."""
    share = (np.arange(_ON_EDGE) / _ON_EDGE)[:, None]
    return np.concatenate([*(start + share * (end - start) for start, end in pairwise(chain)), chain[-1]], axis=1)


def _upright(name: str, points: Float[np.ndarray, "a k 3"]) -> SectionPiece:
    return SectionPiece(name, points, *np.zeros((2, *points.shape[:2])))


def _turned_back(piece: SectionPiece) -> SectionPiece:
    return SectionPiece(piece.name, piece.points[:, ::-1], piece.facing[:, ::-1], piece.areas[:, ::-1])


@dataclass(frozen=True, eq=False)
class TwoHalves:
    """The sections of a body, and which of their points are free of the body above and below."""

    pieces: list[SectionPiece]
    free_above: list[_Marks]
    free_below: list[_Marks]

    @staticmethod
    def of(pieces: list[SectionPiece]) -> "TwoHalves":
        """The sections of ``pieces``, and what each half sees of them."""
        across, height = (np.concatenate([getattr(piece, name) for piece in pieces], axis=1) for name in _OF_SECTION)
        top, bottom = (np.stack(extremes) for extremes in zip(*map(_extremes, across, height), strict=True))
        ends = np.cumsum([piece.points.shape[1] for piece in pieces])[:-1]
        above, below = (np.split(free, ends, axis=1) for free in (height > top - _SAME_MM, height < bottom + _SAME_MM))
        return TwoHalves(pieces, above, below)

    def drawn(self) -> "Iterator[tuple[SectionPiece, _Drawn]]":
        """Each piece, and the halves that release its points."""
        for piece, above, below in zip(self.pieces, self.free_above, self.free_below, strict=True):
            yield piece, _Drawn.of(piece, above, below)

    def faces(self, names: Sequence[str]) -> dict[str, MouldedFace]:
        """The optical faces ``names``, in that order."""
        moulded = {piece.name: _moulded(piece, drawn) for piece, drawn in self.drawn() if piece.name in names}
        return {name: moulded[name] for name in names}

    def parting(self) -> PartingLine:
        """The parting line: where the body is widest; on an upright side, over its whole height."""
        across, height = (
            np.concatenate([getattr(piece, name) for piece in self.pieces], axis=1) for name in _OF_SECTION
        )
        names = np.concatenate([[piece.name] * piece.points.shape[1] for piece in self.pieces])
        widest = across >= across.max(axis=1, keepdims=True) - _SAME_MM
        at = dict.fromkeys(names[np.flatnonzero(widest.any(axis=0))].tolist())
        heights = [_widest_heights(*section, names) for section in zip(across, height, widest, strict=True)]
        low, high = float(min(height[0] for height in heights)), float(max(height[1] for height in heights))
        return PartingLine(places=tuple(at), radius_mm=float(across.max()), low_mm=low, high_mm=high)


_OF_SECTION = "across", "height"


def _extremes(across: Float[np.ndarray, " n"], height: Float[np.ndarray, " n"]) -> tuple[Any, Any]:
    """Highest and lowest height of the section at each of its distances from the axis."""
    step = np.diff(across)
    way = np.where(np.abs(step) <= _UPRIGHT * np.hypot(step, np.diff(height)), 0.0, np.sign(step))
    starts = np.flatnonzero(np.diff(way, prepend=np.nan) != 0.0)
    top, bottom = np.full_like(across, -np.inf), np.full_like(across, np.inf)
    for start, end in pairwise([*starts.tolist(), len(way)]):
        if way[start] == 0.0:
            continue
        rows = slice(start, end + 1)
        known = across[rows], height[rows]
        rising = known if way[start] > 0.0 else (known[0][::-1], known[1][::-1])
        top = np.maximum(top, np.interp(across, *rising, left=-np.inf, right=-np.inf))
        bottom = np.minimum(bottom, np.interp(across, *rising, left=np.inf, right=np.inf))
    return top, bottom


class _Drawn(NamedTuple):
    """Points of a piece that the upper half releases, and those that neither does; the lower half releases the rest."""

    upper: _Marks
    undercut: _Marks

    @staticmethod
    def of(piece: SectionPiece, free_above: _Marks, free_below: _Marks) -> "_Drawn":
        facing = piece.facing
        above = free_above & (facing >= -_UPRIGHT)
        below = free_below & (facing <= _UPRIGHT)
        undercut = ~(above | below) & (np.abs(facing) > _UPRIGHT) & (piece.areas > 0.0)
        return _Drawn(above & ((facing > 0.0) | ~below), undercut)


def _moulded(piece: SectionPiece, drawn: _Drawn) -> MouldedFace:
    facing = piece.facing
    areas = piece.areas
    released = ~drawn.undercut
    heights = piece.height[drawn.undercut]
    least = 0.0 if facing.min() < 0.0 < facing.max() else float(np.abs(facing[released]).min(initial=1.0))
    return MouldedFace(
        upper_fraction=float(areas[drawn.upper].sum()),
        lower_fraction=float(areas[released & ~drawn.upper].sum()),
        undercut_fraction=float(areas[drawn.undercut].sum()),
        undercut_heights_mm=(float(heights.min()), float(heights.max())) if heights.size else None,
        draft_deg=float(np.degrees(np.arcsin(least))) if released.any() else None,
    )


def _widest_heights(
    across: Float[np.ndarray, " n"], height: Float[np.ndarray, " n"], widest: Bool[np.ndarray, " n"], names: _Names
) -> tuple[float, float]:
    """Heights between which a section is widest, refined within a face by a parabola through three points."""
    k = int(np.argmax(across))
    low = float(height[widest].min())
    high = float(height[widest].max())
    near = slice(k - 1, k + 2)
    rises = np.diff(height[near])
    straight = high - low > _SAME_MM or names[k] in (BASE, FLANGE)
    if straight or len(set(names[near])) > 1 or len(rises) < 2 or rises[0] * rises[1] <= 0.0:
        return low, high
    bend, slope, _ = np.polyfit(height[near] - height[k], across[near], 2).tolist()
    place = height[k] + float(np.clip(-0.5 * slope / bend, *np.sort(height[near][[0, 2]] - height[k])))
    return place, place
