"""Which points are out of reach of a surface, against its distance by brute force."""

import numpy as np
import pytest
from nightly import first_by_day
from scipy.spatial import cKDTree

from lensforge.kernels import clearance
from lensforge.kernels.clearance import nearest_on_table
from lensforge.surfaces.bicubic_table import grid_for, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import grid, to_sphere

_REACH_MM = 1.5


@pytest.mark.parametrize("functions", first_by_day(1, [81, 9]))
def test_each_point_within_reach_of_a_wavy_face_has_its_foot(functions: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(functions)
    basis = SrbfBasis((functions,), 1.75)
    face = SrbfSurface(basis, rng.normal(scale=0.35, size=functions), 10.0)
    of_table = grid_for(basis.detail_rad, 2.5)
    table = tabulate(of_table, face)
    directions = to_sphere(grid(of_table.nodes)[::2, ::2])
    nodes = face.radius(directions.reshape(-1, 3)).reshape(directions.shape[:2])[:, :, None] * directions
    starts = fibonacci_hemisphere(3000)[:2900]  # but the rim
    radial_mm = rng.uniform(0.2, 6.0, size=len(starts))
    points = (face.radius(starts) - radial_mm)[:, None] * starts

    def followed() -> set[int]:
        feet = nearest_on_table(
            table, of_table.origin, of_table.step, nodes, 2.0 * of_table.step, points, radial_mm, _REACH_MM
        )
        return set(feet.points.tolist())

    dense = fibonacci_hemisphere(400_000)
    distance_mm, _ = cKDTree(face.radius(dense)[:, None] * dense).query(points, distance_upper_bound=_REACH_MM)
    near = set(np.flatnonzero(np.isfinite(distance_mm)).tolist())
    assert near <= followed()
    assert 50 < len(near) < len(followed()) < 2000, "most of the others are not looked at"
    monkeypatch.setattr(clearance, "_STEEPER", 0.0)
    assert not near <= followed(), "a face without slopes would lose some: the scene tells"
