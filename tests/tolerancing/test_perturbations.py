"""Displaced and deformed surfaces, and a source shifted for rays that carry indices of their own."""

import numpy as np
import pytest
from scenes import random_surface, small_spec, sphere

from lensforge.sources.build import build_source
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.tolerancing.perturbations import Displaced, ShiftedSource, with_form_error

U = fibonacci_hemisphere(3000)


def test_a_shifted_sphere_has_its_closed_form():
    shift = np.array([0.05, -0.02, 0.03])
    along = U @ shift
    exact = along + np.sqrt(36.0 - shift @ shift + along**2)
    assert np.abs(Displaced(sphere(6.0), tuple(shift)).radius(U) - exact).max() < 1e-12


def test_a_displaced_freeform_lies_on_the_moved_points():
    surface, shift, tilt = random_surface(3, 6.0, 0.02, (9, 25)), np.array([0.03, 0.02, -0.04]), 0.004
    radius = Displaced(surface, tuple(shift), tilt).radius(U)
    cosine, sine = np.cos(tilt), np.sin(tilt)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    back = (radius[:, None] * U - shift) @ turn  # the inverse of a rotation is its transpose
    length = np.linalg.norm(back, axis=1)
    assert np.abs(length - surface.radius(back / length[:, None])).max() < 1e-9


def test_a_tilt_turns_y_towards_z():
    bump = random_surface(5, 6.0, 0.02, (9, 25))
    turned = Displaced(bump, tilt_rad=0.1).radius(np.array([[0.0, np.cos(0.1), np.sin(0.1)]]))
    assert turned == pytest.approx(bump.radius(np.array([[0.0, 1.0, 0.0]])), rel=1e-12)


@pytest.mark.parametrize("functions", [9, 81])
def test_the_form_error_has_its_rms_along_the_normal(functions):
    surface = random_surface(3, 6.0, 0.03, (9, 25))
    wrong = with_form_error(surface, functions, 1.75, 2e-3, seed=4)
    u = fibonacci_hemisphere(20_000)
    error = (wrong.radius(u) - surface.radius(u)) * np.sum(surface.normal(u) * u, axis=1)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(2e-3, rel=0.01)


def test_an_error_of_index_reaches_rays_with_indices_of_their_own_and_only_these():
    light = {"kind": "line", "wavelength_nm": 450.0}
    dispersed = small_spec(source={"kind": "square", "side_mm": 1.0, "spectrum": light}, lens__material="PMMA")
    plain = small_spec()
    for spec in (dispersed, plain):
        source = build_source(spec.source, spec.lens.dispersion)
        before, after = (s.sample(16, 1) for s in (source, ShiftedSource(source, (0.5, 0.0, 0.0), 1e-3)))
        np.testing.assert_allclose(after.origins - before.origins, np.tile([0.5, 0.0, 0.0], (16, 1)), atol=1e-15)
        np.testing.assert_array_equal(after.flux, before.flux)
        if spec is plain:
            assert after.refractive_indices is None
        else:
            np.testing.assert_allclose(after.refractive_indices - before.refractive_indices, 1e-3, atol=1e-15)
