"""What refraction at plain faces does, in closed form."""

from math import acos


def largest_deviation_rad(refractive_index: float) -> float:
    """Largest angle by which two refractions turn a ray, into a body and out of it: twice ``acos(1/n)``."""
    return 2.0 * acos(1.0 / refractive_index)


def normal_transmittance(refractive_index: float) -> float:
    """Transmittance of one surface at normal incidence, of that ratio of indices; 0.961 from air into PMMA."""
    return 1.0 - ((refractive_index - 1.0) / (refractive_index + 1.0)) ** 2
