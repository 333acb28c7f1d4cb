"""The benchmark in the plane: both tracers by closed forms and against each other, derivatives, and the fit."""

import numpy as np
import pytest
from plane_fit import PlaneScene, error, fitted
from plane_tracer import PlaneLens, PlaneSource, Profile, pixel_light

COUNT = 16
SCENE = PlaneScene(0.25, 0.6, 0.3, 1.5, 300.0, np.linspace(-250.0, 300.0, 23), nodes=6, cells=1500)


def lens_like(apex_mm: tuple[float, float], bend: float, uneven: float = 0.0) -> np.ndarray:
    """Coefficients of a circle, but for ``uneven``, and of a profile that is farther on the axis than at the side."""
    places = np.linspace(-1.0, 1.0, COUNT)
    inner, outer = ((1.0 + by * places**2 + uneven * places) / mm for by, mm in zip((0.0, bend), apex_mm, strict=True))
    return np.array([inner, outer])


UNEVEN = lens_like((2.0, 4.5), 0.6, 0.03)


def plane_lens(coefficients: np.ndarray) -> PlaneLens:
    return PlaneLens(*map(Profile, coefficients.tolist()), SCENE.index, SCENE.distance_mm)


@pytest.fixture(scope="module")
def light():
    return SCENE.light(UNEVEN)


def test_light_from_the_middle_of_two_circles_goes_straight_through_both():
    circles = np.full((2, COUNT), 1.0) / np.array([[2.0], [5.0]])
    place, share = plane_lens(circles).landed(0.0, 0.4)
    assert place == pytest.approx(0.4 * 300.0, rel=1e-13)
    assert share == pytest.approx((1.0 - 0.2**2) ** 2, rel=1e-13)


def test_a_ray_along_z_beside_the_middle_of_circles_turns_by_the_law_of_sines():
    """At r it keeps n b, b its distance from the middle: it meets a circle at asin(b/r), and leaves to n b / n'."""
    circles = np.full((2, COUNT), 1.0) / np.array([[2.0], [5.0]])
    off_mm = 0.4
    first, inside = np.arcsin(off_mm / 2.0), np.arcsin(off_mm / 2.0 / 1.5)
    second, leaves = np.arcsin(off_mm / 1.5 / 5.0), np.arcsin(off_mm / 5.0)
    crossing = first - inside + second  # angle of the outer crossing from z
    turn = crossing - leaves
    place = 5.0 * np.sin(crossing) - (300.0 - 5.0 * np.cos(crossing)) * np.tan(-turn)
    assert plane_lens(circles).landed(off_mm, 0.0)[0] == pytest.approx(place, rel=1e-12)


def test_both_tracers_find_the_same_light_of_an_uneven_lens(light):
    second = pixel_light(plane_lens(UNEVEN), PlaneSource(0.25, 0.6, 0.3), SCENE.borders, SCENE.nodes)
    assert error(light.pixels, second) < 2e-6
    assert light.pixels.sum() == pytest.approx(second.sum(), rel=2e-5)  # six places know the flux of the source so well
    assert abs(light.pixels[:11].sum() / light.pixels[11:].sum() - 1.0) > 0.05
    assert light.lost == light.folded == 0.0


@pytest.mark.parametrize(("face", "number"), [(0, 7), (1, 9)])
def test_derivatives_are_difference_quotients(light, face, number):
    moved = UNEVEN.copy()
    moved[face, number] += 1e-6
    quotient = (SCENE.light(moved).pixels - light.pixels) / 1e-6
    assert np.abs(light.slopes[:, face, number] - quotient).max() < 1e-3 * np.abs(quotient).max()


def test_a_fit_finds_the_light_of_a_known_lens_with_faces_of_other_sizes():
    scene = PlaneScene(0.25, 0.6, 0.3, 1.5, 300.0, np.linspace(-400.0, 400.0, 33), nodes=8, cells=60)
    wanted = scene.light(lens_like((2.0, 4.5), 0.6)).pixels
    start = lens_like((1.5, 5.5), 0.2)
    errors = [step.error for step, _ in zip(fitted(scene, start, wanted), range(40), strict=False)]
    assert error(scene.light(start).pixels, wanted) > 0.05
    assert errors[-1] < 1e-3
