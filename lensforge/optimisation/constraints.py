"""Constraints on a lens: the paper's three, Eqs. (10) to (14), and optional ones for manufacture and assembly.

The paper's g1 keeps the cavity clear, g2 the wall thick, g3 the lens small; the wall is the distance between the faces,
not that along a ray, which a steep face makes longer. Optionally no concave region is tighter
than the ball that mills it (curvature alone: the gouge test of ``check`` is global), and each face has a draft, so that
a mould opens along the axis; the wall is nowhere too thick, the lens not too high, and the cavity clear of a keep-out.
A constraint that the spec leaves out is not computed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import radians

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.optimisation.chart_points import ChartPoints, RadiusJet
from lensforge.optimisation.keep_out import KeepOutExtent
from lensforge.optimisation.limits import Limit, limits_of
from lensforge.optimisation.surface_shape import draft_sine, least_curvature, wall_mm
from lensforge.spec import Spec

# The search aims this far inside the limits, relative to the cutter's curvature, and in degrees: its last steps still
# move by that much, and a peak lies between the points. Of lengths: ``ConstraintsSection.margin_mm``.
_CURVATURE_MARGIN = 0.01
_DRAFT_MARGIN_DEG = 0.1
_REACH = 0.01  # of the largest radius: so much above its limit a wall is still followed, where multipliers act
_STEEP = 0.5  # sine of the draft above which the field is constant: the arcsine's slope is infinite at the apex

WALL = "wall_margin_mm"
Field = Callable[[RadiusJet, RadiusJet, ChartPoints], Float[Tensor, " k"]]


@dataclass(frozen=True)
class Constraint(Limit):
    """A field over both surfaces that is at least 0 where the lens is feasible.

    ``key`` ends with the unit of the field, of ``margin`` (how far inside the search aims) and of ``tolerance``. The
    field times ``factor`` is of order 1 for every constraint: lengths relative to the largest radius; angles and
    curvatures by the sag that they make over the narrowest function, relative to that radius.
    """

    field: Field
    factor: float
    margin: float
    derivatives: bool = False

    def tightened(self, by: float) -> "Constraint":
        """The constraint with a limit that is stricter by ``by`` (unit of the field)."""

        def field(inner: RadiusJet, outer: RadiusJet, points: ChartPoints) -> Float[Tensor, " k"]:
            return self.field(inner, outer, points) - by

        return replace(self, field=field) if by > 0.0 else self


def constraints_of(spec: Spec) -> tuple[Constraint, ...]:
    """The paper's three, and the optional ones that the spec has."""
    return (*_of_paper(spec), *_of_cutter(spec), *_of_mould(spec), *_of_envelope(spec))


def _of_paper(spec: Spec) -> list[Constraint]:
    limits = spec.constraints
    reach_mm = limits.min_thickness_mm + _REACH * limits.max_radius_mm

    def cavity(inner: RadiusJet, outer: RadiusJet, points: ChartPoints) -> Tensor:
        squared = (inner.rho**2) * (1.0 - points.cosine**2)
        paraboloid = limits.cavity_height_mm / limits.cavity_radius_mm**2 * squared
        return paraboloid + inner.rho * points.cosine - limits.cavity_height_mm

    def wall(inner: RadiusJet, outer: RadiusJet, points: ChartPoints) -> Tensor:
        return wall_mm(inner, outer, points, reach_mm) - limits.min_thickness_mm

    def size(inner: RadiusJet, outer: RadiusJet, points: ChartPoints) -> Tensor:
        return limits.max_radius_mm - outer.rho

    return _of_lengths(spec, {"cavity_clearance_mm": cavity, WALL: wall, "radius_margin_mm": size})


def _of_lengths(spec: Spec, fields: dict[str, Field]) -> list[Constraint]:
    """Constraints on lengths by the keys of their margins."""
    known, limits = limits_of(spec), spec.constraints
    factor, margin = 1.0 / limits.max_radius_mm, limits.margin_mm
    return [Constraint(**vars(known[key]), field=field, factor=factor, margin=margin) for key, field in fields.items()]


def _of_envelope(spec: Spec) -> list[Constraint]:
    """The largest wall, the largest height and the keep-out, where the spec has them."""
    limits, fields = spec.constraints, dict[str, Field]()
    if limits.max_wall_mm is not None:
        fields["largest_wall_margin_mm"] = partial(_thickness_left, limits.max_wall_mm)
    if limits.max_height_mm is not None:
        fields["height_margin_mm"] = partial(_height_left, limits.max_height_mm)
    if limits.keep_out is not None:
        fields["keep_out_clearance_mm"] = partial(_beyond_keep_out, KeepOutExtent.of(spec))
    return _of_lengths(spec, fields)


def _thickness_left(limit_mm: float, inner: RadiusJet, outer: RadiusJet, points: ChartPoints) -> Float[Tensor, " k"]:
    """Thickness (mm) left before the wall is too thick."""
    return limit_mm - (outer.rho - inner.rho)


def _height_left(limit_mm: float, inner: RadiusJet, outer: RadiusJet, points: ChartPoints) -> Float[Tensor, " k"]:
    """Height (mm) left above the outer surface."""
    return limit_mm - outer.rho * points.cosine


def _beyond_keep_out(
    extent: KeepOutExtent, inner: RadiusJet, outer: RadiusJet, points: ChartPoints
) -> Float[Tensor, " k"]:
    """Length (mm) along the ray from the grown keep-out to the inner surface."""
    return inner.rho - extent.at(points)


def _of_cutter(spec: Spec) -> list[Constraint]:
    sigma, known = spec.lens.basis.detail_rad, limits_of(spec)
    found = []
    for surface, limit_mm in (
        ("inner", spec.constraints.inner_concave_radius_mm),
        ("outer", spec.constraints.outer_concave_radius_mm),
    ):
        if limit_mm is None:
            continue
        # the cutter touches a lens from the air side, a mould insert from the side of the lens body
        air = (-1 if surface == "inner" else 1) * (1 if spec.manufacture.make == "part" else -1)
        found.append(
            Constraint(
                **vars(known[f"{surface}_curvature_margin_per_mm"]),
                field=partial(_curvature_margin, surface, air, 1.0 / limit_mm),
                factor=0.5 * sigma**2 * spec.constraints.max_radius_mm,
                margin=_CURVATURE_MARGIN / limit_mm,
                derivatives=True,
            )
        )
    return found


def _of_mould(spec: Spec) -> list[Constraint]:
    sigma, known = spec.lens.basis.detail_rad, limits_of(spec)
    return [
        Constraint(
            **vars(known[f"{surface}_draft_margin_deg"]),
            field=partial(_draft_margin, surface, limit_deg),
            factor=radians(sigma),
            margin=_DRAFT_MARGIN_DEG,
            derivatives=True,
        )
        for surface, limit_deg in (
            ("inner", spec.constraints.inner_draft_deg),
            ("outer", spec.constraints.outer_draft_deg),
        )
        if limit_deg is not None
    ]


def _curvature_margin(
    surface: str, air: int, curvature: float, inner: RadiusJet, outer: RadiusJet, points: ChartPoints
) -> Float[Tensor, " k"]:
    """Curvature (1/mm) left before a concave region is as tight as the ball."""
    return curvature + least_curvature(inner if surface == "inner" else outer, points, air)


def _draft_margin(
    surface: str, limit_deg: float, inner: RadiusJet, outer: RadiusJet, points: ChartPoints
) -> Float[Tensor, " k"]:
    """Draft (deg) beyond the limit."""
    sine = torch.clamp(draft_sine(inner if surface == "inner" else outer, points), -1.0 + 1e-6, _STEEP)
    return torch.rad2deg(torch.asin(sine)) - limit_deg
