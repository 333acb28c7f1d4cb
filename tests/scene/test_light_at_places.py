"""Relative light of targets at single places, by their definitions: on edges, just beyond them, and off the axes."""

import math
from itertools import pairwise

import numpy as np
import pytest

from lensforge.scene.target_light import photometric
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.spec.camera_target import CameraTarget
from lensforge.spec.far_field_targets import BatwingTarget, BeamTarget
from lensforge.spec.shape_targets import PolygonTarget

NEAR = 1e-9


def at(*places: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.array(places, dtype=float).T
    return x, y


ANGLES = at((0.0, 0.0), (0.4, 0.3), (30.0, 0.0), (0.0, 12.5), (-20.0, 7.0), (3.0, -40.0), (60.0, 60.0))


def test_a_gaussian_beam_halves_at_its_ellipse() -> None:
    light = BeamTarget(fwhm_deg=(60.0, 25.0)).light(*ANGLES)
    by_hand = [
        math.exp(-4.0 * math.log(2.0) * ((x / 60.0) ** 2 + (y / 25.0) ** 2)) for x, y in zip(*ANGLES, strict=True)
    ]
    np.testing.assert_allclose(light, by_hand, rtol=1e-12)
    assert light[2] == light[3] == pytest.approx(0.5)


@pytest.mark.parametrize("fwhm", [(60.0, 25.0), (170.0, 100.0)])
def test_a_cosine_beam_is_the_power_of_the_cosine_that_halves_on_the_ellipse_in_each_direction(fwhm) -> None:
    x, y = at((0.0, 0.0), (0.4, 0.3), (30.0, 0.0), (0.0, 12.5), (-20.0, 7.0), (3.0, -40.0), (0.0, 89.5), (89.5, 0.0))
    lights = BeamTarget(fwhm_deg=fwhm, profile="cosine").light(x, y)
    for light, angle_x, angle_y in zip(lights, x, y, strict=True):
        gamma = math.hypot(angle_x, angle_y)
        if gamma == 0.0:
            assert light == 1.0
            continue
        reach = 1.0 / math.hypot(2.0 * angle_x / gamma / fwhm[0], 2.0 * angle_y / gamma / fwhm[1])
        power = math.log(0.5) / math.log(math.cos(math.radians(reach)))
        assert light == pytest.approx(math.cos(math.radians(gamma)) ** power, rel=1e-9)
    beyond = at((90.0, 0.0), (0.0, -90.0), (90.5, 0.0), (100.0, 100.0))
    assert not BeamTarget(fwhm_deg=fwhm, profile="cosine").light(*beyond).any()


def test_a_batwing_is_even_on_a_plane_up_to_its_edge_and_dark_at_the_horizon() -> None:
    gammas = np.array([0.0, 0.5, 30.0, 59.9, 60.0, 60.1, 70.0, 88.9, 89.0, 91.0])
    x, y = -0.6 * gammas, 0.8 * gammas
    sharp = BatwingTarget(to_deg=60.0).light(np.append(x, 60.0), np.append(y, 0.0))
    soft = BatwingTarget(to_deg=60.0, edge_deg=8.0).light(x, y)
    for gamma, light, blurred in zip(gammas, sharp, soft, strict=False):
        even = 0.0 if gamma >= 89.0 else math.cos(math.radians(gamma)) ** -3
        if gamma != 60.0:  # to the last bit of the place
            assert light == pytest.approx(even if gamma < 60.0 else 0.0)
        assert blurred == pytest.approx(0.5 * math.erfc((gamma - 60.0) / (8.0 * math.sqrt(2.0))) * even, rel=1e-9)
    assert sharp[-1] == pytest.approx(8.0), "up to its edge, which belongs to it"


def shown(u: float, v: float, camera: CameraTarget, dims: float) -> float:
    """Light at (u, v) of the picture of a white wall, by a camera at the distance 1 that dims by this power."""
    cosine = 1.0 / math.sqrt(1.0 + u * u + v * v)
    gamma, azimuth = math.degrees(math.acos(cosine)), math.atan2(v, u)
    (intensity,) = camera.light(*at((gamma * math.cos(azimuth), gamma * math.sin(azimuth))))
    return float(intensity) * cosine**3 * cosine**dims


@pytest.mark.parametrize("rolloff", [4.0, 2.5, 0.0])
def test_a_camera_sees_a_wall_in_its_field_evenly_to_the_corners(rolloff: float) -> None:
    """Its field is a rectangle in the picture: half of it is the tangent of half of the angle."""
    camera = CameraTarget(width_deg=84.0, height_deg=50.0, rolloff=rolloff)
    half = math.tan(math.radians(42.0)), math.tan(math.radians(25.0))
    for across, up in ((0.0, 0.0), (0.3, -0.7), (1.0, 0.2), (-0.4, 1.0), (-1.0, -1.0)):
        inside, outside = (
            shown(half[0] * across * part, half[1] * up * part, camera, rolloff) for part in (1.0 - NEAR, 1.0 + NEAR)
        )
        assert inside == pytest.approx(1.0, rel=1e-9)
        assert outside == pytest.approx(0.0 if 1.0 in (abs(across), abs(up)) else 1.0)
    farthest = max(abs(place) for place in camera.outline)
    assert farthest == pytest.approx(math.degrees(math.atan(math.hypot(*half))), rel=1e-12), "a corner"
    assert not camera.light(*at((89.5, 0.0), (0.0, -120.0))).any()


def by_loops(table: TabulatedIntensity, x: float, y: float) -> float:
    """Bilinear light of one direction: the sector and the cell in which it lies are looked for."""
    gamma = math.hypot(x, y)
    azimuth = math.degrees(math.atan2(y, x)) % 360.0
    angles = table.gamma_deg
    planes = table.c_deg
    if not angles[0] <= gamma <= angles[-1]:
        return 0.0
    row = next(k for k in range(len(angles) - 1) if gamma <= angles[k + 1])
    up = (gamma - angles[row]) / (angles[row + 1] - angles[row])

    def of(plane: int) -> float:
        return float((1.0 - up) * table.values[plane, row] + up * table.values[plane, row + 1])

    if len(planes) == 1:
        return of(0)
    left = next(k for k in range(len(planes) - 1) if azimuth <= planes[k + 1])
    part = (azimuth - planes[left]) / (planes[left + 1] - planes[left])
    return (1.0 - part) * of(left) + part * of(left + 1)


@pytest.mark.parametrize("planes", [[0.0], [0.0, 360.0], [0.0, 100.0, 360.0], [0.0, 90.0, 180.0, 270.0, 360.0]])
@pytest.mark.parametrize("gammas", [[0.0, 40.0], [0.0, 15.0, 40.0, 80.0]])
def test_a_table_is_read_between_its_planes_and_angles(planes: list[float], gammas: list[float]) -> None:
    values = np.random.default_rng(0).random((len(planes), len(gammas)))
    table = TabulatedIntensity(np.array(planes), np.array(gammas), values)
    azimuth, gamma = (
        coordinates.ravel()
        for coordinates in np.meshgrid(np.radians([1.0, 95.0, 181.0, 359.0]), [0.5, 20.0, 39.9, 79.0])
    )
    x, y = gamma * np.cos(azimuth), gamma * np.sin(azimuth)
    by_hand = [by_loops(table, angle_x, angle_y) for angle_x, angle_y in zip(x, y, strict=True)]
    np.testing.assert_allclose(photometric(table, x, y), by_hand, rtol=1e-9)
    last = photometric(table, np.array([gammas[-1], 0.0, gammas[-1] + NEAR]), np.zeros(3))
    np.testing.assert_allclose(last, [values[0, -1], values[0, 0], 0.0])


def test_a_polygon_holds_what_an_odd_number_of_its_edges_lies_beside() -> None:
    """A star that crosses itself, against angles: the winding number of the outline is odd inside."""
    corners = tuple(
        (5.0 * math.sin(4.0 * math.pi * k / 5.0), 5.0 * math.cos(4.0 * math.pi * k / 5.0)) for k in range(5)
    )
    x, y = np.random.default_rng(0).uniform(-5.0, 5.0, (2, 400))
    mask = PolygonTarget(corners_mm=corners).contains(x, y)
    for place_x, place_y, inside in zip(x, y, mask, strict=True):
        turns = [math.atan2(b - place_y, a - place_x) for a, b in (*corners, corners[0])]
        whole = sum((b - a + math.pi) % (2.0 * math.pi) - math.pi for a, b in pairwise(turns))
        assert inside == (round(whole / (2.0 * math.pi)) % 2 == 1)
    assert 0 < mask.sum() < 200
    square = PolygonTarget(corners_mm=((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)))
    edges = at((0.0, 1.0), (2.0, 1.0), (1.0, 0.0), (1.0, 2.0), (-1.0, 0.0), (-1.0, 2.0))
    assert square.contains(*edges).tolist() == [True, False, True, False, False, False], "each edge belongs to one side"
