"""Numbers that rays draw for faces that scatter, from the bits with which they begin: the same in every trace.

A hash of its start and direction is the key of a ray. Each face has numbers of its own, and others each time that a ray
meets it again: were these the same, light that scatters twice would not spread as twice.
"""

import numpy as np
from jaxtyping import Float, UInt64

from lensforge.kernels.compiled import inline, kernel

_GOLDEN, _FIRST, _SECOND = (
    np.uint64(constant) for constant in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
)
_27, _30, _31, _11 = (np.uint64(count) for count in (27, 30, 31, 11))
_ULP = 2.0**-53
_FACES = 256  # more than those that scatter


@inline
def mixed(key):
    """SplitMix64 hash of a key (Steele, Lea and Flood, 2014)."""
    key = (key ^ (key >> _30)) * _FIRST
    key = (key ^ (key >> _27)) * _SECOND
    return key ^ (key >> _31)


@inline
def drawn(key, face, times):
    """Two numbers in [0, 1) of the ray with this key, for a face after ``times`` earlier hits."""
    stream = mixed((key + _GOLDEN) ^ np.uint64(_FACES * times + face))
    return float(mixed(stream + _GOLDEN) >> _11) * _ULP, float(mixed(stream + _GOLDEN + _GOLDEN) >> _11) * _ULP


@kernel
def fill_keys(origins, directions, keys):
    """Fill the keys of rays, from the bits of each."""
    for k in range(len(keys)):
        key = np.uint64(0)
        for axis in range(3):
            key = mixed((key + _GOLDEN) ^ origins[k, axis])
            key = mixed((key + _GOLDEN) ^ directions[k, axis])
        keys[k] = key


@kernel
def draw_all(keys, face, times, numbers):
    """Fill ``numbers`` (n, 2) by :func:`drawn` for one face after ``times`` earlier hits."""
    for k in range(len(keys)):
        numbers[k, 0], numbers[k, 1] = drawn(keys[k], face, times[k])


def keys_of(origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
    """Keys of rays that begin at these points along these directions."""
    starts, ways = (np.ascontiguousarray(vectors).view(np.uint64) for vectors in (origins, directions))
    keys = np.empty(len(starts), np.uint64)
    fill_keys(starts, ways, keys)
    return keys
