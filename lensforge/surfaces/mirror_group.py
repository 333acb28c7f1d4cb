"""Mirror groups about the optical axis, by name: the 3x3 matrices under which a scene looks the same."""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError

REVOLUTION = "revolution"  # beside the groups: all turns about the axis
_SAME = 1e-9  # rad: arcs that touch
_SWAP_XY = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def _mirrors(x_signs: tuple[int, ...], y_signs: tuple[int, ...]) -> list[np.ndarray]:
    return [np.diag([float(sx), float(sy), 1.0]) for sx, sy in product(x_signs, y_signs)]


_RECTANGLE = _mirrors((1, -1), (1, -1))
_GROUPS: dict[str, list[np.ndarray]] = {
    "none": _mirrors((1,), (1,)),
    "mirror_x": _mirrors((1, -1), (1,)),
    "mirror_y": _mirrors((1,), (1, -1)),
    "diagonal": [np.eye(3), _SWAP_XY],
    "rectangle": _RECTANGLE,
    "square": _RECTANGLE + [mirror @ _SWAP_XY for mirror in _RECTANGLE],
}
NAMES = tuple(_GROUPS)
_GENERATORS = {
    "none": [],
    "mirror_x": _mirrors((-1,), (1,)),
    "mirror_y": _mirrors((1,), (-1,)),
    "diagonal": [_SWAP_XY],
    "rectangle": [*_mirrors((-1,), (1,)), *_mirrors((1,), (-1,))],
    "square": [*_mirrors((-1,), (1,)), *_mirrors((1,), (-1,)), _SWAP_XY],
}


def group(name: str) -> list[np.ndarray]:
    """Matrices of the group ``name``, the identity first: ``mirror_x`` maps x to -x, ``square`` is D4."""
    if name not in _GROUPS:
        raise InputError(f"symmetry = {name!r}: one of {', '.join(NAMES)}")
    return _GROUPS[name]


def generators(name: str) -> list[np.ndarray]:
    """Mirrors that generate the group ``name``: averaging over one after the other averages over the group."""
    return _GENERATORS[name]


def contains(larger: str, smaller: str) -> bool:
    """True where every mirror image of group ``smaller`` belongs to group ``larger``."""
    return all(any(np.array_equal(a, b) for b in group(larger)) for a in group(smaller))


def shared_symmetry(names: Sequence[str], allowed: Callable[[str], bool] = lambda _: True) -> str:
    """Largest ``allowed`` mirror group that is contained in every group of ``names``."""
    shared = (name for name in reversed(NAMES) if all(contains(larger, name) for larger in names))
    return next(name for name in shared if allowed(name))


def largest_symmetry(unchanged: Callable[[Float[np.ndarray, "3 3"]], bool]) -> str:
    """Largest mirror group all of whose mirrors satisfy ``unchanged``."""
    return next(name for name in reversed(NAMES) if all(unchanged(mirror) for mirror in group(name)))


def grid_images(block: Float[np.ndarray, "n n *c"], name: str) -> Float[np.ndarray, "n n *c"]:
    """Mean of the mirror images of a function on a square grid centred on the axis (first index x, second y)."""
    total = np.zeros_like(block)
    for image in group(name):
        turned = block.swapaxes(0, 1) if image[0, 0] == 0.0 else block
        signs = image[:2, :2].sum(axis=0)
        total += turned[:: int(signs[0]), :: int(signs[1])]
    return total / len(group(name))


def first_images(points: Float[np.ndarray, "k d"], name: str) -> Bool[np.ndarray, " k"]:
    """True for points that come first among their mirror images, by X, then by Y: one of each set is enough.

    The first two coordinates are those across the axis, of directions or on the chart.
    """
    first = np.ones(len(points), dtype=bool)
    tie = 1e-9
    for image in group(name):
        ahead = points[:, :2] - points[:, :2] @ image[:2, :2]
        first &= (ahead[:, 0] > tie) | ((ahead[:, 0] > -tie) & (ahead[:, 1] > -tie))
    return first


def shortest_arc(azimuths_rad: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Middle and half width (rad) of the shortest arc that holds all azimuths."""
    azimuths = np.sort(azimuths_rad)
    gaps = np.diff(np.append(azimuths, azimuths[0] + 2.0 * np.pi))
    widest = int(gaps.argmax())
    half = np.pi - 0.5 * float(gaps[widest])
    return float(azimuths[widest] + gaps[widest]) + half, half


def images_in_common(name: str, middle_rad: float, half_rad: float) -> float:
    """Largest share of an arc's images, under a group or ``REVOLUTION``, that contain a common azimuth."""
    if name == REVOLUTION:
        return min(1.0, half_rad / np.pi)
    middles = np.array([element[:2, :2] @ (np.cos(middle_rad), np.sin(middle_rad)) for element in group(name)])
    azimuths = np.arctan2(middles[:, 1], middles[:, 0])
    beyond = np.mod(azimuths - azimuths[:, None] + _SAME, 2.0 * np.pi)  # an arc's end lies in all that begin in it
    return float((beyond <= 2.0 * half_rad + 2.0 * _SAME).sum(axis=1).max() / len(middles))
