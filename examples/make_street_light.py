"""Write examples/street_light.ies, the target of examples/from_ies.toml: light along a road, more of it ahead.

python examples/make_street_light.py
"""

from pathlib import Path

import numpy as np

from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import write_photometric
from lensforge.sources.photometric.photometric_file import LampSet, PhotometricFile

ALONG_DEG, ACROSS_DEG = 55.0, 30.0  # standard deviations of the beam along the road (C 0 and C 180) and across it
AHEAD_DEG = 12.0  # tilt of the beam across the road, towards C 90
LUMENS = 1000.0


def intensity() -> TabulatedIntensity:
    """Intensity (cd) over C and gamma: a wide beam tilted across the road, cut off softly at 75 degrees."""
    c_deg, gamma_deg = np.arange(0.0, 361.0, 5.0), np.arange(0.0, 91.0, 1.0)
    azimuth = np.radians(c_deg)[:, None]
    along, across = gamma_deg * np.cos(azimuth), gamma_deg * np.sin(azimuth)
    values = np.exp(-0.5 * ((along / ALONG_DEG) ** 2 + ((across - AHEAD_DEG) / ACROSS_DEG) ** 2))
    values = values / (1.0 + np.exp((gamma_deg - 75.0) / 2.0))
    values[:, -1] = 0.0
    table = TabulatedIntensity(c_deg, gamma_deg, values)
    return TabulatedIntensity(c_deg, gamma_deg, np.round(values * (LUMENS / table.flux()), 3))


if __name__ == "__main__":
    path = Path(__file__).parent / "street_light.ies"
    file = PhotometricFile(
        intensity(), (LampSet(LUMENS),), title="light along a road", test="none: a formula", laboratory="",
        generated="", method="",
    )  # fmt: skip
    write_photometric(path, file)
    print(path)
