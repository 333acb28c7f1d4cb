"""Light through a linear lens by lensforge, and by what docs/definitions.md says of one: sections 4 and 7."""

from math import inf

import numpy as np
import page_tracer
import pytest
from page_tracer import first_crossing, refracted, unit
from scipy.interpolate import BSpline

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.media import Media, Medium
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.drawn_profile import DrawnFace
from lensforge.surfaces.surface import surface_record

INDEX = 1.55
FACES = (
    DrawnFace(20.0, (0.27, 0.25, 0.262, 0.24, 0.25, 0.238, 0.235, 0.25, 0.262, 0.25)),
    DrawnFace(20.0, (0.10, 0.103, 0.099, 0.097, 0.098, 0.094, 0.097, 0.1, 0.103, 0.1)),
)
ACROSS = np.array([1.0, 0.0, 1.0])


class Profile:
    """A face of kind ``extruded`` by the formula of the page, for directions in the plane y = 0."""

    def __init__(self, record):
        k = np.array(record["coefficients"])
        high = 0.5 + 0.15 / np.pi
        step = 2.0 * high / (len(k) - 5)
        self.spline = BSpline(-high + step * np.arange(-5.0, len(k) + 1.0), k, 5)
        self.largest = 1.0 / self.spline(np.linspace(-0.5, 0.5, 999)).min()

    def radius(self, u):
        return 1.0 / self.spline(np.arctan2(u[:, 0], u[:, 2]) / np.pi)

    def normal(self, u):
        angle = np.arctan2(u[:, 0], u[:, 2]) / np.pi
        slope = self.spline(angle, 1) / np.pi
        v = self.spline(angle)
        x, z = u[:, 0], u[:, 2]
        return unit(np.column_stack([x * v + z * slope, 0.0 * x, z * v - x * slope]))


def along(profile, p, d):
    """Path of each ray to a profile, by its part across y."""
    across = d * ACROSS
    share = np.linalg.norm(across, axis=1)
    return first_crossing(profile, p * ACROSS, across / share[:, None]) / share


@pytest.mark.parametrize("length_mm", [None, 36.0])
def test_rays_flux_and_fates_are_those_of_the_page(length_mm: float | None) -> None:
    source = {"kind": "rectangle", "width_mm": 1.2, "height_mm": 30.0, "intensity": None, "spectrum": None}
    p, d, _ = page_tracer.emitted(source, 2048, 5)
    inner, outer = (Profile(surface_record(face).model_dump()) for face in FACES)
    ones = np.ones(len(p))
    start = p + along(inner, p, d)[:, None] * d
    stokes = 0.0 * ones, 0.0 * ones, unit(np.cross(d, [0.0, 0.0, 1.0]))
    within, first, stokes = refracted(FlatNormal(inner), start, d, ones, INDEX * ones, None, None, False, stokes)
    path = along(outer, start, within)
    end = start + path[:, None] * within
    out, second, _ = refracted(FlatNormal(outer), end, within, INDEX * ones, ones, None, None, True, stokes)
    fates = np.where(np.isnan(path), Fate.BASE, np.where(np.isnan(out[:, 0]), Fate.TOTAL_REFLECTION, Fate.LEFT_LENS))
    if length_mm is not None:
        fates[(fates == Fate.LEFT_LENS) & (np.abs(end[:, 1]) > 0.5 * length_mm)] = Fate.FLANGE
    grid = TableGrid(401)
    scene = Scene(Media(Medium(INDEX)), grid, drawn_half_mm=inf if length_mm is None else 0.5 * length_mm)
    exits = trace_tables(np.stack([tabulate(grid, face) for face in FACES]), scene, RayBundle(p, d, ones))
    assert (exits.fates == fates).mean() > 0.998  # all but some at a critical angle
    assert length_mm is None or 100 < (fates == Fate.FLANGE).sum() < 1000
    left = (exits.fates == Fate.LEFT_LENS) & (fates == Fate.LEFT_LENS)
    assert left.sum() > 800
    steep = np.abs(np.einsum("nk,nk->n", out, FlatNormal(outer).normal(unit(end)))) < 0.1  # where a table's error grows
    kept = left & ~steep
    assert np.abs(exits.points[kept] - end[kept]).max() < 1e-5
    assert np.abs(exits.directions[kept] - out[kept]).max() < 1e-5
    assert np.abs(exits.flux[kept] - (first * second)[kept]).max() < 1e-5


class FlatNormal:
    """The normals of a profile at points anywhere along y."""

    def __init__(self, profile):
        self.profile = profile

    def normal(self, u):
        return self.profile.normal(unit(u * ACROSS))
