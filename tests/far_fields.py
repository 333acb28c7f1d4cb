"""Far fields for the tests of photometric files, and a flux by scipy: no code shared with the writers."""

from itertools import pairwise

import numpy as np
from scipy.integrate import simpson
from scipy.interpolate import RegularGridInterpolator

from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import PhotometricFile
from lensforge.sources.photometric.photometric_file import LampSet

# A file of three planes and four angles, whose light is uneven.
SMALL_IES = """IESNA:LM-63-2002
TILT=NONE
1 1000 1 4 3 1 2 0 0 0
1 1 10
0 45 80 90
0 90 180
100 200 30 0
100 80 60 0
100 50 20 0
"""

GAMMA = np.linspace(0.0, 90.0, 37)
TURN = np.linspace(0.0, 360.0, 25)


def far_field(kind, lumens):
    """Light of revolution, with two mirror planes, or with none; relative to ``lumens`` of the lamp, or absolute."""
    turn = np.zeros(1) if kind == "revolution" else TURN
    c, gamma = np.deg2rad(turn)[:, None], np.deg2rad(GAMMA)[None, :]
    shape = {"revolution": 0.0 * c, "rectangle": 0.4 * np.cos(2.0 * c), "none": 0.5 * np.cos(c - 0.3)}[kind]
    values = 123.4567 * np.cos(gamma) ** 2 * (1.0 + shape * np.sin(gamma)) + 1e-5
    values[-1] = values[0]
    file = PhotometricFile(
        TabulatedIntensity(turn, GAMMA, values), (LampSet(lumens, 2.5),), title="a lens", catalogue="L 1"
    )
    assert ("revolution" if kind == "revolution" else TabulatedIntensity.of(file.intensity).symmetry) == kind
    return file


def flux(c_deg, gamma_deg, candela):
    """Integral of the bilinear table over all directions (lm): Simpson's rule within each cell of gamma."""
    if len(c_deg) == 1:
        c_deg, candela = np.array([0.0, 360.0]), np.repeat(candela, 2, axis=0)
    fine = np.unique(np.concatenate([np.linspace(a, b, 21) for a, b in pairwise(gamma_deg)]))
    points = np.stack(np.meshgrid(c_deg, fine, indexing="ij"), axis=-1)
    at = RegularGridInterpolator((c_deg, gamma_deg), candela)(points)
    per_plane = simpson(at * np.sin(np.deg2rad(fine)), x=np.deg2rad(fine), axis=1)
    return float(np.trapezoid(per_plane, np.deg2rad(c_deg)))
