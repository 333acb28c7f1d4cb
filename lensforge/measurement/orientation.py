"""Which way round a photograph lies: corners that were found, not given, do not say whether the camera was turned."""

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.measurement.rectify import listed
from lensforge.measurement.similarity import similarity

_CLEARLY = 0.5  # another way round must have half of the NMSE at most to be called the right one

# How the corners are taken from those of an upright picture, and what that is called.
_WAYS = {
    "turned by 90 deg": (1, 2, 3, 0),
    "turned by 180 deg": (2, 3, 0, 1),
    "turned by 270 deg": (3, 0, 1, 2),
    "mirrored, left for right": (1, 0, 3, 2),
    "mirrored, top for bottom": (3, 2, 1, 0),
    "mirrored about a diagonal": (0, 3, 2, 1),
    "mirrored about the other diagonal": (2, 1, 0, 3),
}


def require_upright(
    measured: Float[np.ndarray, "p p"], simulated: Float[np.ndarray, "p p"], corners: Float[np.ndarray, "4 2"]
) -> None:
    """Raise :class:`InputError` where ``measured`` is far more like ``simulated`` if it is turned or mirrored.

    Both are normalised. Either the camera was turned, or stood behind the panel, or the lens itself is wrong: which of
    them, the picture does not say, so the user does, with corners in that order or as they are.
    """
    upright = similarity(measured, simulated).nmse
    other = {name: similarity(_turned(measured, way), simulated).nmse for name, way in _WAYS.items()}
    best = min(other, key=lambda name: other[name])
    if other[best] < _CLEARLY * upright:
        order = listed(corners[list(_WAYS[best])])
        raise InputError(
            f"--on: the light is more like the simulation if the picture is {best} (NMSE {other[best]:.2g}, upright "
            f"{upright:.2g}); if the camera saw it so, give --corners {order}; if not, --corners {listed(corners)}"
        )


def _turned(image: Float[np.ndarray, "p p"], way: tuple[int, ...]) -> Float[np.ndarray, "p p"]:
    """``image`` ([y, x], y upwards) as it would be by corners in the order ``way``."""
    # The corners of the image, in their order, as places in it: what stands at ``way[k]`` comes to place k.
    place = np.array([[1, 0], [1, 1], [0, 1], [0, 0]])  # (y, x) of top left, top right, bottom right, bottom left
    taken = place[list(way)]
    if taken[0, 0] == taken[1, 0]:  # along the top, x still runs
        return image[:: 1 if taken[0, 0] else -1, :: 1 if taken[1, 1] else -1]
    turned = image.T
    # Transposed, the new x runs along the old y.
    return turned[:: 1 if taken[0, 1] > taken[3, 1] else -1, :: 1 if taken[1, 0] > taken[0, 0] else -1]
