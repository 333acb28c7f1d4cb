"""Seeds of all rays in the program, from disjoint ranges, and the sequences that they scramble.

No lens is evaluated by the rays that designed it. Seeds follow from that of a run, ``seed`` from 0 to ``MOST``; a range
is 2^40 wide, room for every seed of a run.
"""

from functools import cache, lru_cache

import numpy as np
from jaxtyping import Float, UInt32

MOST = 2**20  # the largest seed of a run
_STEPS = 1_000_003  # at most, of a search: every step has a seed of its own, resumed or not
_RANGE = 2**40
# 8 and 16 are those of benchmarks/convergence
_EVALUATION, _VERIFICATION, _FAR_FIELD, _PRESET, _VALIDATION, _OWN, _PARTS = (
    k * _RANGE for k in (1, 2, 4, 32, 64, 128, 256)
)
_PARTS_OF_STEPS, _VALIDATION_PARTS, OF_FILE, _FACETS, _PICTURES = (
    k * _RANGE for k in (512, 1024, 2048, 4096, 8192)
)  # OF_FILE: divides its rays
_SAMPLES_OF_PICTURE = 2**5
_MOST_PICTURES = 2**10
_BITS = 30  # of a number of a sequence
_FEW = 2**12  # points of a sequence that is kept: a search aims many small samples that begin at the same places
# For each dimension the coefficients of a primitive polynomial, and the first direction numbers: Joe, Kuo 2008.
_OF_RAYS = (1,), (3, 1), (7, 1, 3), (11, 1, 3, 1)
_DIMENSIONS = (*_OF_RAYS, (13, 1, 1, 1), (19, 1, 1, 3, 3), (25, 1, 3, 5, 13), (37, 1, 1, 5, 5, 17))


def of_step(seed: int, step: int) -> int:
    """Seed for the rays of a gradient step, counted over all levels of a search."""
    return seed * _STEPS + step


def of_validation(seed: int, sample: int) -> int:
    """Seed for one of the two samples by which a search judges its progress."""
    return _VALIDATION + 2 * seed + sample


def of_replicate(seed: int, replicates: int, replicate: int, parts: int, part: int) -> int:
    """Seed for one of the ``parts`` in which a replicate of an evaluation is traced."""
    return _EVALUATION + (seed * replicates + replicate) * parts + part


def of_kind(seed: int, number: int) -> int:
    """Seed of the evaluation of one of several kinds of lens, in the place of ``seed``; of the first that itself."""
    return seed + number * 2 * (MOST + 1)


def of_verification(seed: int) -> int:
    """Seed for the rays that verify the exported part, the stray-light pass included."""
    return _VERIFICATION + seed


def of_own_rays(seed: int) -> int:
    """Seed for the rays that verification draws by itself."""
    return _OWN + seed


def of_far_field(seed: int, parts: int, part: int) -> int:
    """Seed for one of the ``parts`` of a far-field intensity."""
    return _FAR_FIELD + seed * parts + part


def of_preset_error(seed: int, scrambles: int, scramble: int) -> int:
    """Seed for one of the scrambles by which an evaluation measures the error of its preset's tables."""
    return _PRESET + seed * scrambles + scramble


def of_parts(seed: int) -> int:
    """Seed for the parts that are drawn from the tolerances."""
    return _PARTS + seed


def of_parts_of_steps(seed: int, block: int) -> int:
    """Seed for one block of the parts that a robust search draws for its steps."""
    return _PARTS_OF_STEPS + seed * _STEPS + block


def of_validation_parts(seed: int) -> int:
    """Seed for the parts by which a robust search judges its progress."""
    return _VALIDATION_PARTS + seed


def of_facets(seed: int) -> int:
    """Seed of the facets that the rays of a sample meet."""
    return _FACETS + seed


def of_picture(seed: int, sample: int, picture: int) -> int:
    """Seed for one of the samples of one of the pictures by which errors of a made lens are inferred."""
    return _PICTURES + (seed * _SAMPLES_OF_PICTURE + sample) * _MOST_PICTURES + picture


def of_choice(seed: int) -> int:
    """Seed of the evaluation that chooses the best of several lenses: that of no run, which would judge them, too."""
    return MOST + 1 + seed


def sobol(count: int, dimensions: int, seed: int | np.random.Generator, first: int = 0) -> Float[np.ndarray, "n d"]:
    """Draw ``count`` points of the unit cube, scrambled by ``seed``; a power of two is best balanced.

    Of the ``dimensions`` those before number ``first`` are left out.

    Scrambled Sobol sequences (Owen 1998; Matousek's linear scramble) in at most eight ``dimensions``. They are those of
    ``scipy.stats.qmc.Sobol``, bit for bit, without the second that scipy.stats takes to load.
    """
    if count <= _FEW and isinstance(seed, int):
        return _few(count, dimensions, seed, first).copy()
    return _drawn(count, dimensions, seed, first)


@lru_cache(maxsize=64)
def _few(count: int, dimensions: int, seed: int, first: int) -> Float[np.ndarray, "n d"]:
    return _drawn(count, dimensions, seed, first)


def _drawn(count: int, dimensions: int, seed: int | np.random.Generator, first: int) -> Float[np.ndarray, "n d"]:
    rng = seed if isinstance(seed, np.random.Generator) else np.random.default_rng(seed).spawn(1)[0]
    places = 1 << np.arange(_BITS, dtype=np.uint32)
    shift = rng.integers(2, size=(dimensions, _BITS), dtype=np.uint32) @ places
    scramble = np.tril(rng.integers(2, size=(dimensions, _BITS, _BITS), dtype=np.uint32), -1) + np.eye(_BITS)
    digits = _direction_numbers()[:dimensions, None, :] >> np.arange(_BITS)[::-1, None] & 1  # the highest first
    steps = places[::-1] @ ((scramble @ digits).astype(np.uint32) & 1)
    points = np.empty((count, dimensions - first))
    drawn = np.empty(count, np.uint32)
    for dimension in range(first, dimensions):
        drawn[0] = shift[dimension]
        for bit in range((count - 1).bit_length()):  # in Gray's order: what there is, from its end, and one bit changed
            new = drawn[2**bit : 2 ** (bit + 1)]
            np.bitwise_xor(drawn[2**bit - len(new) : 2**bit][::-1], steps[dimension, bit], out=new)
        np.multiply(drawn, 0.5**_BITS, out=points[:, dimension - first])
    return points


@cache
def _direction_numbers() -> UInt32[np.ndarray, "d bits"]:
    """Direction numbers of every dimension by the recurrence of its polynomial (Bratley, Fox 1988)."""
    rows = []
    for polynomial, *numbers in _DIMENSIONS:
        degree = len(numbers)
        while len(numbers) < _BITS:
            taken = [k for k in range(1, degree + 1) if polynomial >> (degree - k) & 1]
            following = numbers[-degree] if degree else 1
            for k in taken:
                following ^= numbers[-k] << k
            numbers.append(following)
        rows.append([number << (_BITS - 1 - k) for k, number in enumerate(numbers)])
    return np.array(rows, np.uint32)
