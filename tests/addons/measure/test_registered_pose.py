"""The record of a registered motion: four triples of numbers, each in its place and unit."""

import numpy as np
import pytest
from scenes import hemisphere_directions, random_surface

from lensforge.addons.measure import registration
from lensforge.addons.measure.measured_surface import pose_of
from lensforge.addons.measure.registration import RigidMotion, register
from lensforge.cad.patch import fit_patch

ROTATION_RAD, TRANSLATION_MM = (1e-3, -2e-3, 3e-3), (0.04, -0.05, 0.06)
ROTATION_ERROR_RAD, TRANSLATION_ERROR_MM = (1e-5, 2e-5, 3e-5), (7e-3, 8e-3, 9e-3)


@pytest.mark.parametrize("axis", range(3))
def test_each_value_stands_beside_its_own_error(axis: int) -> None:
    motion = RigidMotion(*map(np.array, (ROTATION_RAD, TRANSLATION_MM, ROTATION_ERROR_RAD, TRANSLATION_ERROR_MM)))
    pose, name = pose_of(motion), "xyz"[axis]
    turned, shifted = getattr(pose, f"rotation_{name}_deg"), getattr(pose, f"translation_{name}_mm")
    assert (turned.value, turned.unit) == (pytest.approx(ROTATION_RAD[axis] * 180.0 / np.pi), "deg")
    assert turned.standard_error == pytest.approx(ROTATION_ERROR_RAD[axis] * 180.0 / np.pi)
    assert (shifted.value, shifted.unit) == (pytest.approx(TRANSLATION_MM[axis]), "mm")
    assert shifted.standard_error == pytest.approx(TRANSLATION_ERROR_MM[axis])


def test_an_error_that_is_zero_or_without_limit_is_none() -> None:
    motion = RigidMotion(np.ones(3), np.ones(3), np.array([np.inf, 0.0, 1.0]), np.array([0.0, 1.0, np.inf]))
    pose = pose_of(motion)
    given = [getattr(pose, f"{kind}_{axis}_{unit}") for kind, unit in (("rotation", "deg"), ("translation", "mm"))
             for axis in "xyz"]  # fmt: skip
    assert [metric.standard_error is None for metric in given] == [True, True, False, True, False, True]


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_starts_that_one_decides_whose_points_lie_nearer(order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a turn by 1.5 rad about its axis a freeform settles elsewhere, 0.15 mm off."""
    starts = [np.array([0.0, 0.0, 1.5, 0.0, 0.0, 0.0]), np.zeros(6)][::order]
    monkeypatch.setattr(registration, "_starts", lambda *_: starts)
    surface = random_surface(3, 6.0)
    directions = hemisphere_directions(1500, 1)
    directions = directions[directions[:, 2] > 0.2]
    shift_mm = np.array([0.3, -0.2, 0.1])
    points = surface.radius(directions)[:, None] * directions + shift_mm
    motion = register(fit_patch(surface), points)
    np.testing.assert_allclose(motion.translation_mm, -shift_mm, atol=1e-6)
    np.testing.assert_allclose(motion.rotation_rad, 0.0, atol=1e-6)
