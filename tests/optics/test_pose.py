"""Poses: rotations by hand, there and back, chained; and the same place for a source, a body, a lamp and a receiver."""

import math

import numpy as np
import pytest
import torch

import lensforge as lf
from lensforge.optics.pose import Pose
from lensforge.scene.receiver_shapes import build_receiver
from lensforge.sources.build_source import build_source
from lensforge.spec.bodies_section import BodySection
from lensforge.spec.lamps_section import TableLamps

PLACE = (4.0, -7.0, 9.0)
CROOKED = Pose.of_tilts(PLACE, (15.0, -40.0), 25.0)
OTHER = Pose.facing((0.2, 0.1, -0.9), (1.0, 2.0, -3.0), -70.0)
POINTS = np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0], [0.0, 0.0, 0.0]])


def rotated(vector: np.ndarray, about: np.ndarray, angle: float) -> np.ndarray:
    """A vector turned about a unit axis by an angle in rad, by its parts along and across it."""
    along = (vector @ about) * about
    across = vector - along
    return along + math.cos(angle) * across + math.sin(angle) * np.cross(about, across)


def test_it_turns_then_tilts_about_x_then_about_y_then_shifts() -> None:
    x, y, z = np.eye(3)
    for point, placed, way in zip(POINTS, CROOKED.points(POINTS), CROOKED.directions(POINTS), strict=True):
        by_hand = rotated(rotated(rotated(point, z, np.radians(25.0)), x, np.radians(15.0)), y, np.radians(-40.0))
        np.testing.assert_allclose([way, placed], [by_hand, by_hand + PLACE], atol=1e-14)


@pytest.mark.parametrize("direction", [(0.3, -0.5, 0.8), (1, 0, 0), (0, -2, 0), (0.2, 0.1, -0.9), (1e-4, 2e-4, -1)])
@pytest.mark.parametrize("degrees", [0.0, 33.0, 90.0, -180.0, 270.0])
def test_to_face_a_direction_it_is_tilted_the_shortest_way_and_turned(direction, degrees) -> None:
    unit = np.array(direction) / np.linalg.norm(direction)
    about = np.cross([0.0, 0.0, 1.0], unit)
    sine = np.linalg.norm(about)
    tilted = (rotated(axis, about / sine, math.atan2(sine, unit[2])) for axis in np.eye(3))
    turned = [rotated(axis, unit, math.radians(degrees)) for axis in tilted]
    pose = Pose.facing(direction, PLACE, degrees)
    np.testing.assert_allclose(pose.frame.T, [*turned, PLACE], atol=1e-6 if unit[2] < -0.99 else 1e-13)
    assert (pose.turn_deg - degrees + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-6)


def test_straight_back_is_reached_about_the_y_axis_and_quarter_turns_are_exact() -> None:
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    left = (-1.0, 0.0, 0.0)
    right = (0.0, -1.0, 0.0)
    down = (0.0, 0.0, -1.0)
    for direction in (down, (0.0, 0.0, -5.0), (1e-8, 0.0, -1.0)):  # the last is as straight as 16 digits can tell
        assert Pose.facing(direction).axes == (left, y, down)
    assert Pose.facing(z, PLACE, 270.0).axes == (right, x, z) and Pose.of_tilts(turn_deg=90.0).axes == (y, left, z)
    assert Pose.of_tilts(tilt_deg=(90.0, 0.0)).axes == (x, z, right)
    assert Pose.of_tilts(tilt_deg=(0.0, 90.0)).axes == (down, y, x)
    assert not Pose.of_tilts(tilt_deg=(360.0, 0.0), turn_deg=-720.0).moves and Pose((0.0, 0.0, 1e-9)).moves


def test_a_displacement_turns_about_its_centre_by_a_rotation_vector() -> None:
    vector = np.array([0.3, -0.4, 1.2])
    centre = np.array([1.0, -2.0, 0.5])
    shift = np.array([0.1, 0.2, -0.3])
    by_hand = [rotated(point - centre, vector / 1.3, 1.3) + centre + shift for point in POINTS]
    np.testing.assert_allclose(Pose.displaced(shift, vector, tuple(centre)).points(POINTS), by_hand, atol=1e-14)


def test_crooked_poses_go_there_and_back_and_are_chained() -> None:
    fields = POINTS + 1j * POINTS[::-1]
    inverse = CROOKED.inverse
    chained = CROOKED.after(OTHER)
    np.testing.assert_allclose(CROOKED.to_local_points(CROOKED.points(POINTS)), POINTS, atol=1e-14)
    np.testing.assert_allclose(CROOKED.to_local_directions(CROOKED.directions(fields)), fields, atol=1e-14)
    np.testing.assert_allclose(inverse.points(POINTS), CROOKED.to_local_points(POINTS), atol=1e-14)
    np.testing.assert_allclose(chained.points(POINTS), CROOKED.points(OTHER.points(POINTS)), atol=1e-13)
    np.testing.assert_allclose(chained.seen_from(CROOKED).frame, OTHER.frame, atol=1e-14)
    mirror = np.diag([-1.0, 1.0, 1.0])
    rotation = CROOKED.rotation
    np.testing.assert_allclose(CROOKED.to_local_map(mirror), rotation.T @ mirror @ rotation, atol=1e-15)
    tensor = torch.from_numpy(POINTS).float().requires_grad_()
    points = CROOKED.to_local_points(CROOKED.points(tensor))
    torch.autograd.backward(points.sum())
    assert points.dtype == torch.float32 and torch.allclose(tensor.grad, torch.ones(3, 3), atol=1e-6)


def test_a_source_a_body_a_lamp_and_a_receiver_in_one_pose_put_a_point_at_the_same_place() -> None:
    """The corner of an LED of 2 mm; a lamp is aimed, and its +x points to the side to which it is tilted."""
    angles = {"tilt_deg": (15.0, -40.0), "rotate_z_deg": 25.0}
    led = build_source(lf.SquareSource(side_mm=2.0, position_mm=PLACE, **angles))
    shells = {name: {"fixed": {"kind": "sphere", "radius_mm": radius}} for name, radius in (("inner", 3), ("outer", 4))}
    body = BodySection(name="dome", refractive_index=1.5, centre_mm=PLACE, **angles, **shells).body(550.0)
    axis = CROOKED.axis
    chart = {"width_mm": 2.0, "height_mm": 2.0, "targets": [lf.DiscTarget(diameter_mm=1.0)]}
    plane = lf.PlaneReceiver(centre_mm=PLACE, normal=axis, rotation_deg=CROOKED.turn_deg, **chart)
    aim = tuple(place + 10.0 * along for place, along in zip(PLACE, axis, strict=True))
    turn = CROOKED.turn_deg - math.degrees(math.atan2(axis[1], axis[0]))
    lamp = TableLamps(places_mm=(PLACE,), aims_mm=(aim,), turns_deg=(turn,)).lamps.lamps[0]
    corner = np.array([1.0, 1.0, 0.0])
    on_plane = build_receiver(plane, 16).places(*corner[:2, None])[0]
    for place in (led.outline()[2], body.pose.points(corner), lamp.pose.points(corner), on_plane):
        np.testing.assert_allclose(place, CROOKED.points(corner), atol=1e-13)
