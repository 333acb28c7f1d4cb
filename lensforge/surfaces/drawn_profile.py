"""Faces that are a profile drawn along y: its reciprocal distance from the y axis as a spline of the angle from z.

Seen from the origin ``1/rho`` is ``q S(theta)``, where q is the length of the direction's shadow in the plane y = 0 and
theta the angle of that shadow from the z axis, positive towards +x: smooth but for the poles on the y axis, where the
face is far away. Rays meet such a face by their shadows (``kernels.drawn_faces``), in the plane y = 0 alone, so that
its radius elsewhere serves curvatures and normals beside that plane.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.surfaces.profile import ProfileBasis, Reciprocals
from lensforge.surfaces.reciprocal import ReciprocalSurface
from lensforge.surfaces.surface import gradient_on_sphere, recorded, to_chart, to_sphere

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]

BEYOND_RAD = 0.15  # below the plane z = 0 up to which a profile bends: tables and exports reach a little below it
_SIDES = 2001  # angles at which profiles are compared
_DETAIL = 0.7  # of a step between knots: sigma of a Gaussian as wide as a quintic B-spline
_FAR = 1e-4  # weight, in a fit, of places without points
_STRAIGHT = 3e-3  # and of third differences, by which a profile goes on beyond its ends
_BESIDE = 0.25  # of the chart: no farther from the section is a part looked at
_TINY = np.finfo(float).tiny


def profile_basis(count: int) -> ProfileBasis:
    """The functions of a profile with ``count`` coefficients, over the angle as a share of a half turn."""
    side = 0.5 + BEYOND_RAD / np.pi
    return ProfileBasis(-side, side, count)


def in_half_turns(directions: _Vectors) -> tuple[_Values, _Values]:
    """Lengths of the shadows of unit ``directions`` in the plane y = 0, and their angles from z in half turns."""
    return np.hypot(directions[:, 0], directions[:, 2]), np.arctan2(directions[:, 0], directions[:, 2]) / np.pi


def in_section(angles_rad: _Values) -> _Vectors:
    """Unit directions in the plane y = 0 at these angles from z, positive towards +x."""
    return np.column_stack([np.sin(angles_rad), np.zeros_like(angles_rad), np.cos(angles_rad)])


def beside_section(directions: _Vectors) -> _Vectors:
    """Directions drawn towards the plane y = 0; on it they and their first two derivatives are unchanged.

    A profile that comes near the y axis goes up steeply towards its poles, where no ray asks for it.
    """
    chart = to_chart(directions)
    return to_sphere(np.column_stack([chart[:, 0], _BESIDE * np.tanh(chart[:, 1] / _BESIDE)]))


def _scale(chart: Float[np.ndarray, "n 2"]) -> _Values:
    """Length on the sphere for a unit of the chart."""
    return 2.0 / (1.0 + np.sum(chart**2, axis=1))


@recorded("extruded", "A face drawn along y: the reciprocal distance (1/mm) from the y axis as a spline of the angle.")
@dataclass(frozen=True)
class DrawnFace(ReciprocalSurface):
    """A profile drawn along y: ``coefficients`` times the functions of :func:`profile_basis` are S, in 1/mm.

    ``reach_mm``: distance from the origin up to which ``radius`` is that of the face; beyond, it is continued smoothly.
    """

    coefficients: Reciprocals

    def __post_init__(self) -> None:
        if not np.isfinite(self.coefficients).all():
            raise InputError("extruded: a coefficient is infinite, or no number")
        self._require_closed()
        super().__post_init__()

    def _require_closed(self) -> None:
        least = float(self._splines[0](np.linspace(0.0, len(self.coefficients) - 5.0, _SIDES)).min())
        if not least > 0.0:
            raise InputError(f"extruded: the profile falls to {least:.3g} /mm, and meets itself; it must stay above 0")

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest function of its basis."""
        return _DETAIL * np.pi * self.basis.step

    @property
    def mirrored(self) -> "DrawnFace":
        """The mean of the face and its image in the plane x = 0."""
        sides = np.array(self.coefficients)
        return replace(self, coefficients=tuple((0.5 * (sides + sides[::-1])).tolist()))

    def with_coefficients(self, count: int) -> "DrawnFace":
        """The nearest face of so many coefficients; itself where it has them."""
        if count == len(self.coefficients):
            return self
        basis = profile_basis(count)
        angles = np.linspace(basis.low, basis.high, _SIDES)
        return replace(self, coefficients=basis.nearest(angles, self.basis.value(self._splines, angles)))

    @cached_property
    def basis(self) -> ProfileBasis:
        """Functions that the coefficients weigh."""
        return profile_basis(len(self.coefficients))

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "rectangle" if self.coefficients == self.coefficients[::-1] else "mirror_y"

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``q S`` and its gradient in space."""
        shadow, angle = in_half_turns(directions)
        value, slope = self.basis.at(self._splines, angle)
        x, z = (directions[:, axis] / np.maximum(shadow, _TINY) for axis in (0, 2))
        slope = slope / np.pi
        return shadow * value, np.column_stack([x * value + z * slope, np.zeros_like(x), z * value - x * slope])

    def value(self, directions: _Vectors) -> _Values:
        """``q S``."""
        shadow, angle = in_half_turns(directions)
        return shadow * self.basis.value(self._splines, angle)

    def points(self, angles_rad: _Values) -> Float[np.ndarray, "n 2"]:
        """Points (x, z) in mm of the profile at angles from z, positive towards +x."""
        distances = 1.0 / self.basis.value(self._splines, angles_rad / np.pi)
        return distances[:, None] * np.column_stack([np.sin(angles_rad), np.cos(angles_rad)])

    @cached_property
    def _splines(self):  # type: ignore[no-untyped-def]  # three splines of SciPy
        return self.basis.splines(np.array(self.coefficients))


@recorded("extruded_part", "A face drawn along y that bounds its medium at some angles: elsewhere another is nearer.")
@dataclass(frozen=True)
class DrawnPart(DrawnFace):
    """A profile that bounds its medium at some angles. At the others, where faces hide it, S may be 0 or below."""

    @staticmethod
    def through(points: Float[np.ndarray, "n 2"], reach_mm: float, count: int) -> "DrawnPart":
        """The nearest profile to ``points`` (x, z), in S: far away without any, straight on beyond its feet."""
        basis = profile_basis(count)
        angles = np.arctan2(points[:, 0], points[:, 1]) / np.pi
        everywhere = np.linspace(basis.low, basis.high, _SIDES)
        known = np.sort(np.concatenate([angles, everywhere[np.abs(everywhere) > 0.5]]))
        place = np.clip(np.searchsorted(known, everywhere), 1, len(known) - 1)
        empty = everywhere[known[place] - known[place - 1] > basis.step]
        far = np.concatenate([_FAR * basis.matrix(empty), _STRAIGHT * np.diff(np.eye(count), 3, axis=0)])
        rows = np.concatenate([basis.matrix(angles), far])
        wanted = np.concatenate([1.0 / np.hypot(points[:, 0], points[:, 1]), np.zeros(len(far))])
        return DrawnPart(reach_mm, tuple(np.linalg.lstsq(rows, wanted, rcond=None)[0].tolist()))

    @cached_property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature: of its functions, or of a Gaussian as high and as curved as its radius.

        The latter is where it goes over into its continuation.
        """
        angles, step = np.linspace(-0.5 * np.pi - BEYOND_RAD, 0.5 * np.pi + BEYOND_RAD, _SIDES, retstep=True)
        radii = self.radius(in_section(angles))
        curvature = float(np.abs(np.diff(radii, 2)).max()) / step**2
        return min(super().detail_rad, float(np.sqrt(2.0 * np.ptp(radii) / max(curvature, _TINY))))

    def radius(self, directions: _Vectors) -> _Values:
        """``rho`` (mm) at unit ``directions``, taken :func:`beside_section`."""
        return super().radius(beside_section(directions))

    def gradient(self, directions: _Vectors) -> _Vectors:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad)."""
        beside = beside_section(directions)
        chart, there = to_chart(directions), to_chart(beside)
        gradient = super().gradient(beside)
        away = np.zeros(len(there)), np.ones(len(there))
        along_x, along_y = (
            _scale(there)[:, None] * (np.column_stack([*unit, -there[:, axis]]) - there[:, [axis]] * beside)
            for axis, unit in enumerate((away[::-1], away))
        )
        slopes = np.column_stack([(gradient * along_x).sum(axis=1), (gradient * along_y).sum(axis=1)])
        return gradient_on_sphere(chart, slopes * np.column_stack([away[1], np.cosh(chart[:, 1] / _BESIDE) ** -2.0]))

    def _require_closed(self) -> None:
        pass


REACH = 1.6  # of a face over the largest radius of its lens


def round_profile(radius_mm: float, largest_mm: float, count: int) -> DrawnFace:
    """The cylinder of ``radius_mm`` about the y axis, in a lens whose profiles stay within ``largest_mm``."""
    return DrawnFace(REACH * largest_mm, (1.0 / radius_mm,) * count)
