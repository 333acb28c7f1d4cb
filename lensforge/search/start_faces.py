"""The faces from which a search begins: those of the kind of the lens for these limits, this source and this beam."""

from dataclasses import dataclass
from math import radians

import numpy as np
from jaxtyping import Float

from lensforge.errors import remedy
from lensforge.results import Image
from lensforge.scene.body import Body
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import drawn_target, in_target, target_light
from lensforge.spec import Spec
from lensforge.spec.lens_section import Beam, LightAcross, StartConditions
from lensforge.surfaces.surface import Surface

_NARROWEST_BEAM_RAD = radians(0.1)
_DIGITS = 6  # of an angle (rad), by which pixels of one column are one


def start_faces(spec: Spec) -> dict[str, Surface]:
    """The faces by name from which the search begins, or those that the spec fixes; of several states for the first.

    Raises :class:`InputError` for sizes that leave no room for such a lens, and for faces that cross.
    """
    lens = spec.lens
    surfaces = lens.start_faces(start_conditions(spec))
    if lens.has_creases:
        with remedy("change lens.*.offset_mm, or leave it out"):
            Body.of(surfaces, lens.body_roles).require_sound()
    return surfaces


def start_conditions(spec: Spec) -> StartConditions:
    """Conditions that the first faces are to suit; of several states those of the first."""
    first = spec.in_first_state
    return StartConditions(
        spec.constraints, first.source.extent_mm, lambda: beam_of(first), lambda: light_across(first)
    )


def pixel_directions(receiver: PosedReceiver) -> Float[np.ndarray, "h w 3"]:
    """Unit directions in which the pixels' centres lie, as seen from the origin of the lens."""
    x, y = np.meshgrid(receiver.grid.x(), receiver.grid.y())
    points = receiver.places(x.ravel(), y.ravel())
    return (points / np.linalg.norm(points, axis=1, keepdims=True)).reshape(*x.shape, 3)


def pixel_angles_rad(receiver: PosedReceiver) -> Image:
    """Angle from the axis of the lens, as seen from its origin, under which each pixel's centre lies."""
    return np.arccos(np.clip(pixel_directions(receiver)[..., 2], -1.0, 1.0))


@dataclass(frozen=True)
class AngularSize:
    """Size of some light as seen from the lens (rad): of its middle from the axis, and its widths.

    The widths are those of an even rectangle with the same second moments.
    """

    off_axis_rad: float
    narrow_rad: float
    wide_rad: float

    @staticmethod
    def of(spec: Spec) -> "AngularSize":
        """The size of the light that the first receiver wants."""
        receiver = receivers_of(spec, spec.optimise.pixels)[0]
        light = target_light(spec.all_receivers[0].targets, receiver).ravel()
        directions = pixel_directions(receiver).reshape(-1, 3)
        middle = light @ directions
        middle /= np.linalg.norm(middle)
        across = directions - np.outer(directions @ middle, middle)
        moments = np.linalg.eigvalsh((across * light[:, None]).T @ across / light.sum())
        narrow, wide = np.sqrt(12.0 * np.maximum(moments[1:], 0.0)).tolist()
        return AngularSize(float(np.arccos(np.clip(middle[2], -1.0, 1.0))), narrow, wide)


@dataclass(frozen=True)
class TargetStroke:
    """Width of the broadest stroke of some light, by the largest circle in it: as seen from the lens, and in pixels."""

    width_rad: float
    pixels: float

    @staticmethod
    def of(spec: Spec) -> "TargetStroke":
        """The broadest stroke of the light that the first receiver wants, in pixels of the search."""
        from scipy.ndimage import distance_transform_edt

        receiver = receivers_of(spec, spec.evaluate.pixels)[0]
        drawn = drawn_target(spec.all_receivers[0].targets, receiver)
        rows, columns = receiver.grid.shape
        times = drawn.fine.columns // columns
        # in a row of n sub-pixels the middle is n/2 or (n + 1)/2 from the next outside
        widths = 2.0 * distance_transform_edt(np.pad(drawn.inside, 1))[1:-1, 1:-1] - 0.5
        across = widths.reshape(rows, times, columns, times).max(axis=(1, 3)) / times
        directions = pixel_directions(receiver)
        along = [axis for axis in (0, 1) if receiver.grid.shape[axis] > 1]  # a narrow one has a single row
        sides = [np.linalg.norm(np.gradient(directions, axis=axis), axis=2) for axis in along]
        seen = across * np.sqrt(sides[0] * sides[-1])
        return TargetStroke(float(seen.max()), float(across.max()) * spec.optimise.pixels / spec.evaluate.pixels)


def light_across(spec: Spec) -> LightAcross:
    """The light that the first target wants, by the angle in the plane y = 0 under which it is seen."""
    receiver = receivers_of(spec, spec.optimise.pixels)[0]
    light = target_light(spec.all_receivers[0].targets, receiver).ravel()
    directions = pixel_directions(receiver).reshape(-1, 3)
    angles, column = np.unique(np.arctan2(directions[:, 0], directions[:, 2]).round(_DIGITS), return_inverse=True)
    between = 0.5 * (angles[1:] + angles[:-1])
    edges = np.concatenate([2.0 * angles[:1] - between[:1], between, 2.0 * angles[-1:] - between[-1:]])
    shares = np.concatenate([[0.0], np.cumsum(np.bincount(column, light))])
    return LightAcross(edges, shares / shares[-1])


def beam_of(spec: Spec) -> Beam:
    """The light that the first target wants."""
    receiver = receivers_of(spec, spec.optimise.pixels)[0]
    section = spec.all_receivers[0]
    bright = in_target(target_light(section.targets, receiver))
    angles = pixel_angles_rad(receiver)
    directions = pixel_directions(receiver)[bright]
    middle = directions.mean(axis=0)
    off = np.arctan2(np.hypot(middle[0], middle[1]), middle[2])
    azimuth = np.arctan2(middle[1], middle[0])
    aside = np.arccos(np.clip(directions @ middle / np.linalg.norm(middle), -1.0, 1.0))
    half = np.sqrt(2.0 * np.mean(aside**2))  # of a cone that is evenly filled
    pixel = max(float(np.abs(np.diff(angles, axis=axis)).max(initial=0.0)) for axis in (0, 1))
    least = float(angles[bright].min())
    most = float(angles[bright].max())
    around = float(off), float(azimuth), float(half)
    return Beam(least if least > pixel else 0.0, max(most, _NARROWEST_BEAM_RAD), *around)
