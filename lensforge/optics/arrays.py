"""Arrays of NumPy, or of torch for gradients of a search and for other devices: one law for both.

Laws of light are written once, in functions that both modules have. What differs between them is here.
"""

import sys
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int, Shaped

Array: TypeAlias = Any
"""A NumPy array or a torch tensor, with jaxtyping's shapes: ``Float[Array, "n 3"]``."""


def module_of(array: Array) -> Any:
    """The module of ``array``: NumPy, or torch, which only a search loads."""
    return np if isinstance(array, np.ndarray) else sys.modules["torch"]


def like(array: Array, values: Array) -> Array:
    """``values`` as an array of the module, precision and device of ``array``."""
    if isinstance(array, np.ndarray):
        return np.asarray(values, dtype=array.dtype)
    return sys.modules["torch"].as_tensor(values, dtype=array.dtype, device=array.device)


def as_numpy(array: Array) -> np.ndarray:
    """``array`` in NumPy; no gradient passes."""
    return array if isinstance(array, np.ndarray) else np.asarray(array.detach().cpu())


def replaced(array: Array, rows: Int[Array, " k"], values: Shaped[Array, "k *shape"]) -> Array:
    """A copy of ``array`` with ``values`` in some of its rows; differentiable in both."""
    if not isinstance(array, np.ndarray):
        return array.index_put((sys.modules["torch"].as_tensor(rows, device=array.device),), values)
    copy = array.copy()
    copy[rows] = values
    return copy


def lengths(vectors: Float[Array, "n k"]) -> Float[Array, " n"]:
    """Length of each vector."""
    return module_of(vectors).sqrt((vectors * vectors).sum(1))


def rows_of(flags: Array) -> Array:
    """Indices of the rows in which ``flags`` are true."""
    return module_of(flags).where(flags)[0]


def whole(array: Array) -> Array:
    """``array`` without its fractions, as indices; no gradient passes."""
    return array.astype(np.int64) if isinstance(array, np.ndarray) else array.detach().long()
