"""The ranges of the seeds are disjoint for every seed that a run may have, and sequences are those of scipy."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import qmc

from lensforge import seeds
from lensforge.light.exit_light import _ROUNDS, PARTS


def test_no_two_purposes_share_a_seed() -> None:
    most, steps = seeds.MOST, 10**6
    replicates, parts = 16, 2**12  # parts: 2^36 rays
    far = PARTS * _ROUNDS
    ranges = [
        (seeds.of_step(0, 0), seeds.of_step(most, steps)),
        (seeds.of_replicate(0, replicates, 0, parts, 0), seeds.of_replicate(most, replicates, 15, parts, parts - 1)),
        (
            seeds.of_replicate(seeds.of_choice(0), replicates, 0, parts, 0),
            seeds.of_replicate(seeds.of_choice(most), replicates, 15, parts, parts - 1),
        ),
        (
            seeds.of_replicate(seeds.of_kind(0, 1), replicates, 0, parts, 0),
            seeds.of_replicate(seeds.of_kind(seeds.of_choice(most), 6), replicates, 15, parts, parts - 1),
        ),
        (seeds.of_verification(0), seeds.of_verification(most)),
        (seeds.of_far_field(0, far, 0), seeds.of_far_field(most, far, far - 1)),
        (seeds.of_preset_error(0, 8, 0), seeds.of_preset_error(most, 8, 7)),
        (seeds.of_parts(0), seeds.of_parts(most)),
        (seeds.of_parts_of_steps(0, 0), seeds.of_parts_of_steps(most, steps)),
        (seeds.of_validation_parts(0), seeds.of_validation_parts(most)),
        (seeds.of_picture(0, 0, 0), seeds.of_picture(most, 31, 1023)),
    ]
    for (_, last), (first, _) in pairwise(sorted(ranges)):
        assert last < first


def test_every_step_of_every_seed_has_a_scramble_of_its_own() -> None:
    assert seeds.of_step(0, 10**6) < seeds.of_step(1, 0)
    assert seeds.of_step(seeds.MOST - 1, 10**6) < seeds.of_step(seeds.MOST, 0)
    assert seeds.of_replicate(3, 16, 15, 4, 3) + 1 == seeds.of_replicate(4, 16, 0, 4, 0)
    assert seeds.of_preset_error(3, 8, 7) + 1 == seeds.of_preset_error(4, 8, 0)
    assert seeds.of_picture(3, 31, 1023) + 1 == seeds.of_picture(4, 0, 0)


@pytest.mark.parametrize("dimensions", range(1, 7))
@pytest.mark.filterwarnings("ignore:The balance properties of Sobol")
def test_sequences_have_the_bits_of_scipy(dimensions: int) -> None:
    for count, seed in ((1, 0), (2, 1), (3, 1), (1000, 2**40), (2**15, 7)):
        points = qmc.Sobol(dimensions, rng=seed).random(count)
        np.testing.assert_array_equal(seeds.sobol(count, dimensions, seed), points)
        points = qmc.Sobol(dimensions, seed=seed).random(count)
        np.testing.assert_array_equal(seeds.sobol(count, dimensions, np.random.default_rng(seed)), points)
