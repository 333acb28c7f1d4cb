"""Tilt of a mill's axis: closed forms, and shanks that are tried against all points of a cavity and its bore."""

from math import asin, degrees, radians, sin

import numpy as np
import pytest
from known_shapes import exported
from scenes import small_spec

from lensforge.shop.axis_tilt import free_tilt_deg, needed_tilt_deg
from lensforge.shop.face_samples import AirSide, FaceSamples, sample_face
from lensforge.spec.part_section import mouth_room_deg
from lensforge.surfaces.asphere import sphere

BALL_MM = 0.5
RADIUS_MM = 3.0
CENTRE_MM = 0.8  # height of the sphere's centre, below which it is undercut
DEPTH_MM = 2.0
RIM_MM = (RADIUS_MM**2 - CENTRE_MM**2) ** 0.5
TURN = np.linspace(0.0, 2.0 * np.pi, 721)
SHANK_MM = BALL_MM * (1.0 - 1e-3)


def cavity() -> FaceSamples:
    return sample_face(exported(sphere(RADIUS_MM, CENTRE_MM), AirSide.INSIDE), 41)


def distance_mm(points: np.ndarray, start: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Distance of points from the half line of a shank; infinite behind its beginning."""
    away = points - start
    along = away @ axis
    return np.where(along > 0.0, np.linalg.norm(away - along[:, None] * axis, axis=1), np.inf)


def axis_of(tilt_rad: float, towards: np.ndarray) -> np.ndarray:
    """Axis from ball to holder, downwards out of a cavity, that leans to a horizontal direction."""
    return np.array([*(np.sin(tilt_rad) * towards), -np.cos(tilt_rad)])


@pytest.mark.parametrize(("mouth_mm", "above_mm", "radius_mm"), [(3.0, 2.0, 0.5), (1.7, 6.1, 0.9), (5.0, 0.3, 1.0)])
def test_a_shank_on_the_axis_touches_the_edge_of_the_bore_at_the_tilt_that_is_left(mouth_mm, above_mm, radius_mm):
    edge = np.stack([mouth_mm * np.cos(TURN), mouth_mm * np.sin(TURN), np.zeros_like(TURN)], axis=1)
    tilt_rad = radians(mouth_room_deg(mouth_mm, above_mm, radius_mm))
    start = np.array([0.0, 0.0, above_mm])
    nearest = distance_mm(edge, start, axis_of(tilt_rad, np.array([1.0, 0.0]))).min()
    assert nearest == pytest.approx(radius_mm, abs=1e-9)
    assert mouth_room_deg(0.9 * radius_mm, above_mm, radius_mm) == 0.0, "wider than the mouth"
    assert mouth_room_deg(0.1, 0.1, radius_mm) == 0.0


def test_a_cavity_that_narrows_downwards_is_left_what_its_mouth_and_bore_leave() -> None:
    """The highest ball at an undercut place has its centre as high as the sphere has: there the normal is level."""
    spec = small_spec(base={"height_mm": DEPTH_MM}, manufacture={"process": "milled"})
    samples = cavity()
    assert needed_tilt_deg(samples) == pytest.approx(degrees(asin(CENTRE_MM / RADIUS_MM)), abs=1e-3)
    expected = mouth_room_deg(RIM_MM, DEPTH_MM + CENTRE_MM, BALL_MM)
    assert free_tilt_deg(samples, spec) == pytest.approx(expected, abs=0.3), "to the nodes"
    assert free_tilt_deg(samples, spec.replace({"manufacture.max_tilt_deg": 20.0})) == 20.0
    outside = sample_face(exported(sphere(RADIUS_MM, CENTRE_MM), AirSide.OUTSIDE), 41)
    assert free_tilt_deg(outside, spec) == 90.0
    without = spec.replace({"base": {"kind": "none"}})
    assert free_tilt_deg(samples, without) == pytest.approx(mouth_room_deg(RIM_MM, CENTRE_MM, BALL_MM), abs=0.6)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_shank_as_thick_as_the_ball_leaves_a_cavity_by_any_tilt_between_need_and_room(
    share: float,
) -> None:
    """Against points of cavity and bore 0.05 mm apart; it leans towards the lens axis, as far as from need to room."""
    samples = cavity()
    polar, turn = np.meshgrid(np.linspace(0.0, np.pi, 200), TURN[:-1:4], indexing="ij")
    ball = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    walls = RADIUS_MM * ball.reshape(-1, 3) + [0.0, 0.0, CENTRE_MM]
    walls = walls[walls[:, 2] > 0.0]
    rims = [np.stack([RIM_MM * np.cos(TURN), RIM_MM * np.sin(TURN), np.full_like(TURN, -z)], axis=1)
            for z in np.linspace(0.0, DEPTH_MM, 41)]  # fmt: skip
    obstacles = np.concatenate([walls, *rims])
    needed_rad = radians(needed_tilt_deg(samples))
    tilt_rad = needed_rad + share * (radians(mouth_room_deg(RIM_MM, DEPTH_MM + CENTRE_MM, BALL_MM)) - needed_rad)
    places = np.flatnonzero(samples.upward < -1e-3)
    assert len(places) > 50
    for place in places[::7]:
        normal = samples.normals[place]
        towards = normal[:2] / np.linalg.norm(normal[:2])
        axis = axis_of(tilt_rad, towards)
        assert normal @ axis >= sin(tilt_rad - needed_rad) - 1e-12, "the ball cuts up to its equator"
        start = samples.points[place] + BALL_MM * normal
        assert distance_mm(obstacles, start, axis).min() > SHANK_MM
