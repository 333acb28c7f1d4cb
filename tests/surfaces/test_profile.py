"""Profiles of revolution: exact where they must be, their slopes, fits, records, and tables of a steep wall."""

import numpy as np
import pytest
from scenes import hemisphere_directions

from lensforge.errors import InputError
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.bicubic_table import grid_for, table_error, tabulate
from lensforge.surfaces.profile import ProfileBasis, ProfileFace
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace
from lensforge.surfaces.surface import surface_record

U = hemisphere_directions(2000) * (1.0, 1.0, 1.2) - (0.0, 0.0, 0.2)
U /= np.linalg.norm(U, axis=1, keepdims=True)
LINEAR = {
    "plane": (PlaneFace(20.0, 6.0), lambda u: u / 6.0),
    "sphere": (ConicFace(20.0, 6.0, 0.0), lambda u: 1.0 / 6.0 + 0.0 * u),
    "hyperboloid": (ConicFace(20.0, 6.0, 1.5), lambda u: (1.0 - 1.5 * u) / 6.0),
}


@pytest.mark.parametrize("name", LINEAR)
def test_what_is_linear_in_the_cosine_is_held_exactly(name: str) -> None:
    """Also beyond its range; the coefficients are the values at the averages, fitted or set."""
    face, line = LINEAR[name]
    basis = ProfileBasis(0.1, 0.9, 8)
    held = ProfileFace(20.0, 0.1, 0.9, tuple(line(basis.averages).tolist()))
    for fit in (held, ProfileFace.fitted(face, 0.1, 0.9, 8, 20.0), ProfileFace.fitted(line, 0.1, 0.9, 8, 20.0)):
        assert fit.coefficients == pytest.approx(held.coefficients, abs=1e-12)
        assert np.abs(fit.radius(U) - face.radius(U)).max() < 1e-11
        assert np.abs(fit.gradient(U) - face.gradient(U)).max() < 1e-10
    assert held.symmetry == "square"


def slopes_of(basis: ProfileBasis, cosines: np.ndarray) -> np.ndarray:
    return basis.at(basis.splines(np.eye(basis.count)), cosines)[1]


def test_the_functions_are_quintic_b_splines_with_four_derivatives() -> None:
    basis = ProfileBasis(-0.2, 0.8, 11)
    h = 1e-6
    u = np.linspace(-1.0, 1.0, 1301)
    matrix = basis.matrix(u)
    slopes = slopes_of(basis, u)
    assert np.abs(matrix.sum(axis=1) - 1.0).max() < 1e-14
    assert basis.matrix(basis.averages[5:6])[0, 2:9] * 120.0 == pytest.approx([0, 1, 26, 66, 26, 1, 0], abs=1e-12)
    differences = (basis.matrix(u + h) - basis.matrix(u - h)) / (2.0 * h)
    assert np.abs(differences - slopes).max() < 1e-6  # at the ends, too, where the bend goes on
    within = slopes[(u > basis.low) & (u < basis.high)]
    fourth = np.diff(within, 3, axis=0)
    assert np.abs(np.diff(fourth, axis=0)).max() < 0.03 * np.abs(fourth).max(), "of a jump it would be all"


def wall(cosines: np.ndarray) -> np.ndarray:
    """From 5 mm at 90 degrees to 19 mm at 50 degrees."""
    up = (0.5 * np.pi - np.arccos(cosines)) / np.radians(40.0)
    return 0.2 + (1.0 / 19.0 - 0.2) * up + 0.02 * np.sin(np.pi * up)


def test_a_fit_converges_in_sixth_order() -> None:
    u = np.linspace(-0.1, 0.64, 900)
    across = np.column_stack([np.zeros_like(u), np.sqrt(1.0 - u**2), u])
    errors = [
        np.abs(ProfileFace.fitted(wall, -0.1, 0.64, 5 + cells, 30.0).radius(across) - 1.0 / wall(u)).max()
        for cells in (5, 10)
    ]
    assert errors[1] < errors[0] / 30.0 and errors[1] < 1e-4


@pytest.mark.parametrize(("preset", "most_nm"), [("draft", 1000.0), ("standard", 50.0)])
def test_tables_hold_a_steep_wall_up_to_its_rim(preset: str, most_nm: float) -> None:
    """Measured 130 and 12 nm, at the rim; below 55 degrees 10 and 3 nm."""
    face = ProfileFace.fitted(wall, -0.15, 0.75, 12, 22.0)
    assert face.radius(np.array([[1.0, 0.0, 0.0]])) == pytest.approx(5.0, abs=1e-3)
    grid = grid_for(face.detail_rad, PRESETS[preset].evaluate_nodes_per_sigma)
    used = np.cos(np.radians(50.0))
    assert table_error(grid, tabulate(grid, face), face, 50_000, within=lambda u: u[:, 2] < used) * 1e6 < most_nm


@pytest.mark.parametrize(
    "face",
    [
        ProfileFace.fitted(wall, -0.15, 0.75, 12, 22.0),
        PlaneFace(20.0, 1.0 / 3.0, (0.1, 0.0, 1.0)),
        ConeFace(20.0, 7.0 / 3.0, 0.1),
        ConicFace(20.0, 5.1, 0.7),
    ],
)
def test_a_record_gives_the_same_bits_back(face) -> None:
    record = surface_record(face)
    again = type(record).model_validate_json(record.model_dump_json()).surface()
    assert again == face and np.array_equal(again.radius(U), face.radius(U))


@pytest.mark.parametrize(
    ("low", "high", "coefficients", "message"),
    [
        (0.5, 0.5, (0.1,) * 6, "low = 0.5, high = 0.5: cosines, must rise"),
        (0.0, 1.1, (0.1,) * 6, "high = 1.1: cosines"),
        (0.0, 1.0, (0.1,) * 5, "5 coefficients: must be 6 at least"),
        (0.0, 1.0, (0.1, np.nan, 0.1, 0.1, 0.1, 0.1), "a coefficient is infinite, or no number"),
        (0.0, 1.0, (0.01,) * 6, "nowhere within 20 mm"),
    ],
)
def test_what_is_no_profile_is_one_line(low: float, high: float, coefficients: tuple, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ProfileFace(20.0, low, high, coefficients)


@pytest.mark.parametrize("end", [-0.2, 0.8])
def test_a_profile_goes_on_with_the_bend_of_its_end_and_then_straight(end: float) -> None:
    """A jump of the curvature spoils the spline of an exported face whose edge lies near the end."""
    basis = ProfileBasis(-0.2, 0.8, 11)
    h = 1e-5
    out = np.sign(end - 0.3)
    before, behind = (
        (slopes_of(basis, np.array([end + h * side])) - slopes_of(basis, np.array([end]))) / (h * side)
        for side in (-out, out)
    )
    assert np.abs(before - behind).max() < 1e-2 * np.abs(before).max(), "of a jump it would be all"
    far = slopes_of(basis, end + 20.0 * out * basis.step * np.array([1.0, 1.5]))
    assert np.abs(far[1] - far[0]).max() < 1e-6
