"""Light spread by rings behind faces of the part, as the definitions state it, without the design's code."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from lensforge.optics.media import RingScatter
from lensforge.proof.facet_tilt import Arrival, in_face

Vectors = Float[np.ndarray, "n 3"]
PerRay = Float[np.ndarray, " n"]


class Spreading(NamedTuple):
    """Rays at a face that scatters by rings.

    ``numbers``: two in [0, 1) of each. ``outward``: unit normals away from the origin. ``cosines``: of incidence.
    """

    model: RingScatter
    numbers: Float[np.ndarray, "n 2"]
    outward: Vectors
    cosines: PerRay

    @staticmethod
    def of(model: RingScatter, numbers: Float[np.ndarray, "n 2"], met: Arrival) -> "Spreading":
        """Rays at points of a lens or a body, in coordinates about its origin."""
        sign = np.where(np.sum(met.normals * met.points, axis=1) < 0.0, -1.0, 1.0)
        cosines = np.abs(np.sum(met.directions * met.normals, axis=1))
        return Spreading(model, numbers, met.normals * sign[:, None], cosines)


def spread(directions: Vectors, at: Spreading) -> Vectors:
    """Directions behind the face of light that a polished face would send along ``directions``."""
    n = at.outward * np.where(np.sum(directions * at.outward, axis=1) < 0.0, -1.0, 1.0)[:, None]
    along = directions - np.sum(directions * n, axis=1)[:, None] * n
    amounts, scatters = _amounts(at)
    ends = in_face(amounts * np.exp(2j * np.pi * at.numbers[:, 1]), at.outward)
    ends += along if at.model.follows else 0.0
    lengths = np.maximum(np.linalg.norm(ends, axis=1), 1e-300)
    ends *= (np.where(lengths > 1.0, 1.0 / lengths, lengths) / lengths)[:, None]
    spread_directions = ends + np.sqrt(np.maximum(1.0 - np.sum(ends**2, axis=1), 0.0))[:, None] * n
    return np.where(
        scatters[:, None], spread_directions / np.linalg.norm(spread_directions, axis=1)[:, None], directions
    )


def _amounts(at: Spreading) -> tuple[PerRay, Bool[np.ndarray, " n"]]:
    """Shift of each ray, interpolated between the rings drawn at both neighbouring incidences; whether it scatters."""
    squares = np.array(at.model.radii) ** 2
    nodes = np.array(at.model.cosines)
    columns = []
    for row in map(np.array, at.model.shares):
        share = at.numbers[:, 0] - (1.0 - row[-1])  # the first numbers are of light that is not scattered
        ring = np.clip(np.searchsorted(row, share), 1, len(row) - 1)
        width = row[ring] - row[ring - 1]
        inside = np.where(width > 0.0, (share - row[ring - 1]) / np.where(width > 0.0, width, 1.0), 0.0)
        squared = squares[ring - 1] + np.clip(inside, 0.0, 1.0) * (squares[ring] - squares[ring - 1])
        columns.append(np.where(share > 0.0, np.sqrt(squared), 0.0))
    hats = [np.interp(at.cosines, nodes, hat) for hat in np.eye(len(nodes))]
    amounts: PerRay = np.sum([hat * column for hat, column in zip(hats, columns, strict=True)], axis=0)
    return amounts, (amounts > 0.0) | (not at.model.follows and np.max(columns, axis=0) > 0.0)


def turned(fields: Complex[np.ndarray, "n 2 3"], before: Vectors, behind: Vectors) -> Complex[np.ndarray, "n 2 3"]:
    """Fields turned from one direction to another about their common normal (Rodrigues)."""
    axis = np.cross(before, behind)[:, None, :]
    cosine = np.sum(before * behind, axis=1)[:, None, None]
    return fields + np.cross(axis, fields) + np.cross(axis, np.cross(axis, fields)) / (1.0 + cosine)
