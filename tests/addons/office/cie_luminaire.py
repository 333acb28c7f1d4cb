"""Example luminaire of CIE 190:2010: cd per 1000 lm from C 0 to C 90, mirrored at both planes; and an office."""

from typing import Any

import numpy as np

from lensforge.light.by_intensities import of_table
from lensforge.scene.intensity_limit import Candela
from lensforge.sources.intensity import TabulatedIntensity

QUARTER = np.array([
    [264, 264, 258, 258, 242, 216, 193, 178, 158, 136, 114, 92, 72, 54, 44, 27, 22, 14, 5],
    [264, 265, 257, 257, 244, 218, 194, 179, 160, 135, 115, 94, 73, 55, 44, 29, 21, 14, 5],
    [264, 264, 258, 255, 246, 223, 197, 181, 162, 140, 118, 99, 77, 59, 43, 34, 20, 13, 4],
    [264, 265, 260, 255, 249, 232, 208, 182, 167, 145, 123, 105, 86, 65, 47, 33, 18, 12, 3],
    [264, 264, 262, 256, 249, 238, 222, 194, 171, 153, 130, 111, 92, 75, 55, 36, 21, 8, 1],
    [264, 263, 261, 258, 251, 240, 231, 214, 189, 163, 143, 119, 99, 79, 61, 44, 25, 8, 0],
    [264, 264, 260, 257, 250, 240, 232, 217, 204, 184, 152, 125, 101, 79, 60, 43, 25, 9, 0],
], dtype=float)  # fmt: skip
C_DEG, GAMMA_DEG = np.arange(0.0, 361.0, 15.0), np.arange(0.0, 91.0, 5.0)
TABLE = np.vstack([QUARTER, QUARTER[-2::-1], QUARTER[1:], QUARTER[-2::-1]])
LUMINOUS_M = (1.0, 0.316)
OFFICE: dict[str, Any] = {"lighting_class": "UGR 19", "luminous_m": (0.6, 0.6)}


def luminaire() -> Candela:
    """Its intensities; C = 0 lies along x of a lamp."""
    return of_table(TabulatedIntensity(C_DEG, GAMMA_DEG, TABLE), 270.0, 1.0)
