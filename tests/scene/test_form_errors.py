"""Form errors of a face: their rms along the normal, their spectrum, and what is too fine for the tables."""

import numpy as np
import pytest
from nightly import first_by_day
from scenes import random_surface, small_spec, sphere

from lensforge.scene.made_part import FaceNodes, PartMaker, low_order, ripple, waviness
from lensforge.spec.tolerances_section import FORM_NUMBERS, WAVINESS_NUMBERS, factors_of
from lensforge.surfaces.bicubic_table import TableGrid, evaluate_table
from lensforge.surfaces.srbf import fibonacci_hemisphere

GRID = TableGrid(151)
U = fibonacci_hemisphere(1500)


def _rms_along_normal(tables, surface) -> float:
    """Over the hemisphere and over independent normal numbers."""
    cosine = np.sum(surface.normal(U) * U, axis=1)
    squares = sum((evaluate_table(GRID, table, U) * cosine) ** 2 for table in tables)
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize(
    "surface",
    first_by_day(1, [random_surface(1, 5.0, 0.02), sphere(5.0), random_surface(1, 5.0, 0.06)], "two seconds each"),
    ids=["freeform", "sphere", "steep"],
)
def test_an_error_has_its_rms_along_the_normal(surface) -> None:
    nodes = FaceNodes.of(GRID, surface)
    form = low_order(nodes)
    assert (form.tables.shape[0], form.slope) == (FORM_NUMBERS, 0.0)
    assert _rms_along_normal(form.tables, surface) == pytest.approx(1.0, rel=0.01)
    wavy = waviness(nodes, 1.5, 8.0, 0)
    assert (wavy.tables.shape[0], wavy.slope) == (WAVINESS_NUMBERS, 0.0)
    assert _rms_along_normal(wavy.tables, surface) == pytest.approx(1.0, rel=0.06)  # of 32 fields of a random draw
    rings = ripple(nodes, 2.0)
    along_normal = evaluate_table(GRID, rings.tables[0], U) * np.sum(surface.normal(U) * U, axis=1)
    assert np.ptp(along_normal) == pytest.approx(1.0, rel=0.03)


def _structure(lags_mm: np.ndarray) -> np.ndarray:
    """Mean squared difference of the fields between points that far apart."""
    nodes = FaceNodes.of(GRID, sphere(10.0))
    tables = waviness(nodes, 2.5, 20.0, 1).tables
    squares = []
    for lag in lags_mm:
        chord = lag / 10.0
        turn = 2.0 * np.arcsin(0.5 * chord)
        low = U[U[:, 2] > 0.5]
        across = np.cross(low, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across, axis=1)[:, None]
        other = np.cos(turn) * low + np.sin(turn) * across
        squares.append(np.mean([(evaluate_table(GRID, t, low) - evaluate_table(GRID, t, other)) ** 2 for t in tables]))
    return np.array(squares) * len(tables)


def test_the_spectrum_is_a_power_law_between_its_wavelengths() -> None:
    """Structure function of the mixture: the mean of 2 (1 - exp(-r^2 / 2 s^2)) over its widths."""
    lags = np.array([0.3, 1.0, 3.0, 6.0])
    widths = np.sqrt(2.0) / (2.0 * np.pi) * 20.0 * (2.5 / 20.0) ** ((np.arange(1000) + 0.5) / 1000)
    truth = [float(np.mean(2.0 * (1.0 - np.exp(-0.5 * (lag / widths) ** 2)))) for lag in lags]
    assert _structure(lags) == pytest.approx(truth, rel=0.12)


def test_what_is_too_fine_counts_by_its_slope() -> None:
    surface = sphere(5.0)
    coarse = FaceNodes.of(TableGrid(41), surface)
    fine = waviness(coarse, 0.1, 0.2, 0)
    assert fine.tables.shape == (0, 43, 43)
    widths = np.sqrt(2.0) / (2.0 * np.pi) * 0.2 * 0.5 ** ((np.arange(384) + 0.5) / 384)
    assert fine.slope == pytest.approx(float(np.sqrt(np.mean(1.0 / widths**2))), rel=1e-6)
    # a sine of 1 mm peak to valley and period p has an rms slope of pi / (sqrt(2) p) across, half of its square along
    assert ripple(coarse, 0.1).slope == pytest.approx(np.pi / (np.sqrt(2.0) * 0.1) / np.sqrt(2.0))


@pytest.mark.nightly("two seconds")
def test_tables_hold_a_wave_that_counts_as_fitting() -> None:
    """The narrowest field that a table takes, against its values between the nodes: by a table twice as fine."""
    surface = sphere(5.0)
    grid = TableGrid(101)
    finer = TableGrid(201)
    limit = 2.0 * 2.0 * grid.step * 5.0 * 2.0 * np.pi / np.sqrt(2.0)  # wavelength of the limiting width
    table = waviness(FaceNodes.of(grid, surface), limit * 1.001, limit * 1.01, 0).tables[0]
    true = waviness(FaceNodes.of(finer, surface), limit * 1.001, limit * 1.01, 0).tables[0]
    coarse = evaluate_table(grid, table, U)
    fine = evaluate_table(finer, true, U)
    assert np.std(coarse - fine) < 0.01 * np.std(fine)


def test_a_face_is_as_rough_as_its_finish_and_what_is_too_fine_for_its_table() -> None:
    """Squares of slopes add up: of a finish of 2 mrad, and of waves by the mean square of their numbers."""
    band = {"waviness_shortest_mm": 0.1, "waviness_longest_mm": 0.2}
    spec = small_spec(tolerances=band, lens__outer__waviness_um=0.5)
    grid = TableGrid(41)
    outer = sphere(5.0)
    factors = factors_of(spec.part_tolerances)
    maker = PartMaker.of(spec, {"inner": sphere(3.0), "outer": outer}, grid, factors)
    numbers = np.array([3e-4, -4e-4])
    part = maker.part({"outer_waviness_um": numbers, "outer_roughness_mrad": np.array([2e-3])})
    waves = np.sqrt(np.mean(numbers**2)) * waviness(FaceNodes.of(grid, outer), 0.1, 0.2, 0).slope
    assert part.made.slopes == {"inner": 0.0, "outer": pytest.approx(np.hypot(2e-3, waves), rel=1e-6)}


def test_an_led_tilts_and_grows_about_its_own_place_in_each_state() -> None:
    """Its middle moves by the shift; a point 1 mm beside it by the turn and by a tenth, too."""
    shift = np.array([0.02, -0.01, 0.03])
    deviations = {"source_tilt_deg": [0.0, 0.03], "source_size": [0.1], "source_shift_mm": shift[:2]}
    deviations |= {"source_height_mm": shift[2:]}
    part = PartMaker.of(small_spec(), {"inner": sphere(3.0)}, GRID, ()).part(
        {name: np.array(deviation) for name, deviation in deviations.items()}
    )
    for place in np.array([[0.3, -0.2, 0.5], [0.0, 0.0, -0.4]]):
        made = part.in_state(small_spec(source__position_mm=place.tolist())).made
        points = made.placed.into.points(np.array([place, place + np.eye(3)[0]]), made.source_size)
        beside = [1.1 * np.cos(0.03), 0.0, -1.1 * np.sin(0.03)]
        np.testing.assert_allclose(points - place, [shift, shift + beside], atol=1e-12)


def test_a_part_is_as_large_as_its_shrinkage_and_the_temperature_of_the_state_make_it() -> None:
    part = PartMaker.of(small_spec(), {"inner": sphere(3.0)}, GRID, ()).part({"shrinkage": np.array([-0.002])})
    warm = small_spec(lens__index_per_k=0.0, lens__expansion_per_k=1e-4, lens__temperature_c=70.0)
    assert [part.in_state(spec).made.scale for spec in (small_spec(), warm)] == pytest.approx(
        [0.998, 0.998 * warm.lens.scale], rel=1e-15
    )
    assert warm.lens.scale > 1.004
