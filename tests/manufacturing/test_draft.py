import numpy as np
import pytest
from known_shapes import sampled, sphere

from lensforge.manufacturing.draft import draft_rad, largest_tilt_rad, undercut_fraction
from lensforge.manufacturing.face import AirSide


@pytest.mark.parametrize("air", list(AirSide))
def test_a_raised_sphere_is_undercut_below_its_equator(air):
    radius, height = 2.0, 0.5
    samples = sampled(sphere(radius, (0.0, 0.0, height)), air, 161)
    expected = np.arcsin(np.clip((samples.points[:, 2] - height) / radius, -1.0, 1.0))
    assert np.abs(draft_rad(samples) - expected)[expected < 1.5].max() < 1e-6
    assert abs(draft_rad(samples).min() - np.arcsin(-height / radius)) < 1e-6
    assert abs(largest_tilt_rad(samples) - np.arccos(-height / radius)) < 1e-6
    # Archimedes: the area of a zone is proportional to its height.
    assert abs(undercut_fraction(samples) - height / (radius + height)) < 5e-3


@pytest.mark.parametrize("air", list(AirSide))
def test_a_hemisphere_has_no_undercut_and_no_draft_at_its_rim(air):
    samples = sampled(sphere(2.0), air)
    assert undercut_fraction(samples) == 0.0
    assert abs(draft_rad(samples).min()) < 1e-8
    assert abs(draft_rad(samples).max() - np.pi / 2.0) < 1e-6
