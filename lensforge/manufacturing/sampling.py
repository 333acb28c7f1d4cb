"""One face sampled for the shop's questions: points, normals, curvatures, and the area that each point stands for.

The samples are the nodes of a square chart grid inside the rim, so that a value per sample is also a map, and the
nodes just outside, pulled onto the rim: extremes like to live there, and their cells close the area sum.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.manufacturing.curvature import PrincipalCurvatures, principal_curvatures
from lensforge.manufacturing.face import OpticalFace


@dataclass(frozen=True)
class ChartGrid:
    """``nodes`` x ``nodes`` chart points over [-1, 1], first index X; the first samples of a face are those inside."""

    axis: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, "n n"]

    @property
    def step(self) -> float:
        """Node spacing in chart units."""
        return float(self.axis[1] - self.axis[0])

    def to_map(self, values: Float[np.ndarray, "k *c"]) -> Float[np.ndarray, "n n *c"]:
        """Values per sample as a map, NaN outside the rim; samples on the rim itself fall between the nodes."""
        picture = np.full((*self.inside.shape, *values.shape[1:]), np.nan)
        picture[self.inside] = values[: np.count_nonzero(self.inside)]
        return picture


@dataclass(frozen=True)
class FaceSamples:
    """A face at ``k`` chart points: mm, unit air-side normals, 1/mm, and mm^2 per sample."""

    face: OpticalFace
    grid: ChartGrid
    chart: Float[np.ndarray, "k 2"]
    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    areas: Float[np.ndarray, " k"]
    curvatures: PrincipalCurvatures

    @property
    def outward(self) -> Float[np.ndarray, "k 3"]:
        """Unit normals pointing away from the origin, whichever side the air is on."""
        return float(self.face.air) * self.normals

    def fraction(self, where: Bool[np.ndarray, " k"]) -> float:
        """The part of the face's area for which ``where`` holds."""
        return float(self.areas[where].sum() / self.areas.sum())


def sample_face(face: OpticalFace, nodes: int) -> FaceSamples:
    """Sample ``face`` on a grid of ``nodes`` x ``nodes`` chart points."""
    grid, points, cells = _disc(nodes)
    jet = face.jet(points)
    normals = face.air_normal(jet)
    return FaceSamples(
        face=face,
        grid=grid,
        chart=points,
        points=jet.point,
        normals=normals,
        areas=cells * jet.area_element,
        curvatures=principal_curvatures(jet, normals),
    )


def _disc(nodes: int) -> tuple[ChartGrid, Float[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
    """Grid, sample points of the unit disc, and the chart area of each: the part of its cell inside the disc."""
    axis = np.linspace(-1.0, 1.0, nodes)
    step = axis[1] - axis[0]
    padded = np.concatenate([[-1.0 - step], axis, [1.0 + step]])
    square = np.stack(np.meshgrid(padded, padded, indexing="ij"), axis=-1)
    distance = np.linalg.norm(square, axis=-1)
    # A straight rim cuts a square cell: its share is close to linear over the cell's width across the rim.
    width = step * np.abs(square).sum(axis=-1) / np.maximum(distance, step)
    share = np.clip(0.5 + (1.0 - distance) / np.maximum(width, step), 0.0, 1.0)
    inside = distance <= 1.0 + 1e-12
    rim = ~inside & (share > 0.0)
    pulled = square[rim] / distance[rim][:, None]
    points = np.concatenate([square[inside], pulled])
    cells = np.concatenate([share[inside], share[rim]]) * step**2
    return ChartGrid(axis, inside[1:-1, 1:-1]), points, cells
