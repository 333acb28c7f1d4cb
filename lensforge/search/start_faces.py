"""The faces from which the search for a TIR lens or a reflector begins: the best of their kind for a point source.

Given faces and offsets stay; the rest suits source, radius and beam.
"""

from collections.abc import Callable
from dataclasses import replace
from math import radians

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, remedy
from lensforge.optics.media import FLANGE
from lensforge.scene.body import Body
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import in_target, target_light
from lensforge.spec import Spec
from lensforge.spec.lens_section import ReflectorSection, TirSection
from lensforge.surfaces.collimator import best_collimator
from lensforge.surfaces.profile import ProfileFace
from lensforge.surfaces.reciprocal import ConeFace, PlaneFace, ReciprocalSurface
from lensforge.surfaces.reflector_cup import best_cup, reflector_faces
from lensforge.surfaces.surface import Surface

_DRAFT_DEG = 2.0  # of the side of a cavity, where the spec does not say
_WIDEST_BEAM = 3.0  # over the narrowest of this source and radius: wider ones fit any cavity, and the exit makes them
_NARROWEST_BEAM_RAD = radians(0.1)
_THICKER = 1.15  # a back over the least wall: the wall varies as the cup moves
HORIZON, AXIS = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])


def start_faces(spec: Spec) -> dict[str, Surface]:
    """The faces from which the search for a lens with creases begins, or those that the spec fixes.

    Raises :class:`InputError` for sizes that leave no room for such a lens, and for faces that cross.
    """
    starts: dict[str, Callable[[Spec], dict[str, Surface]]] = {"tir": _tir_faces, "reflector": _reflector_faces}
    found = starts[spec.lens.kind](spec)
    with remedy("change lens.*.offset_mm, or leave it out"):
        Body.of(found).require_sound()
    return found


def _reflector_faces(spec: Spec) -> dict[str, Surface]:
    """The cup that is given, or the paraboloid that suits source, radius and beam best; its back and its mouth."""
    lens, limits = spec.lens, spec.constraints
    assert isinstance(lens, ReflectorSection)
    radius_mm = limits.max_radius_mm - 2.0 * limits.margin_mm
    wall_mm = _THICKER * (limits.min_thickness_mm + 2.0 * limits.margin_mm)
    most_mm = np.inf if limits.max_height_mm is None else limits.max_height_mm - limits.margin_mm
    cup, height_mm = lens.fixed["cup"], lens.mouth.offset_mm
    least_rad, beam_rad = _beam_rad(spec) if cup is None else (0.0, 0.0)
    try:
        if cup is None:
            clear_mm, side_mm = _room(spec)
            best = best_cup(
                radius_mm, wall_mm, side_mm, beam_rad, least_rad, clearance_mm=clear_mm, most_height_mm=most_mm
            )
            if lens.cup.offset_mm is not None:
                best = replace(best, focal_mm=0.5 * lens.cup.offset_mm)
            cup, height_mm = best.face, height_mm or best.height_mm
        return reflector_faces(cup, radius_mm, wall_mm, height_mm, most_mm)
    except InputError as error:
        raise InputError(f"lens: {str(error).removeprefix('reflector: ')} (lens.kind = 'reflector')") from None


def _room(spec: Spec) -> tuple[float, float]:
    """Least radius (mm) of a cavity around the source of ``spec``, and the side of a square source of its size."""
    limits, extent = spec.constraints, spec.source.extent_mm
    clear = limits.cavity_radius_mm if extent is None else max(limits.cavity_radius_mm, extent)
    least = 1e-3 * (limits.max_radius_mm - 2.0 * limits.margin_mm)
    return clear, (clear if extent is None else max(extent, least)) * 2.0**0.5


def _tir_faces(spec: Spec) -> dict[str, Surface]:
    lens = spec.lens
    assert isinstance(lens, TirSection)
    own, found = _of_a_point(spec), dict[str, Surface]()
    if lens.exit.flat:
        own["exit"] = PlaneFace(own["exit"].reach_mm, float(own["exit"].radius(AXIS)[0]))
    given = {"wall": (lens.wall.offset_mm, HORIZON), "exit": (lens.exit.offset_mm, AXIS)}
    if lens.flange is not None:  # around the light that the wall turns, and below an exit that is so much higher
        rim_mm, own[FLANGE] = float(own["exit"].radius(AXIS)[0]), _rim_face(spec, own["exit"].reach_mm)
        own["exit"] = _resized(own["exit"], rim_mm + lens.flange.room_mm + 2.0 * spec.constraints.margin_mm, AXIS)
    for name in lens.body_names:
        surface = lens.fixed.get(name)
        offset_mm, towards = given.get(name, (None, AXIS))
        found[name] = surface or (own[name] if offset_mm is None else _resized(own[name], offset_mm, towards))
    return found


def _rim_face(spec: Spec, reach_mm: float) -> ConeFace:
    """The cylinder at which the flange begins; its continuation is that of no other face."""
    return ConeFace(1.1 * reach_mm, spec.constraints.rim_radius_mm)


def _resized(face: ReciprocalSurface, offset_mm: float, towards: Float[np.ndarray, "1 3"]) -> ReciprocalSurface:
    """The face, scaled about the origin to a distance of ``offset_mm`` in one direction."""
    return shrunk(face, float(face.radius(towards)[0]) / offset_mm)


def shrunk(face: ReciprocalSurface, factor: float) -> ReciprocalSurface:
    """The face within the same reach, its lengths over ``factor``."""
    match face:
        case ConeFace():
            return replace(face, radius_mm=face.radius_mm / factor)
        case PlaneFace():
            return replace(face, height_mm=face.height_mm / factor)
    assert isinstance(face, ProfileFace)
    return replace(face, coefficients=tuple(factor * each for each in face.coefficients))


def _of_a_point(spec: Spec) -> dict[str, ReciprocalSurface]:
    """Faces of the lens for a point with the best light for source, radius and beam of ``spec``, at first order."""
    lens, limits = spec.lens, spec.constraints
    assert isinstance(lens, TirSection)
    draft = radians(_DRAFT_DEG if lens.side.draft_deg is None else lens.side.draft_deg)
    index, wall = lens.refractive_index / lens.cavity_index, limits.min_thickness_mm
    radius_mm, flange_mm = limits.rim_radius_mm, lens.flange_room_mm or 0.0
    mirrored = lens.wall.mirror is not None
    (clear, size), (_, beam_rad) = _room(spec), _beam_rad(spec)
    try:
        best = best_collimator(
            index,
            radius_mm,
            size,
            min(beam_rad, _WIDEST_BEAM * float(np.arcsin(min(0.5, size / radius_mm / np.sqrt(np.pi))))),
            draft_rad=draft,
            least_wall_mm=wall + 2.0 * limits.margin_mm,
            mirrored=mirrored,
            clearance_mm=max(0.0, clear - size / 2.0**0.5) + 2.0 * limits.margin_mm,
            most_height_mm=np.inf if limits.max_height_mm is None else limits.max_height_mm - flange_mm,
        )
        cap, side = lens.cap.offset_mm, lens.side.offset_mm
        return replace(best, cap_mm=cap or best.cap_mm, cavity_mm=side or best.cavity_mm).faces
    except InputError as error:
        raise InputError(f"lens: {str(error).removeprefix('collimator: ')} (lens.kind = 'tir')") from None


def _beam_rad(spec: Spec) -> tuple[float, float]:
    """Least and largest angle from the axis of the light that the first target wants; least: 0 for light about it."""
    receiver, section = receivers_of(spec, spec.optimise.pixels)[0], spec.all_receivers[0]
    bright = in_target(target_light(section.targets, receiver))
    x, y = np.meshgrid(receiver.grid.x(), receiver.grid.y())
    points = receiver.places(x.ravel(), y.ravel())
    angles = np.arccos(np.clip(points[:, 2] / np.linalg.norm(points, axis=1), -1.0, 1.0)).reshape(bright.shape)
    pixel = max(float(np.abs(np.diff(angles, axis=axis)).max()) for axis in (0, 1))
    least, most = float(angles[bright].min()), float(angles[bright].max())
    return least if least > pixel else 0.0, max(most, _NARROWEST_BEAM_RAD)
