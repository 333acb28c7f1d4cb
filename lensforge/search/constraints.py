"""Constraints on a lens: the paper's three, Eqs. (10) to (14), and optional ones; their augmented Lagrangian.

The paper's g1 keeps the cavity clear, g2 the wall thick, g3 the lens small; the wall is the distance between the faces,
not along a ray, which a steep face makes longer. Optionally no concave region is tighter than the ball that mills it,
and no meridian than the nose that turns it (curvature alone: the gouge test of ``check`` is global), and each face has
a draft, so that a mould opens along the axis; no edge is sharper than asked; the wall is nowhere too thick, the lens
not too high, and the cavity clear of a keep-out.

The search is a sequential unconstrained minimisation with multipliers. The paper takes the minimum over the hemisphere,
whose gradient sees one point. Here every point carries its own multiplier and Eq. (15) is averaged over the
hemisphere's solid angle: the same feasible set, reached more smoothly.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import cos, radians, sqrt

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree
from torch import Tensor

from lensforge.optics.face_roles import BODY, CAVITY
from lensforge.search.constraint_points import (
    PER_NODE,
    ChartOperator,
    ChartPoints,
    KeepOutExtent,
    RadiusJet,
    constraint_points,
    meridian_points,
    nearest_of,
    section_points,
)
from lensforge.search.design_result import CURVATURE, DRAFT, EDGE, FLANGE_ROOM, OPENING_ROOM, Limit, limits_of
from lensforge.search.face_fields import draft_sine, least_curvature, meridian_curvature, wall_mm
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.reflector_cup import OPEN_RAD

# The search aims this far inside the limits, relative to the cutter's curvature, and in degrees: its last steps still
# move by that much, and a peak lies between the points. Of lengths: ``ConstraintsSection.margin_mm``.
_CURVATURE_MARGIN = 0.01
_ANGLE_MARGIN_DEG = 0.1
_REACH = 0.01  # of the largest radius: so much above its limit a wall is still followed, where multipliers act
_FAR = 1.0  # a field, times its factor, where it does not hold
_STEEP = 0.5  # sine of the draft above which the field is constant: the arcsine's slope is infinite at the apex

WALL = "wall_margin_mm"
Field = Callable[..., Float[Tensor, " k"]]  # of the jets of its faces, and the points


@dataclass(frozen=True)
class Constraint(Limit):
    """A field over its faces that is at least 0 where the lens is feasible.

    ``unit`` is that of the field, of ``margin`` (how far inside the search aims) and of ``tolerance``. The field times
    ``factor`` is of order 1 for every constraint: lengths relative to the largest radius; angles and curvatures by the
    sag that they make over the narrowest function, relative to that radius.
    """

    field: Field
    factor: float
    margin: float

    @property
    def derivatives(self) -> bool:
        """True where the field needs derivatives of the radius: for curvatures, drafts, and where faces meet."""
        return self.unit != "mm" or self.kind == FLANGE_ROOM

    def of(self, jets: Mapping[str, RadiusJet], points: ChartPoints) -> Float[Tensor, " k"]:
        """The field at ``points`` of a lens with these ``jets`` of its faces.

        It takes the nearest of the faces that bound the cavity, and of those that bound the body. One of a single face
        holds where that face is the nearest, and one of a wall where the cavity has no opening.
        """
        if self.kind in (EDGE, FLANGE_ROOM, OPENING_ROOM):
            return self.field([jets[name] for name in self.names], points)
        if self.of_one_face:
            nearest, *hiding = (jets[name] for name in self.names)
            return self._visible(self.field(nearest, points), nearest, hiding)
        openings = [jets[face.name] for face in self.faces if face.is_open]
        closed = [face for face in self.faces if not face.is_open]
        groups = [[jets[face.name] for face in closed if face.before == medium] for medium in (CAVITY, BODY)]
        groups = [group for group in groups if group]
        if len(groups) == 1:
            return self.field(nearest_of([*groups[0], *openings]), points)
        inside, outside = map(nearest_of, groups)
        return self._visible(self.field(inside, outside, points), inside, openings)

    def _visible(self, field: Float[Tensor, " k"], jet: RadiusJet, hiding: Sequence[RadiusJet]) -> Float[Tensor, " k"]:
        """The field where ``jet`` is nearer than all ``hiding``; elsewhere far from its limit."""
        hidden = [jet.rho.detach() > hider.rho.detach() for hider in hiding]
        return field if not hidden else torch.where(torch.stack(hidden).any(dim=0), _FAR / self.factor, field)

    def tightened(self, by: float) -> "Constraint":
        """The constraint with a limit that is stricter by ``by`` (unit of the field)."""
        return replace(self, field=lambda *at: self.field(*at) - by) if by > 0.0 else self


def constraints_of(spec: Spec) -> tuple[Constraint, ...]:
    """The paper's three, and the optional ones that the spec has."""
    return tuple(_constraint(spec, limit) for limit in limits_of(spec))


def _constraint(spec: Spec, limit: Limit) -> Constraint:
    largest_mm = spec.constraints.max_radius_mm
    sigma = spec.lens.basis.detail_rad
    field: Field
    if limit.kind == CURVATURE:
        # the cutter touches a lens from the air side, a mould insert from the side of the lens body
        air = (-1 if limit.faces[0].before == CAVITY else 1) * (1 if spec.manufacture.cuts != "inserts" else -1)
        turned = spec.cutting(limit.faces[0].name) == "turned"
        curvature = meridian_curvature if turned else least_curvature
        field = partial(_curvature_left, curvature, air, 1.0 / limit.given)
        factor = 0.5 * sigma**2 * largest_mm
        margin = _CURVATURE_MARGIN / limit.given
    elif limit.kind == DRAFT:
        field = partial(_draft_left, limit.given, -1 if limit.faces[0].widens else 1)
        factor = radians(sigma)
        margin = _ANGLE_MARGIN_DEG
    elif limit.kind == EDGE:
        field = partial(_edge_left, limit.given)
        factor = radians(sigma)
        margin = _ANGLE_MARGIN_DEG
    else:
        field = _length_left(spec, limit)
        factor = 1.0 / largest_mm
        margin = spec.constraints.margin_mm
    return Constraint(**vars(limit), field=field, factor=factor, margin=margin)


def _length_left(spec: Spec, limit: Limit) -> Field:
    limits = spec.constraints
    reach_mm = limits.min_thickness_mm + _REACH * limits.max_radius_mm
    if limit.kind == "keep_out_clearance_mm":
        extent = KeepOutExtent.of(spec)
        return lambda face, points: face.rho - extent.at(points)

    def sine(points: ChartPoints) -> Float[Tensor, " k"]:
        return torch.sqrt(torch.clamp(1.0 - points.cosine**2, min=0.0))

    def above_cavity(face: RadiusJet, points: ChartPoints) -> Float[Tensor, " k"]:
        squared = (face.rho**2) * (1.0 - points.cosine**2)
        paraboloid = limits.cavity_height_mm / limits.cavity_radius_mm**2 * squared
        return paraboloid + face.rho * points.cosine - limits.cavity_height_mm

    fields: dict[str, Field] = {
        "cavity_clearance_mm": above_cavity,
        WALL: lambda inside, outside, points: wall_mm(inside, outside, points, reach_mm) - limit.given,
        "radius_margin_mm": lambda face, points: (
            limit.given - face.rho * (sine(points) if spec.lens.radius_about_axis else 1.0)
        ),
        "largest_wall_margin_mm": lambda inside, outside, points: limit.given - (outside.rho - inside.rho),
        FLANGE_ROOM: partial(_room_left, limit.given),
        OPENING_ROOM: lambda jets, points: torch.where(
            points.cosine > cos(OPEN_RAD), jets[0].rho - jets[1].rho - limit.given, limits.max_radius_mm
        ),
        "height_margin_mm": lambda face, points: limit.given - face.rho * points.cosine,
    }
    return fields[limit.kind]


def _curvature_left(
    of_face: Field, air: int, curvature: float, face: RadiusJet, points: ChartPoints
) -> Float[Tensor, " k"]:
    """Curvature (1/mm) left before a concave region is as tight as the ball, or a meridian as the nose."""
    return curvature + of_face(face, points, air)


def _draft_left(limit_deg: float, sense: int, face: RadiusJet, points: ChartPoints) -> Float[Tensor, " k"]:
    """Draft (deg) beyond the limit; ``sense``: -1 for a face that the lower half of the mould makes."""
    sine = torch.clamp(draft_sine(face, points, sense), -1.0 + 1e-6, _STEEP)
    return torch.rad2deg(torch.asin(sine)) - limit_deg


@dataclass(frozen=True)
class _BesideCrease:
    """Two faces where points of meridians lie beside their crease, at its place to first order, on the chart.

    ``radius``, ``slopes``: of each face there (mm), by its bend; ``scale``: of the chart there.
    """

    here: Bool[Tensor, " k"]
    scale: Float[Tensor, " k"]
    radius: Float[Tensor, "2 k"]
    slopes: tuple[Float[Tensor, "2 k"], Float[Tensor, "2 k"]]

    @staticmethod
    def of(rho: Float[Tensor, "2 k"], derivatives: Float[Tensor, "d 2 k"], points: ChartPoints) -> "_BesideCrease":
        """The faces of these radii (mm) and derivatives at ``points``."""
        by_x, by_y, xx, xy, yy = derivatives
        gap, along_x, along_y = (ends[1] - ends[0] for ends in (rho, by_x, by_y))
        steep = torch.clamp(along_x**2 + along_y**2, min=torch.finfo(gap.dtype).tiny)
        here = gap.detach().abs() <= points.spacing / PER_NODE * torch.sqrt(steep.detach())
        step = torch.where(here, -gap / steep, 0.0)
        dx, dy = step * along_x, step * along_y
        slopes = by_x + xx * dx + xy * dy, by_y + xy * dx + yy * dy
        radius = rho + 0.5 * ((by_x + slopes[0]) * dx + (by_y + slopes[1]) * dy)
        return _BesideCrease(here, 2.0 / (1.0 + (points.x + dx) ** 2 + (points.y + dy) ** 2), radius, slopes)


def _edge_left(limit_deg: float, jets: Sequence[RadiusJet], points: ChartPoints) -> Float[Tensor, " k"]:
    """Angle (deg) of the edge between the two nearest faces, less the limit; constant at points beside no edge."""
    rho = torch.stack([jet.rho for jet in jets])
    derivatives = torch.stack([jet.derivatives for jet in jets], dim=1)
    first = rho.detach().topk(2, dim=0, largest=False).indices
    crease = _BesideCrease.of(
        rho.gather(0, first), derivatives.gather(1, first.expand(len(derivatives), -1, -1)), points
    )
    g_x, g_y = (slope / (crease.scale * crease.radius) for slope in crease.slopes)
    cosine = (1.0 + g_x[0] * g_x[1] + g_y[0] * g_y[1]) * torch.rsqrt((1.0 + g_x**2 + g_y**2).prod(dim=0))
    angle = 180.0 - torch.rad2deg(torch.acos(torch.clamp(cosine, -1.0 + 1e-9, 1.0 - 1e-9)))
    return torch.where(crease.here, angle - limit_deg, 180.0)


def _room_left(needed_mm: float, jets: Sequence[RadiusJet], points: ChartPoints) -> Float[Tensor, " k"]:
    """Height (mm) beyond what a flange needs of the cylinder between wall and exit, as the lowest exit and the highest
    wall leave it; constant where points are beside neither of its creases.
    """
    wall, flange, above = jets

    def height(inner: RadiusJet, outer: RadiusJet) -> tuple[Bool[Tensor, " k"], Float[Tensor, " k"]]:
        rho, derivatives = (
            torch.stack([getattr(jet, of) for jet in (inner, outer)], dim=k) for k, of in enumerate(_JET)
        )
        crease = _BesideCrease.of(rho, derivatives, points)
        outwards = [by_x[1] - by_x[0] for by_x in crease.slopes]  # beyond its reach a face may cross another again
        nearer_inside = (points.x * outwards[0] + points.y * outwards[1]).detach() > 0.0
        return crease.here & nearer_inside, crease.radius[0] * (crease.scale - 1.0)

    (at_exit, top) = height(flange, above)
    (at_wall, foot) = height(wall, flange)
    lowest = top[at_exit].min()
    highest = foot[at_wall].max()
    at_foot = torch.where(at_wall, lowest - foot - needed_mm, needed_mm)
    return torch.where(at_exit, top - highest - needed_mm, at_foot)


_JET = "rho", "derivatives"


@dataclass
class AugmentedLagrangian:
    """Multipliers of ``c`` constraints at ``k`` points; the fields are scaled by each constraint's factor.

    ``names``: of the faces, in the order of their tables. ``lenses``: whose tables, and then whose constraints, come
    one after another.
    """

    constraints: tuple[Constraint, ...]
    chart_operator: ChartOperator
    names: tuple[str, ...]
    penalty: float = 2e4
    lenses: int = 1
    multipliers: Float[Tensor, "c k"] = field(init=False)

    @staticmethod
    def of(spec: Spec, grid: TableGrid, penalty: float = 2e4, *, sparse: bool = False) -> "AugmentedLagrangian":
        """The spec's constraints at points of ``grid``.

        ``sparse``: at a quarter of its nodes; at all for curvatures, and for a keep-out, whose outline is sharp.
        """
        constraints = constraints_of(spec)
        kinds = spec.all_lamps.kinds
        symmetry = "none" if any(kind.mirrors for kind in kinds) else spec.lens.basis.symmetry  # for all lenses
        derivatives = any(constraint.derivatives for constraint in constraints)
        detailed = derivatives or spec.constraints.keep_out is not None
        every = (1 if detailed else 2) if sparse else None
        if spec.lens.drawn_mm is not None:
            points = section_points(grid, symmetry)
        elif spec.lens.has_creases:
            detail_rad = None if spec.lens.is_round else spec.lens.basis.detail_rad
            points = meridian_points(grid, detail_rad, symmetry)
        else:
            points = constraint_points(grid, symmetry, every_node=every)
        spacing = grid.step * (1.0 if every is None else every * sqrt(2.0))  # with centres: triangles of three points
        operator = ChartOperator.of(grid, points, derivatives, spacing)
        return AugmentedLagrangian(constraints, operator, spec.lens.body_names, penalty, max(1, len(kinds)))

    def __post_init__(self) -> None:
        area = self.chart_operator.points.scale**2
        self._area = area / area.sum()
        self._factor, self._margin = (
            torch.tensor(self.lenses * values, dtype=torch.float64)[:, None]
            for values in (
                [constraint.factor for constraint in self.constraints],
                [constraint.factor * constraint.margin for constraint in self.constraints],
            )
        )
        self.multipliers = torch.zeros(len(self._factor), len(area), dtype=torch.float64)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the constraints in the history of a search."""
        return tuple(constraint.key for constraint in self.constraints)

    def fresh(self, penalty: float) -> "AugmentedLagrangian":
        """These constraints with multipliers of 0."""
        return replace(self, penalty=penalty)

    def tightened(self, by: Mapping[str, float]) -> "AugmentedLagrangian":
        """The constraints with limits that are stricter by what ``by`` has under their keys, in the unit of each."""
        constraints = tuple(constraint.tightened(by.get(constraint.key, 0.0)) for constraint in self.constraints)
        return replace(self, constraints=constraints)

    def at_nearest(self, before: "AugmentedLagrangian", multipliers: Float[Tensor, "c j"]) -> Float[Tensor, "c k"]:
        """``multipliers`` at the points of ``before``, taken to these points: each has that of the nearest one.

        The force on a length, an angle or a curvature stays the same, whatever the factors of both.
        """
        here, there = (
            np.stack([operator.points.x.numpy(), operator.points.y.numpy()], axis=1)
            for operator in (self.chart_operator, before.chart_operator)
        )
        nearest = multipliers[:, torch.from_numpy(cKDTree(there).query(here)[1])]
        return nearest * before._factor / self._factor

    def fields(self, tables: Float[Tensor, "f side side"]) -> Float[Tensor, "c k"]:
        """Fields of the constraints at the points of the faces' tables, each times its factor."""
        values = list[Tensor]()
        every = self.chart_operator.jets(tables)
        for first in range(0, len(every), len(self.names)):
            jets = dict(zip(self.names, every[first : first + len(self.names)], strict=True))
            values += (constraint.of(jets, self.chart_operator.points) for constraint in self.constraints)
        return self._factor * torch.stack(values)

    def least(self, fields: Float[Tensor, "c k"]) -> dict[str, float]:
        """The minimum of each constraint over points and lenses, in its unit, for the history of a search."""
        of_each = (fields.detach() / self._factor).amin(dim=1)
        least = of_each.reshape(self.lenses, -1).amin(dim=0).tolist()
        return dict(zip(self.keys, least, strict=True))

    def term(self, fields: Float[Tensor, "c k"]) -> Float[Tensor, ""]:
        """The regularisation term of Eq. (15), averaged over the hemisphere."""
        updated = self._updated(fields)
        return torch.sum(self._area * (updated**2 - self.multipliers**2)) / (2.0 * self.penalty)

    def penalty_alone(self, fields: Float[Tensor, "c k"]) -> Float[Tensor, ""]:
        """The term without multipliers: lenses of different searches are judged alike."""
        missing = torch.clamp(self._margin - fields, min=0.0)
        return 0.5 * self.penalty * torch.sum(self._area * missing**2)

    def shortfall(self, fields: Float[Tensor, "c k"]) -> float:
        """Part of a constraint's margin missing at the worst point: 0 where all margins are kept, 1 at a limit."""
        return float(torch.clamp(1.0 - fields.detach() / self._margin, min=0.0).max())

    def update(self, fields: Float[Tensor, "c k"]) -> None:
        """First-order multiplier update; call it between rounds of minimisation."""
        self.multipliers = self._updated(fields.detach())

    def _updated(self, fields: Float[Tensor, "c k"]) -> Float[Tensor, "c k"]:
        return torch.clamp(self.multipliers - self.penalty * (fields - self._margin), min=0.0)
