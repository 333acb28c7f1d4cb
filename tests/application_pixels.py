"""An application judged by the pixels of a far field, as a search does, and by a table of intensities, as a lens is."""

from collections.abc import Callable

import numpy as np

from lensforge.light.angular_grid import AngularGrid
from lensforge.light.by_intensities import of_lens
from lensforge.light.judged_limits import judged_limits
from lensforge.light.luminaire_classes import LampLight
from lensforge.optics.efficacy import Efficacy
from lensforge.results.criteria import JudgedLimits
from lensforge.scene.application_light import light_in
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.spec import Spec


def judged_both_ways(
    spec: Spec,
    intensity: Callable[[np.ndarray, np.ndarray], np.ndarray],
    pixels: int,
    gamma_nodes: int = 361,
) -> tuple[JudgedLimits, JudgedLimits]:
    """Limits of the one application of ``spec``, by lamps of an ``intensity`` (cd) of azimuth and polar angle (rad)."""
    receivers = receivers_of(spec, pixels)
    grid = receivers[0].grid
    x, y, z = np.moveaxis(receivers[0].places(*np.meshgrid(grid.x(), grid.y())), -1, 0)
    picture = intensity(np.arctan2(y, x), np.arccos(z)) * receivers[0].pixel_measure
    by_pixels = judged_limits(light_limits(spec, receivers, Efficacy(), 1.0), [np.stack([picture] * 16)], ["sky"])
    table = AngularGrid(144, np.linspace(0.0, 90.0, gamma_nodes))
    turns, gammas = np.meshgrid(np.radians(table.c_deg), np.radians(table.gamma_deg), indexing="ij")
    lamp = LampLight(table, np.stack([intensity(turns, gammas)] * 2), spec.photometry.street_side_deg)
    (entry,) = spec.applications
    by_table = light_in(entry).judged(of_lens(lamp, 1.0), entry.noun)
    return tuple(by_pixels), by_table.limits


def values_of(limits: JudgedLimits) -> list[float]:
    return [limit.metric.value for limit in limits]
