"""Tolerances that a part can bear: faces that stay apart, and an LED that stays in its cavity."""

from collections.abc import Sequence

import numpy as np

from lensforge.cad.patch import fit_patch
from lensforge.cad.wall import thinnest
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source
from lensforge.spec.tolerances_section import Factor
from lensforge.surfaces.srbf import fibonacci_hemisphere

_DIRECTIONS = 4000
# Farthest that a drawn number lies: a normal one beyond twice its amount in one part of 30,000.
_FARTHEST = {"uniform": 1.0, "truncated": 1.0, "normal": 2.0}
_RMS_TO_PEAK = 3.0
_OF_FACES = (
    "outer_shift_mm", "gap_mm", "outer_tilt_deg", "inner_form_um", "outer_form_um", "inner_waviness_um",
    "outer_waviness_um",
)  # fmt: skip
_OF_SOURCE = (
    "source_shift_mm", "source_height_mm", "source_tilt_deg", "source_size", "lens_shift_mm", "lens_height_mm",
    "lens_tilt_deg",
)  # fmt: skip


def require_bearable(lens: Lens, factors: Sequence[Factor]) -> None:
    """Refuse a tolerance that alone brings the faces together, or the source to the inner face.

    Raises :class:`InputError`, which names the tolerance and what is left for it.
    """
    u = fibonacci_hemisphere(_DIRECTIONS)
    wall = thinnest(fit_patch(lens.inner), fit_patch(lens.outer)).thickness_mm
    reach = float(lens.outer.radius(u).max())
    points = build_source(lens.spec.source, lens.dispersion).outline()
    distance = np.linalg.norm(points, axis=1)
    along = points / np.where(distance > 0.0, distance, 1.0)[:, None]
    along[distance == 0.0] = (0.0, 0.0, 1.0)
    along[:, 2] = np.maximum(along[:, 2], 0.0)  # light from below z = 0 enters through the opening: judged in it
    along /= np.linalg.norm(along, axis=1)[:, None]
    room = float((lens.inner.radius(along) - distance).min())
    size = float(distance.max())
    for factor in factors:
        for names, left, arm, words in (
            (_OF_FACES, wall, reach, f"the faces are {wall:.3g} mm apart at their closest"),
            (_OF_SOURCE, room, size, f"the source is {room:.3g} mm from the inner face at its closest"),
        ):
            moved = displacement(factor, arm)
            if factor.name in names and moved >= left > 0.0:
                most = factor.amount * left / moved
                raise InputError(
                    f"tolerances.{factor.name} = {factor.amount:g}: parts at its end move by {moved:.3g} mm, but "
                    f"{words}; at most {most:.2g}"
                )


def displacement(factor: Factor, arm_mm: float) -> float:
    """Farthest (mm) that a point at ``arm_mm`` moves by the factor."""
    if factor.kind == "field":
        return _RMS_TO_PEAK * factor.amount * factor.to_internal
    far = _FARTHEST[factor.distribution] * factor.amount * factor.to_internal * float(np.sqrt(factor.numbers))
    return far * arm_mm if factor.unit in ("deg", "") else far
