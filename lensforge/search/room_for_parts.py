"""Tolerances that a lens can bear: no part at its end may bring faces together, or the source to the cavity."""

from collections.abc import Sequence

import numpy as np

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.sources.build_source import build_source
from lensforge.spec.tolerances_section import Factor, factor_name

_DIRECTIONS = 4000
# Farthest that a drawn number lies: a normal one beyond twice its amount in one part of 30,000.
_FARTHEST = {"uniform": 1.0, "truncated": 1.0, "normal": 2.0}
_RMS_TO_PEAK = 3.0
_OF_FACE = ("shift_mm", "gap_mm", "tilt_deg", "form_um", "waviness_um")  # that bring it nearer to another face
_OF_SOURCE = ("source_shift_mm", "source_height_mm", "source_tilt_deg", "source_size")
_OF_LENS = ("lens_shift_mm", "lens_height_mm", "lens_tilt_deg")


def require_feasible_tolerances(lens: Lens, factors: Sequence[Factor]) -> None:
    """Refuse a tolerance that alone brings the faces together, or the source to the cavity.

    Raises :class:`InputError`, which names the tolerance and what is left for it.
    """
    for kind in lens.kinds:
        _require_feasible(kind, factors)


def _require_feasible(lens: Lens, factors: Sequence[Factor]) -> None:
    from lensforge.cad.boundary import lens_boundaries  # a tenth of a second, which only robust searches need
    from lensforge.cad.wall import thinnest_of

    cavity, envelope = lens_boundaries(lens)
    wall = thinnest_of(lens).thickness_mm
    reach = float(envelope.radius(lens.directions(_DIRECTIONS)).max())
    roles = lens.spec.lens.roles
    nearest = " or ".join(face.name for face in lens.body.cavity)
    of_faces = [factor_name(roles, role.name, field) for role in roles for field in _OF_FACE]
    bounds = [(of_faces, wall, reach, f"the faces are {wall:.3g} mm apart at their closest")]
    for emitter in lens.spec.each_source:
        points = build_source(emitter, lens.dispersion).outline()
        distance = np.linalg.norm(points, axis=1)
        along = points / np.where(distance > 0.0, distance, 1.0)[:, None]
        along[distance == 0.0] = (0.0, 0.0, 1.0)
        along[:, 2] = np.maximum(along[:, 2], 0.0)  # light from below z = 0 enters through the opening: judged in it
        along /= np.linalg.norm(along, axis=1)[:, None]
        room = float((cavity.radius(along) - distance).min())
        from_source = f"the source is {room:.3g} mm from the {nearest} face at its closest"
        bounds.append(([*_OF_SOURCE, *_OF_LENS], room, float(distance.max()), from_source))
        if lens.spec.plate is not None:  # its lenses move as far as they stand from its middle
            middle = lens.spec.plate.lenses(lens.spec.lamps).reach_mm
            bounds.append((["shrinkage", "lens_tilt_deg"], room, middle, from_source))
    for factor in factors:
        for names, left, arm, cause in bounds:
            moved = displacement(factor, arm)
            if factor.name in names and moved >= left > 0.0:
                most = factor.amount * left / moved
                raise InputError(
                    f"tolerances.{factor.name} = {factor.amount:g}: parts at its end move by {moved:.3g} mm, but "
                    f"{cause}; at most {most:.2g}"
                )


def displacement(factor: Factor, arm_mm: float) -> float:
    """Farthest (mm) that a point at ``arm_mm`` moves by the factor."""
    if factor.kind == "field":
        return _RMS_TO_PEAK * factor.amount * factor.to_internal
    far = _FARTHEST[factor.distribution] * factor.amount * factor.to_internal * float(np.sqrt(factor.numbers))
    return far * arm_mm if factor.unit in ("deg", "") else far
