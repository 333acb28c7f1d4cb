"""Areas and intensity profiles against closed forms and numerical integrals."""

import numpy as np
import pytest
from PIL import Image
from scipy.integrate import dblquad, quad

from lensforge.errors import InputError
from lensforge.sources.build_source import build_source
from lensforge.sources.emitting_area import Disc, Rectangles, sobol
from lensforge.sources.intensity import CosinePower, TabulatedIntensity
from lensforge.sources.planar_emitter import LuminanceImage
from lensforge.spec.source_sections import SquareSource

POINTS = sobol(2**16, 2, 7)


def test_rectangles_are_uniform_and_share_the_flux():
    centres, sides = np.array([[1.0, 0.0], [-1.0, 0.5]]), np.array([[0.5, 1.0], [0.25, 2.0]])
    placed = Rectangles(centres, sides, np.array([0.25, 0.75])).place(POINTS)
    right = placed[:, 0] > 0.0
    assert right.mean() == pytest.approx(0.25, abs=1e-4)
    for inside, centre, side in ((right, *[a[0] for a in (centres, sides)]), (~right, centres[1], sides[1])):
        local = (placed[inside] - centre) / side
        assert np.abs(local).max() <= 0.5
        np.testing.assert_allclose(local.mean(axis=0), 0.0, atol=1e-3)
        np.testing.assert_allclose(np.cov(local.T), np.eye(2) / 12.0, atol=1e-3)


@pytest.mark.parametrize(
    ("centres", "sides", "shares", "name"),
    [
        ([[0, 0]], [[2, 1]], [1.0], "rectangle"),
        ([[0, 0]], [[1, 1]], [1.0], "square"),
        ([[1, 0], [-1, 0]], [[1, 1]] * 2, [0.5, 0.5], "rectangle"),
        ([[1, 0], [-1, 0]], [[1, 1]] * 2, [0.4, 0.6], "mirror_y"),
        ([[0, 1], [0, -1]], [[1, 1]] * 2, [0.4, 0.6], "mirror_x"),
        ([[1, 0], [-1, 0], [0, 1], [0, -1]], [[1, 2]] * 2 + [[2, 1]] * 2, [0.25] * 4, "square"),
        ([[1, 0], [-1, 0], [0, 1], [0, -1]], [[1, 2]] * 4, [0.25] * 4, "rectangle"),
        ([[0.1, 0.2]], [[1, 1]], [1.0], "none"),
    ],
)
def test_symmetry_of_rectangles(centres, sides, shares, name):
    assert Rectangles(np.array(centres, float), np.array(sides, float), np.array(shares)).symmetry == name


def test_disc_is_uniform():
    radius_squared = np.sum(Disc(2.0).place(POINTS) ** 2, axis=1)
    np.testing.assert_allclose(np.quantile(radius_squared, [0.25, 0.5, 1.0]), [1.0, 2.0, 4.0], rtol=1e-3)


def test_picture_gives_every_pixel_its_share_the_right_way_up(tmp_path):
    values = np.array([[0, 10, 40], [20, 80, 90]], dtype=np.uint8)
    Image.fromarray(values).save(tmp_path / "led.png")
    picture = LuminanceImage.read(tmp_path / "led.png", width_mm=3.0)
    x, y = picture.place(POINTS).T
    counts, _, _ = np.histogram2d(y, x, bins=[[-1.0, 0.0, 1.0], [-1.5, -0.5, 0.5, 1.5]])
    np.testing.assert_allclose(counts[::-1] / len(x), values / values.sum(), atol=2e-4)
    assert picture.symmetry == "none"
    np.testing.assert_allclose(picture.corners()[:, 0], [-1.5, 1.5, 1.5, -1.5])


@pytest.mark.parametrize(
    ("rows", "name"),
    [
        ([[1, 2, 1], [3, 4, 3]], "mirror_x"),
        ([[1, 5], [1, 5]], "mirror_y"),
        ([[1, 2, 1]], "rectangle"),
        ([[1, 2, 1], [2, 5, 2], [1, 2, 1]], "square"),
        ([[1, 2], [2, 1]], "none"),
    ],
)
def test_symmetry_of_pictures(rows, name):
    assert LuminanceImage(np.array(rows, dtype=np.float64), 1.0).symmetry == name


def test_pictures_that_cannot_be_used_are_one_line(tmp_path):
    Image.new("L", (4, 4)).save(tmp_path / "dark.png")
    (tmp_path / "text.png").write_text("no picture", encoding="utf-8")
    for name, message in (("dark.png", "dark"), ("text.png", "not a readable image"), ("none.png", "no such file")):
        with pytest.raises(InputError, match=message):
            LuminanceImage.read(tmp_path / name, 1.0)


@pytest.mark.parametrize("power", [0.0, 1.0, 2.5, 80.0])
def test_cosine_power_has_its_closed_form_moments(power):
    cosine = CosinePower(power).aim(POINTS)[:, 2]
    assert cosine.mean() == pytest.approx((power + 1.0) / (power + 2.0), rel=1e-4)
    assert cosine.min() > 0.0


def _bilinear(table, c, gamma):
    plane = np.interp(c, table.c_deg, np.arange(len(table.c_deg)))
    low = min(int(plane), len(table.c_deg) - 2)
    first, second = (np.interp(gamma, table.gamma_deg, table.values[i]) for i in (low, low + 1))
    return first + (plane - low) * (second - first)


TABLE = TabulatedIntensity(
    np.array([0.0, 100.0, 220.0, 360.0]),
    np.array([0.0, 15.0, 50.0, 120.0]),
    np.array([[1.0, 0.2, 0.0, 0.0], [1.0, 3.0, 1.0, 0.0], [1.0, 0.0, 4.0, 0.5], [1.0, 0.2, 0.0, 0.0]]),
)


def test_flux_of_a_table_is_the_integral_of_its_interpolation():
    def integrand(gamma, c):
        return _bilinear(TABLE, c, gamma) * np.sin(np.deg2rad(gamma))

    parts = [
        dblquad(integrand, *c, *g, epsabs=1e-8)[0]
        for c in ((0, 100), (100, 220), (220, 360))
        for g in ((0, 15), (15, 50), (50, 120))
    ]
    assert TABLE.flux() == pytest.approx(sum(parts) * np.deg2rad(1.0) ** 2, rel=1e-9)


def test_a_table_is_drawn_as_it_is_written():
    """Every cell of the sphere gets its share of the flux, to the noise of the points."""
    directions = TABLE.aim(sobol(2**17, 2, 3))
    gamma = np.rad2deg(np.arccos(directions[:, 2]))
    c = np.rad2deg(np.arctan2(directions[:, 1], directions[:, 0])) % 360.0
    c_edges, gamma_edges = np.linspace(0.0, 360.0, 10), np.linspace(0.0, 120.0, 7)
    counts, _, _ = np.histogram2d(c, gamma, bins=[c_edges, gamma_edges])
    fine_c, fine_g = 0.5 + np.arange(360.0), 0.125 + np.arange(0.0, 120.0, 0.25)
    density = np.array([[_bilinear(TABLE, a, b) * np.sin(np.deg2rad(b)) for b in fine_g] for a in fine_c])
    expected, _, _ = np.histogram2d(
        *(axis.ravel() for axis in np.meshgrid(fine_c, fine_g, indexing="ij")),
        bins=[c_edges, gamma_edges], weights=density.ravel(),
    )  # fmt: skip
    np.testing.assert_allclose(counts / counts.sum(), expected / expected.sum(), atol=3e-4)


def test_a_table_of_revolution_that_is_lambertian_is_lambertian():
    gamma = np.linspace(0.0, 90.0, 181)
    table = TabulatedIntensity(np.zeros(1), gamma, np.cos(np.deg2rad(gamma))[None])
    assert table.flux() == pytest.approx(np.pi, rel=3e-5)
    assert table.symmetry == "square"
    sine_squared = 1.0 - table.aim(POINTS)[:, 2] ** 2
    np.testing.assert_allclose(np.quantile(sine_squared, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=1e-3)


def test_light_between_two_angles_stays_between_them():
    table = TabulatedIntensity(np.zeros(1), np.array([30.0, 40.0]), np.array([[1.0, 1.0]]))
    gamma = np.rad2deg(np.arccos(table.aim(POINTS)[:, 2]))
    assert gamma.min() >= 30.0 and gamma.max() <= 40.0 + 1e-9
    exact = quad(lambda g: g * np.sin(np.deg2rad(g)), 30, 40)[0] / quad(lambda g: np.sin(np.deg2rad(g)), 30, 40)[0]
    assert gamma.mean() == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize(
    ("planes", "name"),
    [
        ([1, 2, 3, 2, 1], "mirror_y"),
        ([1, 2, 1, 4, 1], "mirror_x"),
        ([1, 2, 1, 2, 1], "rectangle"),
        ([2, 2, 2, 2, 2], "square"),
        ([1, 2, 3, 4, 1], "none"),
    ],
)
def test_symmetry_of_tables(planes, name):
    values = np.outer(planes, [1.0, 0.5, 0.0])
    assert TabulatedIntensity(np.linspace(0.0, 360.0, 5), np.array([0.0, 30.0, 60.0]), values).symmetry == name


@pytest.mark.parametrize("side_mm", [0.5, 2.0])
def test_the_outline_of_a_square_is_where_its_rays_start(side_mm):
    source = build_source(SquareSource(side_mm=side_mm))
    outline, origins = source.outline(), source.sample(2**12, 1).origins
    np.testing.assert_allclose(np.abs(outline[:, :2]), side_mm / 2.0)
    np.testing.assert_allclose(np.abs(origins[:, :2]).max(axis=0), side_mm / 2.0, rtol=2e-3)
    assert (np.abs(origins[:, :2]) <= side_mm / 2.0).all()
