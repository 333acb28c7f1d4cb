"""Directions and inverses of distributions, traced back to the numbers that they were drawn by; emitters ray by ray."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from lensforge.errors import InputError
from lensforge.seeds import sobol
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.emitting_area import Rectangles
from lensforge.sources.intensity import CosinePower, TabulatedIntensity
from lensforge.sources.inverse_cdf import choose, choose_each, linear_inverse
from lensforge.sources.planar_emitter import PlanarEmitter, planar_emitter
from lensforge.spec.source_sections import ChipArraySource, RectangleSource

C_DEG, GAMMA_DEG = np.array([0.0, 70.0, 200.0, 360.0]), np.array([10.0, 40.0, 60.0, 80.0, 110.0])
# dark between 60 and 80 degrees; the planes differ in flux and in shape
VALUES = np.array(
    [[5.0, 4.0, 0.0, 0.0, 2.0], [1.0, 7.0, 0.0, 0.0, 2.0], [2.0, 9.0, 0.0, 0.0, 6.0], [5.0, 4.0, 0.0, 0.0, 2.0]]
)
TABLE = TabulatedIntensity(C_DEG, GAMMA_DEG, VALUES)
NUMBERS = np.array([[0.0, 0.0], [0.1, 0.03], [0.35, 0.3], [0.5, 0.5], [0.6, 0.72], [0.93, 0.8], [0.999, 0.999]])


def angles(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = directions.T
    return np.rad2deg(np.arctan2(y, x)) % 360.0, np.rad2deg(np.arctan2(np.hypot(x, y), z))


def plane(c_deg: float) -> np.ndarray:
    """The table's values in one half-plane, linear between the two beside it."""
    return np.array([np.interp(c_deg, C_DEG, column) for column in VALUES.T])


def flux_of_plane(c_deg: float, up_to_deg: float = 110.0) -> float:
    values = plane(c_deg)
    edges = [gamma_deg for gamma_deg in GAMMA_DEG if gamma_deg < up_to_deg]
    parts = zip(edges, [*edges[1:], up_to_deg], strict=True)
    at = [quad(lambda g: np.interp(g, GAMMA_DEG, values) * np.sin(np.deg2rad(g)), *part)[0] for part in parts]
    return sum(at)


def test_a_table_maps_each_number_to_the_angle_below_which_that_share_of_the_flux_is() -> None:
    c_deg, gamma_deg = angles(TABLE.aim(NUMBERS))
    fluxes = [flux_of_plane(c) for c in C_DEG]
    ends = np.concatenate([[0.0], np.cumsum(0.5 * (np.array(fluxes[1:]) + fluxes[:-1]) * np.diff(C_DEG))])
    for (along, around), c, gamma in zip(NUMBERS, c_deg, gamma_deg, strict=True):
        sector = min(int(np.searchsorted(C_DEG, c, side="right")) - 1, 2)
        low, high, width = fluxes[sector], fluxes[sector + 1], C_DEG[sector + 1] - C_DEG[sector]
        part = (c - C_DEG[sector]) / width
        passed = ends[sector] + width * (low * part + 0.5 * (high - low) * part**2)
        assert passed / ends[-1] == pytest.approx(around, abs=1e-9)
        assert flux_of_plane(c, max(gamma, 10.0 + 1e-9)) / flux_of_plane(c) == pytest.approx(along, abs=2e-5)
    assert TABLE.flux() == pytest.approx(ends[-1] * np.deg2rad(1.0) ** 2, rel=1e-9)
    np.testing.assert_allclose(TABLE.plane_fluxes, np.array(fluxes) * np.deg2rad(1.0), rtol=1e-9)


def test_a_table_of_revolution_is_turned_by_the_second_number_alone() -> None:
    table = TabulatedIntensity(np.zeros(1), GAMMA_DEG, VALUES[:1])
    c_deg, gamma_deg = angles(table.aim(NUMBERS))
    np.testing.assert_allclose(c_deg, 360.0 * NUMBERS[:, 1], atol=1e-9)
    for along, gamma in zip(NUMBERS[:, 0], gamma_deg, strict=True):
        assert flux_of_plane(0.0, max(gamma, 10.0 + 1e-9)) / flux_of_plane(0.0) == pytest.approx(along, abs=2e-5)
    assert table.flux() == pytest.approx(2.0 * np.pi * flux_of_plane(0.0) * np.deg2rad(1.0), rel=1e-9)
    np.testing.assert_array_equal(table.at(123.0), VALUES[0])


@pytest.mark.parametrize("power", [0.0, 1.0, 3.0])
def test_a_power_of_the_cosine_maps_numbers_by_its_closed_form(power: float) -> None:
    profile = CosinePower(power)
    directions = profile.aim(NUMBERS)
    c_deg, _ = angles(directions)
    np.testing.assert_allclose(c_deg[1:], 360.0 * NUMBERS[1:, 1], atol=1e-9)
    np.testing.assert_allclose(1.0 - directions[:, 2] ** (power + 1.0), NUMBERS[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    total = 2.0 * np.pi * quad(lambda z: float(profile.intensity(np.array([[0.0, 0.0, z]]))[0]), 0.0, 1.0)[0]
    assert total == pytest.approx(1.0)
    assert profile.intensity(np.array([[0.6, 0.0, 0.8]]))[0] == pytest.approx((power + 1) / (2 * np.pi) * 0.8**power)
    assert profile.symmetry == "square"


@pytest.mark.parametrize("planes", [1, 4])
def test_the_intensity_of_a_table_is_bilinear_and_of_flux_1_over_all_directions(planes: int) -> None:
    """By Gauss's quadrature within each cell, against the values of the two half-planes beside each direction."""
    table = TabulatedIntensity(C_DEG if planes == 4 else C_DEG[:1], GAMMA_DEG, VALUES[:planes])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    total = 0.0
    for low, high in pairwise(np.deg2rad(GAMMA_DEG)):
        for first, last in pairwise(C_DEG):
            gamma, c = (0.5 * (a + b) + 0.5 * (b - a) * nodes for a, b in ((low, high), (first, last)))
            turn, rise = np.meshgrid(np.deg2rad(c), gamma, indexing="ij")
            ways = np.stack([np.sin(rise) * np.cos(turn), np.sin(rise) * np.sin(turn), np.cos(rise)], axis=-1)
            intensities = table.intensity(ways.reshape(-1, 3)).reshape(20, 20)
            for angle, row in zip(c, intensities, strict=True):
                values = plane(angle) if planes == 4 else VALUES[0]
                np.testing.assert_allclose(row * table.flux(), np.interp(gamma, np.deg2rad(GAMMA_DEG), values))
            width = 0.25 * np.deg2rad(last - first) * (high - low)
            total += width * float(weights @ intensities @ (weights * np.sin(gamma)))
    assert total == pytest.approx(1.0, rel=1e-10)


def test_a_planar_emitter_places_by_two_numbers_and_aims_by_two_others() -> None:
    area = Rectangles(np.array([[1.0, -2.0]]), np.array([[0.5, 3.0]]), np.ones(1))
    emitter, points = PlanarEmitter(area, TABLE, 2.0), sobol(32, 4, 9)
    rays = emitter.sample(32, 9)
    np.testing.assert_array_equal(rays.origins[:, :2], area.place(points[:, :2]))
    np.testing.assert_array_equal(rays.origins[:, 2], 0.0)
    np.testing.assert_array_equal(rays.directions, TABLE.aim(points[:, 2:]))
    np.testing.assert_array_equal(rays.flux, 2.0 / 32)
    share = TABLE.intensity(rays.directions) / np.abs(rays.directions[:, 2])
    np.testing.assert_allclose(emitter.radiances(32, 9), 2.0 / 1.5 * share)
    assert emitter.outline().tolist() == [[*corner, 0.0] for corner in area.corners().tolist()]
    assert emitter.ray_count is None and emitter.symmetry == "none"


def test_an_array_of_chips_is_centred_on_the_axis() -> None:
    area = planar_emitter(ChipArraySource(columns=3, rows=2, width_mm=0.5, height_mm=0.4, pitch_mm=(0.7, 0.6))).area
    by_hand = [[-0.7, -0.3], [0.0, -0.3], [0.7, -0.3], [-0.7, 0.3], [0.0, 0.3], [0.7, 0.3]]
    np.testing.assert_allclose(area.centres, by_hand, atol=1e-15)
    np.testing.assert_array_equal(area.sides, [[0.5, 0.4]] * 6)
    np.testing.assert_allclose(area.shares, 1.0 / 6.0)
    alone = planar_emitter(RectangleSource(width_mm=2.0, height_mm=1.0))
    assert (alone.area.centres.tolist(), alone.area.sides.tolist()) == ([[0.0, 0.0]], [[2.0, 1.0]])
    assert alone.profile == CosinePower(1.0) and alone.flux_w == 1.0


@pytest.mark.parametrize("count", [1, 8])
def test_a_square_emitter_maps_four_numbers_by_malley_s_method(count: int) -> None:
    rays = SquareEmitter(3.0, 5.0).sample(count, 4)
    for place, way, (x, y, u, v) in zip(rays.origins, rays.directions, sobol(count, 4, 4), strict=True):
        assert place.tolist() == pytest.approx([3.0 * (x - 0.5), 3.0 * (y - 0.5), 0.0])
        sine, turn = np.sqrt(u), 2.0 * np.pi * v
        assert way.tolist() == pytest.approx([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - u)])
    assert rays.flux.tolist() == [5.0 / count] * count
    with pytest.raises(InputError, match="0 rays: at least 1"):
        SquareEmitter(3.0).sample(0, 4)


CELLS = [2.0, 1.0, 0.0, 5.0, 0.0]  # their shares: dark ones in the middle and at the end
ENDS = np.cumsum(CELLS)
# the ends of cells themselves belong to the next cell that has a share
SHARES = np.array([0.0, 0.125, 0.24999, 0.25, 0.3, 0.375, 0.5, 0.99])


def by_loop(shares: list[float], number: float) -> tuple[int, float]:
    """Walk through the cells until the number is spent; a dark cell holds nothing."""
    left = number * sum(shares)
    for cell, share in enumerate(shares):
        if left < share:
            return cell, left / share
        left -= share
    raise ValueError(number)


def test_each_number_is_in_the_cell_that_a_walk_through_the_cells_finds() -> None:
    expected = [by_loop(CELLS, number) for number in SHARES]
    cells, rest = choose(ENDS, SHARES)
    assert cells.tolist() == [cell for cell, _ in expected]
    np.testing.assert_allclose(rest, [part for _, part in expected], atol=1e-12)


def test_a_distribution_without_any_share_draws_numbers() -> None:
    assert np.isfinite(choose(np.zeros(3), SHARES)[1]).all()
    assert np.isfinite(choose_each(lambda cell: np.zeros(len(cell)), 5, SHARES)[1]).all()


def test_each_number_may_have_a_distribution_of_its_own() -> None:
    rows = [CELLS, CELLS[::-1], [3.0, 1.0, 0.5, 0.25, 7.0], [0.0, 0.0, 4.0, 0.0, 4.0]]
    for numbers in (SHARES[:4], SHARES[4:]):
        before = np.pad(np.cumsum(rows, axis=1), ((0, 0), (1, 0)))
        cells, rest = choose_each(lambda cell, before=before: before[np.arange(4), cell], 5, numbers)
        expected = [by_loop(row, number) for row, number in zip(rows, numbers, strict=True)]
        assert cells.tolist() == [cell for cell, _ in expected]
        np.testing.assert_allclose(rest, [part for _, part in expected], atol=1e-12)


@pytest.mark.parametrize(("first", "second"), [(1.0, 1.0), (0.0, 2.0), (3.0, 0.0), (0.5, 4.0), (7.0, 2.0)])
def test_the_area_of_a_trapezoid_up_to_the_position_is_the_share(first: float, second: float) -> None:
    share = np.array([0.0, 0.1, 0.5, 0.75, 1.0])
    place = linear_inverse(np.full(5, first), np.full(5, second), share)
    area = first * place + 0.5 * (second - first) * place**2
    np.testing.assert_allclose(area, share * 0.5 * (first + second), atol=1e-14)
    assert place[0] == 0.0 and place[-1] == pytest.approx(1.0)
