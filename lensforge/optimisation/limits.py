"""Limits of a feasible lens: each constraint of the spec by name, with its tolerance, and the criteria on its margin.

The paper's three, Eqs. (10) to (14), and for manufacture and assembly those that the spec sets. No tracer is loaded: a
record of a search is held against them wherever it is read.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from lensforge.criteria import Criterion, at_least
from lensforge.optimisation.design import Margins
from lensforge.spec import Spec

DIRECTIONS = 60_000  # over the hemisphere, at which the lengths of a finished lens are measured
# What counts as feasible in the finished lens, relative to the cutter's curvature, and in degrees.
_CURVATURE_TOLERANCE = 1e-3
_DRAFT_TOLERANCE_DEG = 0.01


@dataclass(frozen=True)
class Limit:
    """A margin of :class:`Margins` that must be at least 0, but for ``tolerance``; ``key`` ends with its unit."""

    key: str
    unit: str
    tolerance: float
    remedy: str

    @property
    def name(self) -> str:
        """Name of its criterion."""
        return self.key.removesuffix("_per_mm").removesuffix("_mm").removesuffix("_deg").replace("_", " ")


def limits_of(spec: Spec) -> dict[str, Limit]:
    """The limits of ``spec`` by the key of their margin: the paper's three, and the optional ones that it has."""
    return {limit.key: limit for limit in (*_of_paper(spec), *_of_cutter(spec), *_of_mould(spec), *_of_envelope(spec))}


def _of_paper(spec: Spec) -> Iterator[Limit]:
    for key, remedy in (
        ("cavity_clearance_mm", "raise lens.inner_offset_mm or lower constraints.cavity_*"),
        ("wall_margin_mm", "raise lens.outer_offset_mm or lower constraints.min_thickness_mm"),
        ("radius_margin_mm", "raise constraints.max_radius_mm or lower lens.outer_offset_mm"),
    ):
        yield Limit(key, "mm", spec.constraints.tolerance_mm, remedy)


def _of_cutter(spec: Spec) -> Iterator[Limit]:
    limits = spec.constraints
    for surface, limit_mm in (("inner", limits.inner_concave_radius_mm), ("outer", limits.outer_concave_radius_mm)):
        if limit_mm is not None:
            remedy = f"lower constraints.{surface}_concave_radius_mm or raise lens.{surface}_offset_mm"
            yield Limit(f"{surface}_curvature_margin_per_mm", "1/mm", _CURVATURE_TOLERANCE / limit_mm, remedy)


def _of_mould(spec: Spec) -> Iterator[Limit]:
    limits = spec.constraints
    for surface, limit_deg in (("inner", limits.inner_draft_deg), ("outer", limits.outer_draft_deg)):
        if limit_deg is not None:
            remedy = f"lower constraints.{surface}_draft_deg or take more steps"
            yield Limit(f"{surface}_draft_margin_deg", "deg", _DRAFT_TOLERANCE_DEG, remedy)


def _of_envelope(spec: Spec) -> Iterator[Limit]:
    limits = spec.constraints
    for key, given, remedy in (
        ("largest_wall_margin_mm", limits.max_wall_mm, "raise constraints.max_wall_mm or lens.inner_offset_mm"),
        ("height_margin_mm", limits.max_height_mm, "raise constraints.max_height_mm or lower lens.outer_offset_mm"),
        (
            "keep_out_clearance_mm",
            limits.keep_out,
            "raise lens.inner_offset_mm or lower constraints.keep_out_margin_mm",
        ),
    ):
        if given is not None:
            yield Limit(key, "mm", limits.tolerance_mm, remedy)


def constraint_criteria(spec: Spec, measured: Margins) -> tuple[Criterion, ...]:
    """One criterion for each limit of ``spec``: at least 0 but for its tolerance."""
    return tuple(
        at_least(limit.name, _known(getattr(measured, key)), -limit.tolerance, limit.unit, limit.remedy)
        for key, limit in limits_of(spec).items()
    )


def _known(margin: float | None) -> float:
    """``margin``, or NaN where it has not been measured."""
    return float("nan") if margin is None else margin
