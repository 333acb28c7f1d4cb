"""What a surface lets through at normal incidence: a number of the material alone."""


def normal_transmittance(refractive_index: float) -> float:
    """Transmittance of one surface at normal incidence; two of them bound a lens's efficiency, 0.923 for PMMA."""
    return 1.0 - ((refractive_index - 1.0) / (refractive_index + 1.0)) ** 2
