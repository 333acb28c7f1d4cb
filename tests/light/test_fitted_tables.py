"""Fitted intensity tables against plain calculations: dense matrices, waves one by one, loops over samples."""

from itertools import pairwise, permutations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from lensforge.light.angular_grid import (
    AngularGrid,
    _candidates,
    _chosen,
    _interpolation_error,
    _Pyramid,
    _rival,
    finest_grid,
)
from lensforge.results.replicate_pairs import mean_over_pairs
from lensforge.sources.ray_bundle import RayBundle

GAMMA_DEG = np.array([0.0, 4.0, 10.0, 25.0, 40.0, 60.0, 75.0, 90.0])


def ways(c_deg, gamma_deg):
    c = np.deg2rad(c_deg)
    gamma = np.deg2rad(gamma_deg)
    return np.stack([np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), np.cos(gamma)], axis=-1)


def hat(node, gamma_deg):
    return np.interp(gamma_deg, GAMMA_DEG, np.eye(len(GAMMA_DEG))[node])


def test_a_ray_is_shared_by_the_four_nodes_around_it():
    grid = AngularGrid(8, GAMMA_DEG)
    c_deg = np.array([10.0, 350.0, 315.0, 200.0, 0.0])
    gamma_deg = np.array([7.0, 30.0, 90.0, 2.0, 85.0])
    rays = RayBundle(np.zeros((5, 3)), ways(c_deg, gamma_deg), np.arange(1.0, 6.0))
    expected = np.zeros((8, 8))
    for number, (c, gamma) in enumerate(zip(c_deg, gamma_deg, strict=True), start=1):
        for plane in range(8):
            around = max(1.0 - abs((c - 45.0 * plane + 180.0) % 360.0 - 180.0) / 45.0, 0.0)
            expected[plane] += number * around * np.array([hat(node, gamma) for node in range(8)])
    np.testing.assert_allclose(grid.deposit(rays), expected, atol=1e-12)
    values = np.random.default_rng(2).random((8, 8))
    read = grid.readings(c_deg + 360.0 * np.arange(-2, 3), gamma_deg) @ values.ravel()
    by_hand = [_bilinear(values, *angles) for angles in zip(c_deg, gamma_deg, strict=True)]
    np.testing.assert_allclose(read, by_hand, rtol=1e-12)


def _bilinear(values, c_deg, gamma_deg):
    column = [np.interp(c_deg, 45.0 * np.arange(9), [*ring, ring[0]]) for ring in values.T]
    return np.interp(gamma_deg, GAMMA_DEG, column)


def gram():
    """Integrals of the products of two functions of gamma with its sine, by adaptive quadrature."""
    matrix = np.zeros((8, 8))
    nodes = range(8)
    for row in nodes:
        for column in nodes:
            edges = [GAMMA_DEG[k] for k in nodes if abs(k - row) <= 1 and abs(k - column) <= 1]
            matrix[row, column] = sum(
                quad(lambda g, i=row, j=column: hat(i, g) * hat(j, g) * np.sin(np.deg2rad(g)), low, high)[0]
                for low, high in pairwise(edges)
            )
    return matrix * np.deg2rad(1.0)


def first_cones(planes):
    """For each wave around the axis the first cone on which its half length is not below the step of gamma."""
    gamma = np.deg2rad(GAMMA_DEG)
    steps = np.gradient(gamma)
    cones = []
    for wave in range(planes // 2 + 1):
        fine = [k for k in range(8) if np.pi * np.sin(gamma[k]) >= wave * steps[k]]
        cones.append(fine[0] if fine else 8)
    return cones


@pytest.mark.parametrize("planes", [8, 30, 7])
def test_the_fit_is_the_mean_of_the_nearest_table_and_of_the_averages(planes):
    """Along C by a circulant matrix, along gamma node by node; each wave from the first cone that resolves it."""
    grid = AngularGrid(planes, GAMMA_DEG)
    deposits = np.random.default_rng(planes).uniform(0.5, 1.0, (2, planes, 8))
    step = 2.0 * np.pi / planes
    mass = gram()
    beside = np.roll(np.eye(planes), 1, axis=0) + np.roll(np.eye(planes), -1, axis=0)
    around = 0.5 * (np.eye(planes) / step + np.linalg.inv(step / 6.0 * (4.0 * np.eye(planes) + beside)))
    firsts = first_cones(planes)
    assert len(set(firsts)) > 2, "waves that begin at several cones"
    expected_tables = []
    for deposit in deposits:
        turned = around @ deposit
        angles = step * np.arange(planes)
        expected = np.zeros((planes, 8))
        for wave, first in enumerate(firsts):
            for part in (np.cos(wave * angles), np.sin(wave * angles)):
                size = part @ part
                if size > 1e-9 and first < 8:
                    expected += np.outer(part, along_gamma(part @ turned / size, mass, first))
        expected_tables.append(expected)
    tables = np.stack(expected_tables)
    means = tables.mean(axis=1)
    drawn = drawn_to_parabolas(means, deposits.sum(axis=(0, 1)), 2.0 * np.pi * mass.sum(axis=1), planes)
    assert not np.allclose(drawn, means, rtol=1e-6), "cones about the axis that are drawn"
    np.testing.assert_allclose(grid.fitted(deposits), tables + (drawn - means)[:, None], rtol=1e-9, atol=1e-12)


def drawn_to_parabolas(means, flux, solid_angles, planes):
    """Cones that hold four typical nodes drawn to parabolas in gamma, by the share of the deviation that is noise."""
    most = 1
    while solid_angles[:most].sum() < 4.0 * (flux @ solid_angles) / (flux.sum() * planes):
        most += 1
    values = means.copy()
    for count in range(3, max(most, 3) + 1):
        weights = solid_angles[:count]
        fits = [np.polyfit(GAMMA_DEG[:count] ** 2, sample[:count], 1, w=np.sqrt(weights)) for sample in means]
        parabolas = np.array([np.polyval(fit, GAMMA_DEG[:count] ** 2) for fit in fits])
        off = means[:, :count] - parabolas
        noise = weights @ ((off - off.mean(axis=0)) ** 2).sum(axis=0) / (len(means) * (len(means) - 1))
        share = min(noise / (weights @ off.mean(axis=0) ** 2), 1.0)
        values[:, :count] = (1.0 - share) * values[:, :count] + share * parabolas
    return values


def along_gamma(flux, mass, first):
    values = np.zeros(8)
    values[first:] = np.linalg.solve(mass[first:, first:], flux[first:])
    result = values.copy()
    for low in range(7):
        share = 0.5 * min((6 - low) / 4.0, 1.0)
        flow = share * mass[low, low + 1] * (values[low + 1] - values[low])
        result[low] += flow / mass[low].sum()
        result[low + 1] -= flow / mass[low + 1].sum()
    result[:first] = 0.0
    return result


def test_solid_angles_are_row_sums_and_add_up_to_a_hemisphere():
    grid = AngularGrid(12, GAMMA_DEG)
    np.testing.assert_allclose(grid.solid_angles, gram().sum(axis=1) * np.pi / 6.0, rtol=1e-12)
    assert 12 * grid.solid_angles.sum() == pytest.approx(2.0 * np.pi)
    assert grid.c_deg.tolist() == [30.0 * k for k in range(12)]


def test_cones_of_less_than_no_light_are_made_up_for_by_all_others():
    grid = AngularGrid(4, np.array([0.0, 30.0, 60.0, 90.0]))
    values = np.array([[1.0, 2.0, -1.0, 0.0], [1.0, 2.0, 0.5, 0.0], [1.0, 2.0, -1.0, 0.0], [1.0, 2.0, 0.5, 0.0]])
    table = grid.table(values)
    flux = (values * grid.solid_angles).sum()
    scale = flux / (values[:, :2] * grid.solid_angles[:2]).sum()
    np.testing.assert_allclose(table.values[:4], scale * np.maximum(values, 0.0) * [1.0, 1.0, 0.0, 0.0], atol=1e-15)
    assert table.c_deg.tolist() == [0.0, 90.0, 180.0, 270.0, 360.0] and (table.values[4] == table.values[0]).all()


def pyramid(samples):
    """Deposits of a beam off the axis, of which each sample has few rays."""
    finest = finest_grid(42.0)
    parts = []
    for seed in range(samples):
        some = np.random.default_rng(seed).normal(size=(3000, 3)) * [0.2, 0.1, 0.05] + [0.3, 0.0, 1.0]
        some /= np.linalg.norm(some, axis=1, keepdims=True)
        parts.append(finest.deposit(RayBundle(np.zeros((3000, 3)), some, np.full(3000, 1.0 / 3000))))
    return _Pyramid(finest, np.stack(parts))


COARSE = (4, 5)
LEVEL = (3, 3)
FINER = (2, 2)


def mean_square(added, weights):
    """Mean over all pairs of different samples: what they have in common, without the noise of either."""
    pairs = [np.sum(weights * one * other) for one, other in permutations(added, 2)]
    return np.mean(pairs) / weights.sum()


def integral_of_products(grid, first, second):
    return sum(grid.solid_angles[k] * (first[:, k] @ second[:, k]) for k in range(len(grid.gamma_deg)))


def test_a_finer_table_gains_its_structure_less_its_noise():
    """By means of the samples and their variances: what both have in common counts without noise."""
    made = pyramid(6)
    for candidate in list(_candidates(made, LEVEL))[1:]:
        added = made.difference(LEVEL, candidate.level)
        grid = made.grid(candidate.level)
        pairs = [integral_of_products(grid, one, other) for one, other in permutations(added, 2)]
        noises = [
            (made.table(level).var(axis=0, ddof=1) / 6.0 * made.grid(level).solid_angles).sum()
            for level in (candidate.level, LEVEL)
        ]
        assert candidate.gain == pytest.approx(np.mean(pairs) - noises[0] + noises[1], rel=1e-9)


def test_a_single_sample_stays_where_it_is_and_few_know_no_rival():
    made = pyramid(1)
    assert _chosen(made, LEVEL) == (LEVEL, [(level, 0.0) for level in ((2, 3), (3, 2), (2, 2))])
    assert _rival(made, *_chosen(made, LEVEL)) is None


def test_the_chance_of_other_steps_is_by_the_error_of_what_they_gain_less():
    made = pyramid(6)
    level, left_out = _chosen(made, COARSE)
    assert level != COARSE and len(left_out) > 3 and min(chance for _, chance in left_out) < 1e-9
    best, *others = sorted(_candidates(made, COARSE), key=lambda candidate: -candidate.gain)
    for candidate, (other, chance) in zip(others, left_out, strict=False):
        assert other == candidate.level
        behind = candidate.gains - best.gains
        left = [mean_over_pairs(np.delete(np.delete(behind, k, 0), k, 1)) for k in range(6)]
        error = np.sqrt(5.0 / 6.0 * np.sum((left - np.mean(left)) ** 2))
        bounds = [norm.cdf((candidate.gain - best.gain) / (factor * error)) for factor in (0.6, 1.01)]
        assert bounds[0] <= chance <= bounds[1] < 0.5, "the jackknife is too large by the noise of squares"
    rival = _rival(made, level, left_out)
    variances = [chance * (1.0 - chance) * made.apart(level, other) for other, chance in left_out]
    other, chance = left_out[int(np.argmax(variances))]
    assert rival.doubt == pytest.approx(np.sqrt(chance - chance**2)) and rival.doubt > 0.0
    np.testing.assert_array_equal(rival.light.samples, made.table(other))


def test_tables_of_two_steps_are_compared_where_both_are_exact():
    made = pyramid(4)
    grid = made.grid((2, 2))
    refined = {
        (3, 2): grid.refined(made.table((3, 2)), "c").mean(axis=0),
        (2, 3): grid.refined(made.table((2, 3)), "gamma").mean(axis=0),
    }
    difference = refined[3, 2] - refined[2, 3]
    expected = integral_of_products(grid, difference, difference)
    assert made.apart((3, 2), (2, 3)) == pytest.approx(expected, rel=1e-9) and expected > 0.0


@pytest.mark.parametrize("count", [3, 6])
def test_the_error_of_interpolation_is_the_root_of_the_mean_square_and_one_standard_error(count):
    made = pyramid(count)
    added = made.difference(LEVEL, FINER)
    grid = made.grid(FINER)
    coarse = made.table(LEVEL).mean(axis=0)
    refined = grid.refined(grid.coarser("gamma").refined(coarse[None], "c"), "gamma")[0]
    weights = grid.solid_angles * (refined > 0.1 * refined.max())
    left_out = [mean_square(np.delete(added, k, axis=0), weights) for k in range(count)]
    error = np.sqrt((count - 1) / count * np.sum((left_out - np.mean(left_out)) ** 2))
    expected = 4.0 / 3.0 * np.sqrt(max(mean_square(added, weights) + error, 0.0)) / coarse.max()
    assert _interpolation_error(made, LEVEL) == pytest.approx(expected, rel=1e-9)


def test_two_samples_cannot_tell_their_error_of_interpolation():
    assert _interpolation_error(pyramid(2), LEVEL) is None


def test_samples_that_have_nothing_in_common_have_no_error_of_interpolation():
    """Two pairs of opposite samples: the mean over pairs of different ones is below 0, the same without any of them."""

    class Opposite(_Pyramid):
        def difference(self, coarse, fine):
            return added

    made = pyramid(4)
    opposite = Opposite(made.grid((0, 0)), made._deposits[(0, 0)])
    grid = opposite.grid((1, 1))
    added = np.array([1.0, -1.0, 1.0, -1.0])[:, None, None] * np.ones((1, grid.planes, len(grid.gamma_deg)))
    assert _interpolation_error(opposite, (2, 2)) == 0.0


def test_the_axis_is_as_well_known_as_the_light_beside_it() -> None:
    """Its cell is the smallest of all: rays of a Lambertian source, few enough for their noise to tell."""
    grid = AngularGrid(12, np.linspace(0.0, 90.0, 37))
    rays = []
    random = np.random.default_rng(0)
    for _ in range(16):
        square = random.random(2**10)
        turn = 2.0 * np.pi * random.random(2**10)
        side = np.sqrt(square)
        directions = np.column_stack([side * np.cos(turn), side * np.sin(turn), np.sqrt(1.0 - square)])
        rays.append(RayBundle(0.0 * directions, directions, np.full(2**10, 2.0**-10)))
    samples = grid.fitted(np.stack([grid.deposit(bundle) for bundle in rays]))
    errors = samples.std(axis=0, ddof=1) / 4.0
    assert (samples[:, 1:, 0] == samples[:, :1, 0]).all()
    assert errors[0, 0] < 1.5 * errors[:, 8:16].mean()
    assert abs(samples[:, 0, 0].mean() - 1.0 / np.pi) < 3.0 * errors[0, 0]
    deposited = sum(bundle.flux.sum() for bundle in rays) / 16.0
    assert (samples.mean(axis=0) * grid.solid_angles).sum() == pytest.approx(deposited, rel=1e-12)
    spike = samples.mean(axis=0)[None] * np.ones((16, 1, 1))
    spike[:, :, 0] += np.linspace(4.9, 5.1, 16)[:, None]
    kept = grid._pooled(spike[:, 0], (spike.mean(axis=0) * grid.solid_angles).sum(axis=0))
    moved = np.abs(kept.mean(axis=0) - spike[:, 0].mean(axis=0))
    assert moved.max() < 0.1 * spike[:, 0, 0].std(ddof=1) / 4.0, "what is known is kept"
