"""Figures of a luminaire's data sheet by its photometric file: its luminance, cut-off angle and rating of glare.

Luminance is the mean over the luminous area, flat as UGR takes it: I / (A cos(gamma)) (EN 13032-1).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.addons.office.office_room import OfficeReadings
from lensforge.addons.office.office_section import OfficeSection
from lensforge.addons.office.unified_glare import UnifiedGlare
from lensforge.light.by_intensities import IntensityFigures, of_file
from lensforge.sources.photometric.photometric_file import PhotometricFile

GLARE_DEG = 65.0  # from which EN 12464-1 limits the luminance of lamps
HIGH_CD_PER_M2 = 3000.0  # its limit where screens are bright
LEAST_M2 = 0.005  # of the luminous area: below it UGR is not defined (CIE 147)
_STEP_DEG = 0.1
_LAST_DEG = 89.9
_ALONG_X, _ALONG_Y = 0.0, 90.0  # lines of sight over the lamps
_STREET_C_DEG = 270.0  # +y of the lens in a file
_ROUND = np.pi / 4.0


@dataclass(frozen=True)
class ProductFigures:
    """Figures of one luminaire.

    ``luminance_cd_per_m2``: largest over C at gamma = 65 degrees. ``cut_off_deg``: least gamma from which it nowhere
    exceeds 3000 cd/m². ``glare``: UGR of the room 4H 8H with reflectances 70/50/20, seen lengthways, along C = 90, and
    across, along C = 0; None for an area that is too small for it. The first two are None for lamps without an area.
    """

    luminance_cd_per_m2: float | None
    cut_off_deg: float | None
    glare: tuple[float, float] | None

    @staticmethod
    def of(file: PhotometricFile) -> "ProductFigures":
        """The figures of the luminaire in ``file``."""
        area_m2 = luminous_m2(file)
        if not area_m2 > 0.0:
            return ProductFigures(None, None, None)
        gammas = np.append(np.arange(0.0, _LAST_DEG, _STEP_DEG), _LAST_DEG)
        bright = gammas[_luminances(file, gammas, area_m2) > HIGH_CD_PER_M2]
        cut_off_deg = min(float(bright.max()) + _STEP_DEG, 90.0) if len(bright) else 0.0
        glare = _glare(file, area_m2) if area_m2 >= LEAST_M2 else None
        return ProductFigures(float(_luminances(file, np.array([GLARE_DEG]), area_m2)[0]), cut_off_deg, glare)


def luminous_m2(file: PhotometricFile) -> float:
    """Luminous area seen along the axis; 0 where the file states none."""
    opening = file.opening
    return 1e-6 * opening.width_mm * opening.length_mm * (_ROUND if opening.rounded else 1.0)


def _luminances(file: PhotometricFile, gamma_deg: Float[np.ndarray, " n"], area_m2: float) -> Float[np.ndarray, " n"]:
    """Largest luminance (cd/m²) over C at each angle."""
    table = file.intensity
    values = np.stack([np.interp(gamma_deg, table.gamma_deg, plane, right=0.0) for plane in table.values])
    return np.asarray(values.max(axis=0) / (area_m2 * np.cos(np.radians(gamma_deg))))


def _glare(file: PhotometricFile, area_m2: float) -> tuple[float, float]:
    side_m = float(np.sqrt(area_m2))  # its shape does not matter
    readings = OfficeReadings(OfficeSection(lighting_class="UGR 19", luminous_m=(side_m, side_m)))
    figures = IntensityFigures(of_file(file, _STREET_C_DEG, None))
    lengthways, across = (
        figures.figure(UnifiedGlare(), "<=", "", readings.glare(turn_deg)).value for turn_deg in (_ALONG_Y, _ALONG_X)
    )
    return lengthways, across
