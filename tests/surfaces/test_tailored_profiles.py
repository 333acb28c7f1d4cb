"""Profiles that are tailored to a point: its light, by Snell's law in the plane, goes where it is wanted."""

from collections.abc import Callable

import numpy as np
import pytest

from lensforge.surfaces.drawn_profile import DrawnFace
from lensforge.surfaces.tailored_profiles import Room, tailored_profiles

INDEX = 1.49
ROOM = Room(20.0, 1.5, 1.0)


def through(faces: tuple[DrawnFace, DrawnFace], angle: float) -> float:
    """Angle from z at which a ray from the origin leaves two profiles, by a scan and bisection."""
    start = np.zeros(2)
    way = np.array([np.sin(angle), np.cos(angle)])
    for face, ratio in zip(faces, (1.0 / INDEX, INDEX), strict=True):
        low, high = 0.0, 60.0
        for _ in range(80):
            middle = 0.5 * (low + high)
            point = start + middle * way
            (profile,) = face.points(np.array([np.arctan2(*point)]))
            low, high = (middle, high) if np.linalg.norm(point) < np.linalg.norm(profile) else (low, middle)
        start = start + low * way
        at = np.arctan2(*start)
        before, after = face.points(np.array([at - 1e-5, at + 1e-5]))
        along = (after - before) / np.linalg.norm(after - before)
        normal = np.array([-along[1], along[0]])
        cosine = float(normal @ way)
        way = ratio * way + (np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine) * normal
    return float(np.arctan2(*way))


@pytest.mark.parametrize(
    "wanted",
    [
        lambda angles: 0.25 * angles,
        lambda angles: np.radians(20.0) + 0.4 * angles,
        lambda angles: 1.0 * angles,
    ],
    ids=["narrower", "to one side", "as it is"],
)
def test_light_of_the_point_goes_where_it_is_wanted(wanted: Callable[[np.ndarray], np.ndarray]) -> None:
    faces = tailored_profiles(INDEX, wanted, ROOM, 32.0, 48)
    assert faces is not None
    for angle in np.radians([-35.0, -17.0, 3.0, 21.0, 33.0]).tolist():
        assert through(faces, angle) == pytest.approx(float(wanted(np.array(angle))), abs=0.02)
    angles = np.linspace(-1.5, 1.5, 400)
    inner, outer = (np.linalg.norm(face.points(angles), axis=1) for face in faces)
    assert outer.max() <= 20.0 and inner.min() >= 1.5 and (outer - inner).min() > 0.5


def test_without_room_there_are_none() -> None:
    assert tailored_profiles(INDEX, lambda angles: 0.0 * angles, Room(20.0, 19.0, 1.0), 32.0, 24) is None
