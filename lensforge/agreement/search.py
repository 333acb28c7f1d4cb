"""Agreement of ``design.json`` with the spec's limits, its history, and the surfaces of the lens itself."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lensforge.agreement.comparing import beyond, judged, unlike
from lensforge.lens import Lens
from lensforge.optimisation.design import Design
from lensforge.optimisation.limits import DIRECTIONS, constraint_criteria, limits_of
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.symmetry import first_images

_EVERY = 30  # of the directions at which the margins were measured: up to 2,000, of which the least cannot be less
_SAME_SIZE = 1e-2  # of the largest radius: the two grids that measure it are not the same


def design_contradictions(design: Design, lens: Lens) -> Iterator[str]:
    """Contradictions of a search's record."""
    spec, margins = lens.spec, design.constraints
    wanted, given = set(limits_of(spec)), set(margins.model_dump(exclude_none=True))
    yield from unlike("constraints", sorted(given), sorted(wanted), "the spec has")
    yield from judged("criteria", design.criteria, constraint_criteria(spec, margins))
    steps = sum(len(level.nmse) for level in design.history)
    yield from unlike("steps", design.steps, steps, "its history has")
    yield from unlike("forward_evaluations", design.forward_evaluations, steps, "its history has")
    yield from _by_surfaces(design, lens)


def _by_surfaces(design: Design, lens: Lens) -> Iterator[str]:
    """Margins that the lens itself does not have: at some directions it is closer to its limit than stated."""
    margins, limits = design.constraints, lens.spec.constraints
    size = limits.max_radius_mm
    for name, stated, least in _sampled(design, lens):
        yield from beyond(name, stated, -np.inf, least, "the surfaces of lens.json")
    largest = size - margins.radius_margin_mm
    yield from beyond(
        "max_radius_mm", design.max_radius_mm, largest - _SAME_SIZE * size, largest + _SAME_SIZE * size, "its margins"
    )
    yield from beyond("height_mm", design.height_mm, 0.0, design.max_radius_mm, "its radius")


def _sampled(design: Design, lens: Lens) -> Iterator[tuple[str, float, float]]:
    """Name, stated value, and the least at some of the directions where the lens was measured."""
    u = fibonacci_hemisphere(DIRECTIONS)
    u = u[first_images(u, lens.symmetry)][::_EVERY]
    inner, outer = lens.inner.radius(u), lens.outer.radius(u)
    limits, margins = lens.spec.constraints, design.constraints
    wall = outer - inner
    fields = [
        ("cavity_clearance_mm", margins.cavity_clearance_mm, _cavity(lens, u, inner)),
        ("wall_margin_mm", margins.wall_margin_mm, wall - limits.min_thickness_mm),
        ("radius_margin_mm", margins.radius_margin_mm, limits.max_radius_mm - outer),
    ]
    if limits.max_wall_mm is not None and margins.largest_wall_margin_mm is not None:
        fields.append(("largest_wall_margin_mm", margins.largest_wall_margin_mm, limits.max_wall_mm - wall))
    if limits.max_height_mm is not None and margins.height_margin_mm is not None:
        fields.append(("height_margin_mm", margins.height_margin_mm, limits.max_height_mm - outer * u[:, 2]))
    for name, stated, field in fields:
        yield f"constraints.{name}", stated, float(field.min()) + 1e-9 * limits.max_radius_mm


def _cavity(lens: Lens, u: Float[np.ndarray, "n 3"], inner: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Height (mm) of the inner surface above the paraboloid that the cavity must hold, Eq. (10)."""
    limits = lens.spec.constraints
    squared = inner**2 * (1.0 - u[:, 2] ** 2)
    height: Float[np.ndarray, " n"] = (
        limits.cavity_height_mm / limits.cavity_radius_mm**2 * squared + inner * u[:, 2] - limits.cavity_height_mm
    )
    return height
