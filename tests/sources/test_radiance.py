"""Radiance tables: étendue and closed forms, the sources that a separable table must equal, and files that are none."""

from contextlib import suppress

import numpy as np
import pytest
from radiance_samples import write_radiance

from lensforge.errors import InputError
from lensforge.sources.emitting_area import Rectangles, sobol
from lensforge.sources.intensity import CosinePower, TabulatedIntensity
from lensforge.sources.planar_emitter import PlanarEmitter
from lensforge.sources.radiance_emitter import RadianceEmitter, RadianceTable, read_radiance

AREA_M2 = 6e-6
X, Y = np.array([-1.0, 0.5, 2.0]), np.array([0.0, 1.0, 2.0])  # 3 mm x 2 mm in four cells


def table(values, c_deg=(0.0,), gamma_deg=(0.0, 90.0), x=X, y=Y):
    c, gamma = np.array(c_deg), np.array(gamma_deg)
    shape = (len(y) - 1, len(x) - 1, len(c), len(gamma))
    return RadianceTable(x, y, c, gamma, np.broadcast_to(np.asarray(values, dtype=np.float64), shape).copy())


def moments(rays):
    x, y, _ = rays.origins.T
    kx, ky, kz = rays.directions.T
    values = np.array(
        [x, y, x * x, y * y, x * y, kx, ky, kz, kx * kx, ky * ky, kz * kz, x * kx, y * ky, x * ky, x * kz]
    )
    return values @ rays.flux / rays.flux.sum()


@pytest.mark.parametrize("gamma_max", [10.0, 45.0, 90.0])
def test_flux_over_radiance_is_the_etendue(gamma_max):
    """pi A sin^2 of the cone's half angle, for any number of nodes."""
    for nodes in (2, 7):
        cone = table(3.0, gamma_deg=np.linspace(0.0, gamma_max, nodes))
        assert cone.flux() == pytest.approx(3.0 * np.pi * AREA_M2 * np.sin(np.deg2rad(gamma_max)) ** 2, rel=1e-14)


def test_a_constant_table_is_the_lambertian_rectangle_ray_by_ray():
    flat = RadianceEmitter(table(1.0, c_deg=np.linspace(0.0, 360.0, 9), gamma_deg=np.linspace(0.0, 90.0, 6)), 2.0)
    rays, points = flat.sample(4096, 5), sobol(4096, 4, 5)
    np.testing.assert_allclose(rays.directions, CosinePower(1.0).aim(points[:, 2:]), atol=1e-12)
    np.testing.assert_allclose(rays.origins[:, :2], points[:, [1, 0]] * [3.0, 2.0] + [-1.0, 0.0], atol=1e-12)
    assert rays.flux.sum() == pytest.approx(2.0, rel=1e-12)


def test_a_separable_table_is_area_times_intensity():
    """Radiance of one profile with a strength for each cell: what PlanarEmitter draws in another way."""
    strength, gamma = np.array([[1.0, 4.0], [0.0, 2.0]]), np.linspace(0.0, 75.0, 301)
    c = np.linspace(0.0, 360.0, 25)
    profile = (1.3 + np.sin(np.deg2rad(c)))[:, None] * np.exp(-((gamma / 40.0) ** 2))
    centres, sides = [[-0.25, 0.5], [1.25, 0.5], [-0.25, 1.5], [1.25, 1.5]], np.tile([1.5, 1.0], (4, 1))
    planar = PlanarEmitter(
        Rectangles(np.array(centres), sides, strength.ravel() / strength.sum()),
        TabulatedIntensity(c, gamma, profile * np.cos(np.deg2rad(gamma))),
    )
    radiant = RadianceEmitter(table(strength[:, :, None, None] * profile, c, gamma), 1.0)
    np.testing.assert_allclose(moments(radiant.sample(2**15, 1)), moments(planar.sample(2**15, 1)), atol=2e-3)


def test_place_and_direction_may_depend_on_each_other():
    """R = 1 + b sin^2(gamma) with b of each cell: flux pi A (1 + b/2), mean of sin^2 (1/2 + b/3) / (1 + b/2)."""
    b = np.array([[0.0, -1.0], [2.0, 6.0]])
    emitter = RadianceEmitter(table(np.stack([np.ones((2, 2)), 1.0 + b], axis=-1)[:, :, None, :]), 1.0)
    fluxes = np.pi * AREA_M2 / 4.0 * (1.0 + b / 2.0)
    np.testing.assert_allclose(emitter.table.cell_fluxes, fluxes, rtol=1e-14)
    rays = emitter.sample(2**16, 2)
    row, column = rays.origins[:, 1] >= 1.0, rays.origins[:, 0] >= 0.5
    squares = 1.0 - rays.directions[:, 2] ** 2
    for i, j in np.ndindex(2, 2):
        here = (row == i) & (column == j)
        assert here.mean() == pytest.approx(fluxes[i, j] / fluxes.sum(), abs=1e-4)
        assert squares[here].mean() == pytest.approx((0.5 + b[i, j] / 3.0) / (1.0 + b[i, j] / 2.0), abs=1e-3)


def test_every_bin_of_place_and_direction_gets_its_flux():
    """Shares of rays against the integral of the interpolated radiance by midpoints, done anew."""
    random = np.random.default_rng(3)
    c, gamma = np.array([0.0, 90.0, 200.0, 360.0]), np.array([5.0, 20.0, 50.0, 85.0])
    values = random.uniform(0.0, 1.0, (2, 2, 4, 4)) * (random.random((2, 2, 4, 4)) > 0.2)
    values[:, :, 3] = values[:, :, 0]
    x, y = np.array([-1.0, 0.0, 2.0]), np.array([0.0, 1.5, 2.0])
    rays = RadianceEmitter(table(values, c, gamma, x, y), 1.0).sample(2**17, 4)
    turn = np.rad2deg(np.arctan2(rays.directions[:, 1], rays.directions[:, 0])) % 360.0
    square = 1.0 - rays.directions[:, 2] ** 2
    nodes = np.sin(np.deg2rad(gamma)) ** 2
    sample = np.column_stack([rays.origins[:, 1], rays.origins[:, 0], turn, square])
    found = np.histogramdd(sample, (y, x, c, nodes))[0] / len(rays)
    sides = np.diff(y)[:, None, None, None] * np.diff(x)[:, None, None] * np.diff(c)[:, None] * np.diff(nodes)
    corners = values[:, :, 1:] + values[:, :, :-1]
    expected = 0.25 * (corners[..., 1:] + corners[..., :-1]) * sides
    np.testing.assert_allclose(found, expected / expected.sum(), atol=4e-4)


def test_flux_converges_with_the_square_of_the_node_spacing():
    """R = cos(gamma): flux 2/3 pi A."""
    errors = []
    for nodes in (10, 19, 37):
        gamma = np.linspace(0.0, 80.0, nodes)
        exact = 2.0 / 3.0 * np.pi * AREA_M2 * (1.0 - np.cos(np.deg2rad(80.0)) ** 3)
        errors.append(abs(table(np.cos(np.deg2rad(gamma)), gamma_deg=gamma).flux() / exact - 1.0))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(
    ("light", "symmetry"),
    [
        (lambda x, y, c: 1.0 + 0.0 * c, "square"),
        (lambda x, y, c: 2.0 + np.cos(4.0 * c), "square"),
        (lambda x, y, c: 2.0 + np.cos(2.0 * c), "rectangle"),
        (lambda x, y, c: 2.0 + np.cos(c), "mirror_y"),
        (lambda x, y, c: 2.0 + np.sin(c), "mirror_x"),
        (lambda x, y, c: 2.0 + np.sin(2.0 * c), "none"),
        (lambda x, y, c: 2.0 + x + 0.0 * c, "mirror_y"),
        (lambda x, y, c: 2.0 + y + 0.0 * c, "mirror_x"),
        (lambda x, y, c: 2.0 + x * np.cos(c) + y * np.sin(c), "square"),
        (lambda x, y, c: 2.0 + x * np.cos(c) - y * np.sin(c), "rectangle"),
        (lambda x, y, c: 2.0 + x * np.cos(c), "rectangle"),
        (lambda x, y, c: 2.0 + x * np.sin(c), "none"),
    ],
)
def test_symmetry_is_that_of_the_light_by_place_and_azimuth(light, symmetry):
    edges, c_deg = np.array([-1.0, -0.5, 0.5, 1.0]), np.linspace(0.0, 360.0, 17)
    middle, azimuth = 0.5 * (edges[1:] + edges[:-1]), np.deg2rad(c_deg)
    radiance = light(middle[None, :, None], middle[:, None, None], azimuth)[..., None] * np.ones((3, 3, 17, 2))
    assert table(radiance, c_deg=c_deg, x=edges, y=edges).symmetry == symmetry
    wide = table(radiance[:, :2], c_deg=c_deg, x=edges[1:], y=edges).symmetry
    assert wide in ("none", "mirror_x", "mirror_y"), "cells beside the axis have no mirror image in x"


def test_a_file_comes_back_bit_by_bit(tmp_path):
    original = table(np.random.default_rng(1).random((2, 2, 1, 3)), gamma_deg=(0.0, 30.0, 70.0))
    write_radiance(tmp_path / "led.npz", original)
    back = read_radiance(tmp_path / "led.npz")
    for name in ("x_mm", "y_mm", "c_deg", "gamma_deg", "radiance"):
        np.testing.assert_array_equal(getattr(back, name), getattr(original, name))


GOOD = {"x_mm": X, "y_mm": Y, "c_deg": [0.0], "gamma_deg": [0.0, 60.0], "radiance": np.ones((2, 2, 1, 2))}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x_mm": [0.0]}, "x_mm must be a list of two"),
        ({"y_mm": [0.0, 2.0, 1.0]}, "y_mm must rise"),
        ({"gamma_deg": [0.0, 120.0]}, "within 0 to 90"),
        ({"gamma_deg": [0.0, 90.001]}, "within 0 to 90"),
        ({"gamma_deg": [-0.001, 60.0]}, "within 0 to 90"),
        ({"c_deg": [0.001, 360.0], "radiance": np.ones((2, 2, 2, 2))}, "c_deg must run from 0 to 360"),
        ({"c_deg": [0.001]}, "or be the single number 0"),
        ({"x_mm": [-1.0, 0.0, 1.001e9]}, "x_mm has 3 numbers up to 1.001e"),
        ({"c_deg": [0.0, 180.0]}, "c_deg must run from 0 to 360"),
        ({"radiance": np.ones((2, 2, 2, 2))}, "has the shape"),
        ({"radiance": -np.ones((2, 2, 1, 2))}, "none below 0"),
        ({"radiance": np.zeros((2, 2, 1, 2))}, "not be all dark"),
        ({"radiance": np.full((2, 2, 1, 2), np.nan)}, "must be finite"),
        ({"radiance": np.array(["a"])}, "not readable as a NumPy archive"),
        ({"radiance": np.array([{}], dtype=object)}, "not readable as a NumPy archive"),
        ({"c_deg": [0.0, 360.0], "radiance": np.arange(16.0).reshape(2, 2, 2, 2)}, "c_deg = 360 must be those at 0"),
    ],
)
def test_tables_that_are_none_are_refused_in_one_line(tmp_path, changes, message):
    np.savez(tmp_path / "led.npz", **GOOD | changes)
    with pytest.raises(InputError, match=message) as caught:
        read_radiance(tmp_path / "led.npz")
    assert "\n" not in str(caught.value)


def test_damaged_archives_are_refused_in_one_line(tmp_path):
    path = tmp_path / "led.npz"
    with pytest.raises(InputError, match="no such file"):
        read_radiance(path)
    np.savez_compressed(path, **{name: GOOD[name] for name in ("x_mm", "y_mm")})
    with pytest.raises(InputError, match="no array 'c_deg'"):
        read_radiance(path)
    np.savez_compressed(path, **GOOD | {"radiance": np.random.default_rng(0).random((2, 2, 1, 2))})
    content, random = path.read_bytes(), np.random.default_rng(1)
    for _ in range(300):
        broken = np.frombuffer(content, dtype=np.uint8).copy()
        broken[random.integers(len(broken), size=3)] = random.integers(256, size=3)
        path.write_bytes(broken[: random.integers(1, len(broken) + 1)].tobytes())
        with suppress(InputError):
            assert np.isfinite(read_radiance(path).flux())
