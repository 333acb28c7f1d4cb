"""Room for the ball cutter at the base: the step below the outer rim, and the bore below the cavity, that clear it.

Near a rim, a ball that touches the face extends below z = 0, where the base is. All clearances are closed forms of the
ball's centre: its distance from the axis and its height above z = 0.
"""

from dataclasses import replace
from functools import lru_cache
from math import ceil

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import Boundary, lens_boundaries
from lensforge.cad.form_error import fit_lens
from lensforge.cad.outline import FULL_TURN, outline_of, sampled_azimuths
from lensforge.cad.patch import Patch
from lensforge.cad.plan import MIN_BASE_WALL_MM, Plan, lay_out, rim_radius
from lensforge.scene.lens import Lens
from lensforge.spec import BaseSection, Spec
from lensforge.spec.processes import Process
from lensforge.surfaces.surface import Surface

# Contacts: between them a clearance is larger by less than 2 um on a lens of 14 mm.
_RINGS = 129
_AZIMUTHS = 360
_SPARE_MM = 5e-3  # beyond the contacts
_DIGITS_MM = 1e-2  # lengths of the room are whole hundredths

Lengths = Float[np.ndarray, " k"]


def needed_step_mm(distance: Lengths, height: Lengths, cutter_mm: float, base_mm: float) -> Lengths:
    """Depth (mm) below z = 0 at which a disc of radius ``base_mm`` clears balls with these centres; may be negative.

    Outside the disc nothing limits the ball: minus infinity.
    """
    outside = np.maximum(distance - base_mm, 0.0)
    below = np.sqrt(np.maximum(cutter_mm**2 - outside**2, 0.0))
    return np.where(outside < cutter_mm, below - height, -np.inf)


def largest_wall_mm(distance: Lengths, height: Lengths, cutter_mm: float) -> Lengths:
    """Largest radius (mm) of a wall down from z = 0 that clears balls outside it; infinite if any does."""
    across = np.sqrt(np.maximum(cutter_mm**2 - np.maximum(height, 0.0) ** 2, 0.0))
    return np.where(height < cutter_mm, distance - across, np.inf)


def smallest_bore_mm(distance: Lengths, height: Lengths, cutter_mm: float, top_mm: float, bottom_mm: float) -> Lengths:
    """Smallest radius (mm) of a bore from depth ``top_mm`` to ``bottom_mm`` that clears balls inside it."""
    away = np.maximum(np.maximum(height + top_mm, -height - bottom_mm), 0.0)
    across = np.sqrt(np.maximum(cutter_mm**2 - away**2, 0.0))
    return np.where(away < cutter_mm, distance + across, 0.0)


def ball_centres_mm(
    points: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "k 3"], offset_mm: float
) -> tuple[Lengths, Lengths]:
    """Distance from the axis and height of the centres of balls that touch ``points``, ``offset_mm`` along normals."""
    centres = points + offset_mm * normals
    return np.hypot(centres[:, 0], centres[:, 1]), centres[:, 2]


@lru_cache(maxsize=4)  # export, check, sections and drawing ask for it
def base_with_room(lens: Lens) -> BaseSection:
    """The base of ``lens``; unstated lengths are set to give the cutter room at the faces designed for it.

    Room is limited by the least wall of the spec; the manufacturing check then tells what is missing.
    """
    spec = lens.spec
    base = lens.spec.base_made
    if base.kind in ("none", "step"):
        return base
    room = dict.fromkeys(("relief_step_mm", "relief_setback_mm", "bore_setback_mm"), 0.0)
    missing = [name for name in room if getattr(base, name) is None]
    if not missing or not any(spec.is_cut(name) for name in spec.lens.names):
        return base.changed(**dict.fromkeys(missing, 0.0))
    cavity, envelope = fit_lens(lens)
    if any(spec.is_cut(face.name) for face in cavity.faces):
        room["bore_setback_mm"] = _bore_setback(cavity, spec)
    setback = room["bore_setback_mm"] if base.bore_setback_mm is None else base.bore_setback_mm
    opening = float(_rim(cavity).max()) + setback
    if any(spec.is_cut(face.name) for face in envelope.faces):
        room |= _relief(envelope, spec, opening)
    if base.relief_step_mm == 0.0:
        room["relief_setback_mm"] = 0.0  # without a step it has no wall
    return base.changed(**{name: room[name] for name in missing})


def as_built(lens: Lens, process: Process) -> Lens:
    """The lens made by another ``process``, its body with the cutter clearance and drafts that the files have.

    Raises :class:`InputError` for a process by which no such part is made.
    """
    spec = lens.spec.made_by(process)
    return replace(lens, spec=spec if spec.plate is not None else spec.changed(base=base_with_room(lens)))


@lru_cache(maxsize=4)  # sections and drawing ask for it
def lens_plan(lens: Lens) -> Plan[Surface]:
    """The plan of the lens's exact faces on its base; it need not be feasible."""
    return lay_out(*lens_boundaries(lens), base_with_room(lens))


def _bore_setback(cavity: Boundary[Patch], spec: Spec) -> float:
    base = spec.base
    cutter_mm = spec.manufacture.tool_radius_mm
    distance, height = _centres(cavity, spec, -cutter_mm)
    pocket = base.pocket_diameter_mm
    depth = base.height_mm - (0.0 if pocket is None else base.pocket_depth_mm)
    opening = float(_rim(cavity).max())
    outside = float(outline_of(base).radius(sampled_azimuths()).min()) - _wall_mm(spec)
    room = min(outside, np.inf if pocket is None else pocket / 2.0 - MIN_BASE_WALL_MM - _SPARE_MM) - opening
    return _rounded(float(smallest_bore_mm(distance, height, cutter_mm, 0.0, depth).max()) - opening, room)


def _relief(envelope: Boundary[Patch], spec: Spec, opening_mm: float) -> dict[str, float]:
    """Step and setback of its wall; ``opening_mm``: radius of the cavity or its bore."""
    base = spec.base
    cutter_mm = spec.manufacture.tool_radius_mm
    wall = _wall_mm(spec)
    distance, height = _centres(envelope, spec, cutter_mm)
    flange = 0.0 if base.flange_diameter_mm is None else base.flange_height_mm
    step = float(needed_step_mm(distance, height, cutter_mm, base.widest_mm / 2.0).max())
    rim = float(_rim(envelope).min())
    setback = rim - float(largest_wall_mm(distance, height, cutter_mm).min())
    step = _rounded(step, base.height_mm - flange - wall)
    return {
        "relief_step_mm": step,
        "relief_setback_mm": _rounded(setback, rim - opening_mm - wall) if step > 0.0 else 0.0,
    }


def _wall_mm(spec: Spec) -> float:
    """Wall (mm) that room must leave: as in the spec, but at least what the plan accepts."""
    return max(spec.constraints.min_thickness_mm, MIN_BASE_WALL_MM) + _SPARE_MM


def _rounded(needed_mm: float, room_mm: float) -> float:
    """``needed_mm`` with a little to spare, in hundredths, at most ``room_mm``; 0 if that is not positive.

    Rounded up from 0 too: a wall that just touches the ball leaves no room.
    """
    if needed_mm <= -_SPARE_MM:
        return 0.0
    return max(min(_DIGITS_MM * ceil((needed_mm + _SPARE_MM) / _DIGITS_MM), room_mm), 0.0)


def _centres(boundary: Boundary[Patch], spec: Spec, offset_mm: float) -> tuple[Lengths, Lengths]:
    """Centres of balls all over the cut faces, ``offset_mm`` along their outward normals."""
    azimuths = np.linspace(0.0, FULL_TURN, _AZIMUTHS, endpoint=False)
    share, turn = np.meshgrid(np.linspace(0.0, 1.0, _RINGS), azimuths, indexing="ij")
    around = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    centres = []
    for face in boundary.faces:
        if spec.is_cut(face.name):
            low, high = face.domain.radii(azimuths)
            chart = ((low + (high - low) * share)[..., None] * around).reshape(-1, 2)
            centres.append(ball_centres_mm(face.shape.points(chart), face.shape.normals(chart), offset_mm))
    distance, height = (np.concatenate(parts) for parts in zip(*centres, strict=True))
    return distance, height


def _rim(boundary: Boundary[Patch]) -> Lengths:
    return rim_radius(boundary)(sampled_azimuths())
