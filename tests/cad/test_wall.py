"""The wall between two faces, against closed forms and the nearest of many points."""

import numpy as np
import pytest
from known_shapes import Ellipsoid, sphere
from nightly import first_by_day
from scenes import hemisphere_directions, random_surface
from scipy.spatial import cKDTree

from lensforge.cad.patch import fit_patch
from lensforge.cad.wall import Span, thickest, thinnest
from lensforge.surfaces.surface import Surface

SMALL = 0.8
LARGE = 2.45


def span(inner: Surface, outer: Surface) -> Span:
    return thinnest(fit_patch(inner), fit_patch(outer))


def distance_of_points(inner: Surface, outer: Surface, count: int = 20_000) -> tuple[float, float]:
    """Least distance of many points of both faces, and least thickness along a ray."""
    u = hemisphere_directions(count)
    azimuth = np.linspace(0.0, 2.0 * np.pi, 2000)
    u = np.concatenate([u, np.stack([np.cos(azimuth), np.sin(azimuth), 0.0 * azimuth], axis=1)])
    a = inner.radius(u)
    b = outer.radius(u)
    ends = cKDTree(b[:, None] * u, leafsize=64)
    least = float((b - a).min())
    return float(ends.query(a[:, None] * u, distance_upper_bound=least + 0.1)[0].min()), least


def test_concentric_hemispheres_have_one_thickness() -> None:
    for figure in (thinnest, thickest):
        assert figure(fit_patch(sphere(SMALL)), fit_patch(sphere(LARGE))).thickness_mm == pytest.approx(1.65, abs=1e-7)


def test_the_wall_between_decentred_spheres_is_on_the_line_of_their_centres() -> None:
    c_in = np.array([0.1, 0.0, 0.2])
    c_out = np.array([-0.3, 0.2, -0.1])
    wall = span(sphere(SMALL, tuple(c_in)), sphere(LARGE, tuple(c_out)))
    shift = c_in - c_out
    assert wall.thickness_mm == pytest.approx(LARGE - SMALL - np.linalg.norm(shift), abs=1e-8)
    along = shift / np.linalg.norm(shift)
    np.testing.assert_allclose(wall.cavity_mm, c_in + SMALL * along, atol=1e-4)
    np.testing.assert_allclose(wall.envelope_mm, c_out + LARGE * along, atol=1e-4)
    assert np.linalg.norm(wall.envelope_mm - wall.cavity_mm) == pytest.approx(wall.thickness_mm, abs=1e-12)


def test_below_the_rim_there_is_no_face() -> None:
    """The centres' line points downwards: the wall is thinnest on the rim of the inner face, towards the outer one."""
    centre = np.array([0.3, 0.1, -0.3])
    wall = span(sphere(SMALL, tuple(centre)), sphere(LARGE))
    reach = np.linalg.norm(centre[:2]) + np.sqrt(SMALL**2 - centre[2] ** 2)
    assert wall.thickness_mm == pytest.approx(LARGE - reach, abs=1e-7)
    assert abs(wall.cavity_mm[2]) < 1e-7


def test_a_steep_cavity_has_its_wall_in_the_body_and_not_behind_it() -> None:
    """A line along the normal of this cavity, sought by secants, ended 12.3 mm behind its start, beyond the cavity."""
    inner = Ellipsoid((3.5, 6.4, 6.0), (-2.7, 0.0, 0.0))
    outer = Ellipsoid((13.5, 7.0, 7.0), (2.0, 0.0, 0.0))
    wall = span(inner, outer)
    (shortest, _) = distance_of_points(inner, outer)
    assert 0.1 < wall.thickness_mm <= shortest < wall.thickness_mm + 5e-3


@pytest.mark.parametrize("seed", first_by_day(1, range(3)))
def test_the_thinnest_wall_is_the_shortest_way_through(seed: int) -> None:
    inner = random_surface(seed, 3.0, 0.06, (9, 25))
    outer = random_surface(seed + 10, 5.0, 0.06, (9, 25))
    wall = span(inner, outer)
    (shortest, radial) = distance_of_points(inner, outer)
    assert shortest - 5e-3 < wall.thickness_mm <= shortest
    assert wall.thickness_mm < radial + 1e-9
    line = (wall.envelope_mm - wall.cavity_mm) / wall.thickness_mm
    for face, point in ((inner, wall.cavity_mm), (outer, wall.envelope_mm)):
        if point[2] > 1e-6:
            assert line @ face.normal((point / np.linalg.norm(point))[None])[0] == pytest.approx(1.0, abs=1e-9)


def test_crossing_faces_have_a_negative_wall() -> None:
    assert span(sphere(1.0), sphere(1.0, (0.0, 0.0, -0.1))).thickness_mm == pytest.approx(-0.1, abs=1e-7)


def test_the_thickest_wall_is_along_a_ray() -> None:
    """Between two spheres whose centres are 0.5 mm apart in z: 3.5 mm on the axis, less all around it."""
    wall = thickest(fit_patch(sphere(3.0)), fit_patch(sphere(6.0, (0.0, 0.0, 0.5))))
    assert wall.thickness_mm == pytest.approx(3.5, abs=1e-6)
    assert wall.cavity_mm == pytest.approx((0.0, 0.0, 3.0), abs=1e-6)
    assert wall.envelope_mm == pytest.approx((0.0, 0.0, 6.5), abs=1e-6)
