"""Étendue of a ball and a plane, and limits of two refractions: integrals, Snell's law, Fresnel's formulas."""

from math import asin, pi

import numpy as np
import pytest
import torch
from known_refraction import largest_deviation_rad, normal_transmittance

from lensforge.optics.dielectric import fresnel_transmittances
from lensforge.optics.fundamental_limits import (
    best_transmittance,
    cell_solid_angles,
    cone_around,
    etendue_from_ball,
    face_transmittance,
    transmittance_of,
)
from lensforge.optics.media import Media, Medium


def corners_of(x_mm: np.ndarray, y_mm: np.ndarray, distance_mm: float) -> np.ndarray:
    """Corners of cells in the plane at ``distance_mm``, [row y, column x]."""
    x, y = np.meshgrid(x_mm, y_mm)
    return np.stack([x, y, np.full_like(x, distance_mm)], axis=-1)


def of_plane(x_mm: np.ndarray, y_mm: np.ndarray, distance_mm: float) -> np.ndarray:
    return cell_solid_angles(corners_of(x_mm, y_mm, distance_mm))


def test_solid_angles_of_cells_add_up_and_have_closed_forms() -> None:
    edges = np.linspace(-3.0, 5.0, 9)
    cells = of_plane(edges, np.linspace(-2.0, 4.0, 4), 7.0)
    assert cells.shape == (3, 8)
    assert cells.sum() == pytest.approx(of_plane(np.array([-3.0, 5.0]), np.array([-2.0, 4.0]), 7.0)[0, 0])
    # one face of a cube about the origin is a sixth of the sphere, an endless plane half of it
    assert of_plane(np.array([-1.0, 1.0]), np.array([-1.0, 1.0]), 1.0)[0, 0] == pytest.approx(4.0 * pi / 6.0)
    assert of_plane(np.array([-1e9, 1e9]), np.array([-1e9, 1e9]), 1e-3)[0, 0] == pytest.approx(2.0 * pi, rel=1e-3)
    # far away it is area over distance squared
    assert of_plane(np.array([0.0, 2.0]), np.array([0.0, 3.0]), 1e6)[0, 0] == pytest.approx(6e-12, rel=1e-5)


def test_etendue_of_a_ball_against_an_integral_over_its_rays() -> None:
    """Rays from points of the plane in all directions below it: those that meet the ball, by their projected angle."""
    radius = 3.0
    distance = 8.0
    rng = np.random.default_rng(5)
    count = 400_000
    x, y = rng.uniform(2.0, 6.0, count), rng.uniform(-4.0, 4.0, count)
    # Lambertian: pi sr of projected angle
    sine = np.sqrt(rng.random(count))
    azimuth = 2.0 * pi * rng.random(count)
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), -np.sqrt(1.0 - sine**2)], axis=1)
    points = np.stack([x, y, np.full(count, distance)], axis=1)
    nearest = np.linalg.norm(np.cross(points, directions), axis=1)
    etendue = 32.0 * pi * (nearest < radius).mean()
    solid_angle = of_plane(np.array([2.0, 6.0]), np.array([-4.0, 4.0]), distance)[0, 0]
    assert etendue_from_ball(radius, solid_angle) == pytest.approx(etendue, rel=0.01)


def test_a_cone_holds_its_cells() -> None:
    edges = np.linspace(-10.0, 10.0, 5)
    cells = np.zeros((4, 4), dtype=bool)
    cells[3, 3] = True  # x and y from 5 to 10
    axis, half = cone_around(corners_of(edges, edges, 20.0), cells)
    middle = np.array([7.5, 7.5, 20.0])
    assert axis @ middle / np.linalg.norm(middle) > 0.999
    corners = np.array([[x, y, 20.0] for x in (5.0, 10.0) for y in (5.0, 10.0)])
    angles = np.arccos(corners @ axis / np.linalg.norm(corners, axis=1))
    assert angles.max() == pytest.approx(half, rel=1e-6)


INDICES = [1.0, 1.2, 1.4936, 2.0, 2.62, 3.5]


def s_and_p(turned: np.ndarray, index: float) -> np.ndarray:
    """What a face transmits of s and p, by the sines and tangents of Fresnel; 0 where it cannot turn so far."""
    possible = turned <= np.arccos(1.0 / index)
    air = np.arctan2(index * np.sin(turned), np.maximum(index * np.cos(turned) - 1.0, 0.0))
    within = air - turned
    with np.errstate(invalid="ignore", divide="ignore"):
        r_s = np.sin(turned) / np.sin(air + within)
        r_p = np.tan(turned) / np.tan(air + within)
    normal = (index - 1.0) / (index + 1.0)
    r_s, r_p = (np.where(turned > 0.0, amplitude, normal) for amplitude in (r_s, r_p))
    return np.where(possible, 1.0 - np.array([r_s, r_p]) ** 2, 0.0)


@pytest.mark.parametrize("index", INDICES)
def test_two_refractions_turn_a_ray_by_no_more_and_almost_as_much(index: float) -> None:
    """Snell's law at both faces, each between grazing and normal incidence in air."""
    air = np.linspace(0.0, 0.5 * pi, 2001)
    turn = np.abs(air - np.arcsin(np.sin(air) / index))
    assert 2.0 * turn.max() == pytest.approx(largest_deviation_rad(index), abs=1e-12)
    assert largest_deviation_rad(index) == pytest.approx(pi - 2.0 * asin(1.0 / index))


@pytest.mark.parametrize("index", INDICES[1:])
def test_a_face_transmits_what_fresnel_says_at_the_angle_that_turns_so_far(index: float) -> None:
    air = np.linspace(0.0, 0.4999 * pi, 301)
    turned = air - np.arcsin(np.sin(air) / index)
    expected = rms(np.cos(air), 1.0 / index)
    assert np.abs(face_transmittance(turned, index) - expected).max() < 1e-9
    inside = rms(np.cos(air - turned), index)
    assert np.abs(face_transmittance(turned, index) - inside).max() < 1e-9, "the same in both directions"


def rms(cosines: np.ndarray, ratio: float) -> np.ndarray:
    t_s, t_p, _ = fresnel_transmittances(torch.from_numpy(cosines), ratio)
    return (0.5 * (t_s**2 + t_p**2)).sqrt().numpy()


@pytest.mark.parametrize("index", INDICES)
def test_no_split_of_the_turn_transmits_more_than_halves(index: float) -> None:
    turns = np.linspace(0.0, largest_deviation_rad(index), 101)
    parts = np.linspace(0.0, 1.0, 1001)
    every = [(s_and_p(parts * turn, index) * s_and_p((1.0 - parts) * turn, index)).mean(axis=0) for turn in turns]
    largest = np.max(every, axis=1)
    best = best_transmittance(turns, index)
    more = np.maximum.accumulate(largest[::-1])[::-1]  # a ray may be turned further than it must be
    assert (best >= more - 1e-9).all()
    assert np.abs(best - more)[:-1].max() < (1e-9 if index < 2.5 else 1e-3)
    assert (np.diff(best) <= 0.0).all(), "a larger turn never transmits more"
    if index < 2.5:
        assert best[0] == pytest.approx(normal_transmittance(index) ** 2, abs=1e-15)
    assert best[0] == transmittance_of(Media(Medium(index))), "and no other light does"
    one_by_one = s_and_p(0.5 * turns, index).mean(axis=0) ** 2  # as if each face met unpolarised light
    assert index == 1.0 or (best - one_by_one).max() > 5e-4


@pytest.mark.parametrize(("cavity", "outside"), [(1.0, 1.333), (1.41, 1.0), (1.53, 1.333), (1.6, 1.0)])
def test_two_faces_that_differ_have_a_bound_that_no_split_passes_and_some_nearly_reaches(cavity, outside):
    index = 1.4936
    first, second = (max(index / medium, medium / index) for medium in (cavity, outside))
    turns = np.linspace(0.0, 0.9, 31)
    parts = np.linspace(0.0, 1.0, 4001)
    brute = np.array([
        (s_and_p(parts * turn, first) * s_and_p((1.0 - parts) * turn, second)).mean(axis=0).max()
        for turn in turns
    ])  # fmt: skip
    bound = best_transmittance(turns, index, cavity, outside)
    assert (bound >= brute - 1e-12).all()
    seen = brute > 0.5
    assert (bound[seen] < 1.03 * brute[seen]).all()
    assert bound[0] == pytest.approx(transmittance_of(Media(Medium(index, 0.0), cavity, outside)), rel=1e-12)
