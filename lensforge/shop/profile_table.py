"""Faces of revolution on the drawing, and profiles of a linear lens: the equation of a known form, or else a table.

The table has places along the meridian, or along the profile from foot to foot.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import domain_of
from lensforge.scene.lens import Lens
from lensforge.shop.check_facts import face_title
from lensforge.spec.spec_section import rounded_up
from lensforge.surfaces.asphere import Asphere, Biconic
from lensforge.surfaces.drawn_profile import in_section
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace
from lensforge.surfaces.surface import Surface, to_sphere

PLACES = 17  # columns of the table
DIGITS = 4  # of its lengths (mm): 0.1 um
_SIDES = {-1: ", x < 0", 0: "", 1: ", x > 0"}
_DENSE = 2001  # places of a meridian along which lengths and errors are measured
_UM_PER_MM = 1e3
PROFILE_NOTE = "Profiles: distance r from the axis and height z, mm; the spline is cubic over the chords."
DRAWN_NOTE = "Profiles: x and z, mm, the same at every y; the spline is cubic over the chords."
ASPHERE_NOTE = "Asphere: z = z_v + (r^2/R) / (1 + √(1 − (1 + k) r^2/R^2)) + A4 r^4 + A6 r^6 + …, mm."

Meridian = Float[np.ndarray, "n 2"]  # distance from the axis, or x of a linear lens, and height (mm)


def is_round(lens: Lens) -> bool:
    """True where all faces of ``lens`` are of revolution."""
    return all(map(lens.spec.lens.is_revolved, lens.spec.lens.names))


def equation(surface: Surface) -> str | None:
    """The equation of a known form with its numbers (mm), to a nanometre; None for any other. rho, theta: polar."""
    match surface:
        case PlaneFace(axis=(0.0, 0.0, _)):
            return _stated("plane", z=surface.height_mm)
        case ConeFace():
            steep = abs(surface.slope)
            sign = "−" if surface.slope < 0.0 else "+"
            angle = f"{np.degrees(np.arctan(steep)):.3f}° to the axis"
            return f"{_stated('cone', r=surface.radius_mm)} {sign} {steep:.8g} z, {angle}"
        case ConicFace(axis=(0.0, 0.0, _)):
            return _stated("conic ρ = p / (1 − e cos θ),", p=surface.parameter_mm, e=surface.eccentricity)
        case Asphere(vertex_mm=vertex, radius_mm=radius, conic=conic, coefficients=series):
            if not (conic or series):
                return f"{_stated('sphere', R=abs(radius))}, {_stated('centre', z=vertex + radius)}"
            powers = {f"A{2 * k + 4}": coefficient for k, coefficient in enumerate(series)}
            return _stated("asphere", z_v=vertex, R=radius, k=conic, **powers)
        case Biconic(vertex, radius_x, radius_y, conic_x, conic_y):
            return _stated("biconic", z_v=vertex, Rx=radius_x, Ry=radius_y, kx=conic_x, ky=conic_y)
    return None


def _stated(form: str, **sizes: float) -> str:
    return f"{form} {', '.join(f'{name} = {size:.8g}' for name, size in sizes.items())}"


@dataclass(frozen=True, eq=False)
class Profile:
    """The meridian of a face: ``places_mm`` in the digits of the sheet, evenly along it, from the axis or a crease on.

    ``error_um``: the largest distance from the face of a cubic spline through them over the length of their chords.
    ``across``: symbol of the first of two coordinates, r or x.
    """

    title: str
    places_mm: Meridian
    error_um: float
    across: str = "r"

    @property
    def rows(self) -> list[list[str]]:
        """Rows of r and of z, each with its label."""
        labels = f"{self.title}: {self.across}", f"z; spline within {rounded_up(self.error_um, 2)} µm"
        columns = zip(labels, self.places_mm.T, strict=True)
        return [[label, *(f"{value:.{DIGITS}f}" for value in values + 0.0)] for label, values in columns]


def profiles_of(lens: Lens, face: str) -> list[Profile]:
    """The meridian of a face of revolution over its part of the body, or each arc of one that is drawn along y."""
    surface = lens.surfaces[face]
    title = face_title(face)
    if lens.spec.lens.drawn_mm is not None:
        arcs = [arc for arc in lens.body.arcs(lens.body.face(face).before) if arc.name == face]
        return [_tabulated(f"{title}{_SIDES[arc.side]}", surface, in_section(arc.angles(_DENSE)), "x") for arc in arcs]
    turn = np.zeros(1)
    (low,), (high,) = domain_of(lens, face).radii(turn)
    chart = np.linspace(low, high, _DENSE)
    return [_tabulated(title, surface, to_sphere(np.column_stack([chart, np.zeros(_DENSE)])), "r")]


def _tabulated(title: str, surface: Surface, directions: Float[np.ndarray, "n 3"], across: str) -> Profile:
    """Places evenly along the curve of ``surface`` over these ``directions`` in the plane y = 0."""
    curve = surface.radius(directions)[:, None] * directions[:, ::2]
    length = way_along(curve)
    even = np.linspace(0.0, length[-1], PLACES)
    angles = np.arctan2(directions[:, 0], directions[:, 2])
    chosen = in_section(np.interp(even, length, angles))
    places = np.round(surface.radius(chosen)[:, None] * chosen[:, ::2], DIGITS)
    error_um = _UM_PER_MM * float(np.abs(distance_mm(surface, spline_through(places))).max())
    return Profile(title, places, error_um, across)


def spline_through(places: Meridian) -> Float[np.ndarray, "d 2"]:
    """Dense points of the cubic spline through ``places`` over the length of their chords."""
    from scipy.interpolate import CubicSpline

    length = way_along(places)
    return np.asarray(CubicSpline(length, places)(np.linspace(0.0, length[-1], _DENSE)))


def distance_mm(surface: Surface, meridian: Meridian) -> Float[np.ndarray, " n"]:
    """Distances (mm) along the normal of points of a meridian from a surface of revolution."""
    points = np.column_stack([meridian[:, 0], np.zeros(len(meridian)), meridian[:, 1]])
    away = np.linalg.norm(points, axis=1)
    directions = points / away[:, None]
    slant = np.sum(surface.normal(directions) * directions, axis=1)
    return np.asarray((away - surface.radius(directions)) * slant)


def way_along(points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Arc length (mm) of the polyline up to each point."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def has_profile(lens: Lens, face: str) -> bool:
    """True where one curve tells all of a face: a meridian, or the profile of a linear lens."""
    return lens.spec.lens.drawn_mm is not None or lens.spec.lens.is_revolved(face)


def profile_rows(lens: Lens, faces: Sequence[str]) -> list[list[str]]:
    """Rows for those ``faces``, of revolution or drawn along y, that have no equation."""
    told = [name for name in faces if has_profile(lens, name)]
    listed = [name for name in told if equation(lens.surfaces[name]) is None]
    return [row for name in listed for profile in profiles_of(lens, name) for row in profile.rows]


def profile_widths(width_mm: float) -> list[float]:
    """Widths of the columns of a table of ``width_mm``, the first one a sixth."""
    return [width_mm / 6.0, *[width_mm * 5.0 / 6.0 / PLACES] * PLACES]
