"""Interpolation between the nodes of a table, as its header names it, at the places where it errs most.

The polynomial through the nearest nodes (Lagrange): 2 along each axis, or 4 with the cell in their middle. It needs no
end conditions, so that every program gets the same values. It errs most in the middle of a cell or of a cell's side.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float

Interpolation = Literal["bicubic", "linear"]

WORDS: dict[Interpolation, str] = {
    "bicubic": "bicubic, the polynomial through the 4 x 4 nearest nodes",
    "linear": "bilinear, between the 4 nearest nodes",
}
ORDER: dict[Interpolation, int] = {"bicubic": 4, "linear": 2}  # the error falls with this power of the spacing
# Nodes needed beyond a cell on each side.
BEYOND: dict[Interpolation, int] = {"bicubic": 1, "linear": 0}
_MIDDLE: dict[Interpolation, tuple[float, ...]] = {
    "bicubic": (-1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0),
    "linear": (0.5, 0.5),
}


def halfway(values: Float[np.ndarray, "n m c"], axis: int, scheme: Interpolation) -> Float[np.ndarray, "k l c"]:
    """Values halfway between the nodes along ``axis``; NaN where a node that this needs is NaN.

    The first is ``BEYOND`` nodes and a half from the first node.
    """
    weights = _MIDDLE[scheme]
    count = values.shape[axis] - len(weights) + 1
    return sum((weight * np.take(values, range(k, k + count), axis) for k, weight in enumerate(weights)), np.zeros(()))
