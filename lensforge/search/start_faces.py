"""The faces from which a search begins: those of the kind of the lens for these limits, this source and this beam."""

from math import radians

import numpy as np

from lensforge.errors import remedy
from lensforge.results import Image
from lensforge.scene.body import Body
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import in_target, target_light
from lensforge.spec import Spec
from lensforge.spec.lens_section import Beam, StartConditions
from lensforge.surfaces.surface import Surface

_NARROWEST_BEAM_RAD = radians(0.1)


def start_faces(spec: Spec) -> dict[str, Surface]:
    """The faces by name from which the search begins, or those that the spec fixes.

    Raises :class:`InputError` for sizes that leave no room for such a lens, and for faces that cross.
    """
    lens = spec.lens
    surfaces = lens.start_faces(StartConditions(spec.constraints, spec.source.extent_mm, lambda: beam_of(spec)))
    if lens.has_creases:
        with remedy("change lens.*.offset_mm, or leave it out"):
            Body.of(surfaces, lens.body_roles).require_sound()
    return surfaces


def pixel_angles_rad(receiver: PosedReceiver) -> Image:
    """Angle from the axis of the lens, as seen from its origin, under which each pixel's centre lies."""
    x, y = np.meshgrid(receiver.grid.x(), receiver.grid.y())
    points = receiver.places(x.ravel(), y.ravel())
    return np.arccos(np.clip(points[:, 2] / np.linalg.norm(points, axis=1), -1.0, 1.0)).reshape(x.shape)


def beam_of(spec: Spec) -> Beam:
    """The light that the first target wants."""
    receiver, section = receivers_of(spec, spec.optimise.pixels)[0], spec.all_receivers[0]
    bright, angles = in_target(target_light(section.targets, receiver)), pixel_angles_rad(receiver)
    pixel = max(float(np.abs(np.diff(angles, axis=axis)).max()) for axis in (0, 1))
    least, most = float(angles[bright].min()), float(angles[bright].max())
    return Beam(least if least > pixel else 0.0, max(most, _NARROWEST_BEAM_RAD))
