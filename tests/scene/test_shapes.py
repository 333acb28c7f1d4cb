"""Targets on receivers of every kind: areas, moments and places of shapes, beams by their definitions, sums."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import write_photometric
from lensforge.sources.photometric.photometric_file import PhotometricFile, turned_over

PIXELS = 128


def wanted(*targets: dict[str, Any], **receiver: Any) -> tuple[np.ndarray, PosedReceiver]:
    """Light wanted on a plane 300 mm wide and 200 mm high, or on another receiver."""
    plane = {"kind": "plane", "centre_mm": [0.0, 0.0, 150.0], "width_mm": 300.0, "height_mm": 200.0}
    spec = small_spec(target=None, receivers=[{**(receiver or plane), "targets": list(targets)}])
    found = receivers_of(spec, PIXELS)[0]
    return target_light(spec.all_receivers[0].targets, found), found


def moments(light: np.ndarray, receiver: PosedReceiver) -> tuple[float, float, float, float]:
    """Centroid and variances along x and y."""
    x, y = np.meshgrid(receiver.grid.x(), receiver.grid.y())
    total = light.sum()
    mx, my = float((light * x).sum() / total), float((light * y).sum() / total)
    return mx, my, float((light * (x - mx) ** 2).sum() / total), float((light * (y - my) ** 2).sum() / total)


SHAPES = {
    "rectangle": ({"kind": "rectangle", "width_mm": 90.0, "height_mm": 40.0}, 3600.0, 675.0, 1600.0 / 12.0),
    "disc": ({"kind": "disc", "diameter_mm": 80.0}, 1600.0 * np.pi, 400.0, 400.0),
    "ellipse": ({"kind": "ellipse", "width_mm": 100.0, "height_mm": 60.0}, 1500.0 * np.pi, 625.0, 225.0),
    "ring": ({"kind": "ring", "outer_diameter_mm": 80.0, "inner_diameter_mm": 40.0}, 1200.0 * np.pi, 500.0, 500.0),
    "polygon": (
        {"kind": "polygon", "corners_mm": [[-45.0, -20.0], [45.0, -20.0], [45.0, 20.0], [-45.0, 20.0]]},
        3600.0, 675.0, 1600.0 / 12.0,
    ),
    "cross": ({"kind": "cross", "length_mm": 90.0, "stroke_mm": 30.0}, 4500.0, 435.0, 435.0),
    "spots": (
        {"kind": "spots", "columns": 3, "rows": 2, "diameter_mm": 16.0, "pitch_mm": 40.0},
        384.0 * np.pi, 16.0 + 3200.0 / 3.0, 16.0 + 400.0,
    ),
}  # fmt: skip
each_shape = pytest.mark.parametrize(("target", "area", "xx", "yy"), SHAPES.values(), ids=list(SHAPES))


@each_shape
def test_shapes_have_their_areas_and_moments(target: dict[str, Any], area: float, xx: float, yy: float) -> None:
    light, receiver = wanted(target)
    assert light.sum() == pytest.approx(1.0, abs=1e-12)
    width, height = receiver.grid.pixel
    assert width * height / light.max() == pytest.approx(area, rel=3e-3)
    assert moments(light, receiver) == pytest.approx((0.0, 0.0, xx, yy), rel=1e-2, abs=0.2)


@each_shape
def test_shapes_are_moved_and_turned(target: dict[str, Any], area: float, xx: float, yy: float) -> None:
    """A quarter turn swaps the variances; 30 degrees mix them by cos^2 and sin^2."""
    for degrees, share in ((90.0, 0.0), (30.0, 0.75)):
        light, receiver = wanted({**target, "centre_mm": [60.0, -30.0], "rotation_deg": degrees})
        mixed = share * xx + (1.0 - share) * yy, share * yy + (1.0 - share) * xx
        assert moments(light, receiver) == pytest.approx((60.0, -30.0, *mixed), rel=1e-2, abs=0.2)


@each_shape
def test_soft_edges_keep_the_flux_and_add_their_variance(
    target: dict[str, Any], area: float, xx: float, yy: float
) -> None:
    light, receiver = wanted({**target, "edge_mm": 6.0})
    assert moments(light, receiver) == pytest.approx((0.0, 0.0, xx + 36.0, yy + 36.0), rel=1e-2, abs=0.2)


def test_tables_are_read_row_by_row_from_the_top(tmp_path: Path) -> None:
    values = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
    np.savez(tmp_path / "light.npz", values=values)
    (tmp_path / "light.csv").write_text("# light\n0;1;2\n3;4;5\n")
    by_array, _ = wanted({"kind": "array", "values": values, "width_mm": 150.0})
    for name in ("light.npz", "light.csv"):
        found, _ = wanted({"kind": "table", "file": str(tmp_path / name), "width_mm": 150.0})
        assert np.array_equal(found, by_array)
    taller, receiver = wanted({"kind": "array", "values": values, "width_mm": 150.0, "height_mm": 50.0})
    assert np.ptp(receiver.grid.y()[taller.any(axis=1)]) == pytest.approx(50.0, abs=5.0)
    (tmp_path / "light.csv").write_text("1,2\n3\n")
    with pytest.raises(InputError, match="no table of numbers"):
        wanted({"kind": "table", "file": str(tmp_path / "light.csv"), "width_mm": 150.0})


FAR = {"kind": "far_field", "half_angle_deg": 80.0}


def along(light: np.ndarray, receiver: PosedReceiver) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Angles and light along x and along y through the middle of a far field, relative to the peak."""
    grid, middle = receiver.grid, len(light) // 2
    zero = np.zeros(len(light))
    along_x = receiver.target_coordinates(grid.x(), zero)[0], 0.5 * (light[middle - 1] + light[middle])
    along_y = receiver.target_coordinates(zero, grid.y())[1], 0.5 * (light[:, middle - 1] + light[:, middle])
    return along_x[0], along_x[1] / light.max(), along_y[0], along_y[1] / light.max()


def test_a_photometric_file_is_wanted_as_it_stands(tmp_path: Path) -> None:
    """C = 90 is -y of the lens: more light to C 0 and C 90 is more light to +x and to -y; then turned and tilted."""
    c, gamma = np.arange(0.0, 361.0, 15.0), np.arange(0.0, 91.0, 2.5)
    shape = 1.0 + 0.6 * np.cos(np.radians(c - 30.0))[:, None] * np.sin(np.radians(gamma))
    values = 100.0 * shape * np.cos(np.radians(gamma)) ** 2
    write_photometric(tmp_path / "lamp.ies", PhotometricFile(TabulatedIntensity(c, gamma, values), lamp_lumens=1000.0))
    target = {"kind": "photometric", "file": str(tmp_path / "lamp.ies")}
    x, on_x, y, on_y = along(*wanted(target, **FAR))
    own = turned_over(TabulatedIntensity(c, gamma, values))
    for angles, light, azimuths in ((x, on_x, (0.0, 180.0)), (y, on_y, (90.0, 270.0))):
        for side, azimuth in zip((1.0, -1.0), azimuths, strict=True):
            ahead = side * angles > 0.0
            exact = np.interp(np.abs(angles[ahead]), gamma, own.at(azimuth))
            assert np.allclose(light[ahead] / light[ahead].max(), exact / exact.max(), atol=0.02)
    assert on_x[x > 30.0].sum() > 1.2 * on_x[x < -30.0].sum() and on_y[y < -30.0].sum() > on_y[y > 30.0].sum()
    light, receiver = wanted({**target, "rotation_deg": 180.0}, **FAR)
    assert np.allclose(light, wanted(target, **FAR)[0][::-1, ::-1], atol=1e-12)
    tilted = moments(*wanted({**target, "centre_deg": [20.0, 0.0]}, **FAR))
    assert tilted[0] - moments(light[::-1, ::-1], receiver)[0] > 0.2


def test_shapes_in_the_far_field_are_angles() -> None:
    """Half of a disc of 60 degrees in solid angle is one of 42.1: 1 - cos halves."""
    disc, receiver = wanted({"kind": "disc", "diameter_deg": 60.0}, **FAR)
    solid_angle = receiver.pixel_measure / disc.max()
    assert solid_angle == pytest.approx(2.0 * np.pi * (1.0 - np.cos(np.radians(30.0))), rel=3e-3)
