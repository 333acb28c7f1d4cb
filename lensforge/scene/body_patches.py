"""The surface of a body of a ``[[scene]]`` in patches, by which the light on it is measured.

Triangles are halved across their longest edges until they are small beside a patch. Pieces are then divided into
patches across whatever differs most: their places, in widths of a patch, or the directions that they face. No patch
holds two faces of a box, and none is much wider than it is to be.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.kernels.triangle_tree import TriangleTree, tree_of
from lensforge.scene.housing_mesh import contents_of, measured_mesh
from lensforge.spec.housing_sections import HousingSection

_OF_PATCH = 0.5  # longest edge of a piece over the width of a patch
_BEND = 0.6  # distance of the unit normals in a patch: 35 degrees
_MOST_PIECES = 2**19
_NO_AREA = 1e-12  # mm2


@dataclass(frozen=True, eq=False)
class BodyPatches:
    """Pieces of the surface: their ``corners`` (mm), the ``tree`` over them, and the patch of each by its number.

    ``piece_normals``: unit vectors out of the body. ``areas_mm2``, ``centres_mm``, ``normals``: of the patches, the
    last two as means over their area.
    """

    corners: Float[np.ndarray, "t 3 3"]
    tree: TriangleTree
    piece_normals: Float[np.ndarray, "t 3"]
    numbers: Int[np.ndarray, " t"]
    areas_mm2: Float[np.ndarray, " p"]
    centres_mm: Float[np.ndarray, "p 3"]
    normals: Float[np.ndarray, "p 3"]

    def __len__(self) -> int:
        return len(self.areas_mm2)

    @property
    def areas_m2(self) -> Float[np.ndarray, " p"]:
        """Area of each patch, so that flux (W) over it is irradiance (W/m²)."""
        return 1e-6 * self.areas_mm2

    @staticmethod
    def of(section: HousingSection) -> "BodyPatches":
        """The patches of a body that has ``patch_mm``, in its own coordinates.

        Raises :class:`InputError` for patches so small that they are too many.
        """
        return _patches(section, contents_of([section]))


@lru_cache(maxsize=8)
def _patches(section: HousingSection, _contents: tuple[str, ...]) -> BodyPatches:
    assert section.patch_mm is not None
    mesh = measured_mesh(section)
    corners = _halved(mesh.vertices[mesh.triangles], _OF_PATCH * section.patch_mm, section)
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(doubled, axis=1)
    corners = np.ascontiguousarray(corners[areas > _NO_AREA])
    doubled = doubled[areas > _NO_AREA]
    areas = areas[areas > _NO_AREA]
    normals = 0.5 * doubled / areas[:, None]
    centres = corners.mean(axis=1)
    numbers = _divided(np.concatenate([centres / section.patch_mm, normals / _BEND], axis=1))
    sums = [
        np.stack([np.bincount(numbers, areas * coordinate) for coordinate in vectors.T], axis=1)
        for vectors in (centres, normals)
    ]
    of_patches = np.bincount(numbers, areas)
    mean_normals = sums[1] / np.linalg.norm(sums[1], axis=1, keepdims=True)
    of_pieces = corners, tree_of(corners), normals, numbers
    return BodyPatches(*of_pieces, of_patches, sums[0] / of_patches[:, None], mean_normals)


def _halved(
    corners: Float[np.ndarray, "m 3 3"], longest_mm: float, section: HousingSection
) -> Float[np.ndarray, "t 3 3"]:
    """Triangles halved across their longest edges until none is longer than ``longest_mm``."""
    small = []
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        large = edges.max(axis=1) > longest_mm
        small.append(corners[~large])
        first = edges[large].argmax(axis=1)
        turned = np.take_along_axis(corners[large], (first[:, None] + np.arange(3))[..., None] % 3, axis=1)
        start, end, tip = np.moveaxis(turned, 1, 0)
        middle = 0.5 * (start + end)
        corners = np.concatenate([np.stack([start, middle, tip], axis=1), np.stack([middle, end, tip], axis=1)])
        if len(corners) + sum(map(len, small)) > _MOST_PIECES:
            raise InputError(
                f"scene: {section.name!r}: patch_mm = {section.patch_mm:g} cuts its surface into more than "
                f"{_MOST_PIECES} pieces; take a larger one"
            )
    return np.concatenate(small)


def _divided(places: Float[np.ndarray, "t k"]) -> Int[np.ndarray, " t"]:
    """Number of the group of each of ``places``: groups are halved across their longest side until that is 1."""
    numbers = np.zeros(len(places), dtype=np.int64)
    while True:
        order = np.argsort(numbers, kind="stable")
        starts = np.flatnonzero(np.diff(numbers[order], prepend=-1))
        low = np.minimum.reduceat(places[order], starts)
        high = np.maximum.reduceat(places[order], starts)
        longest = (high - low).argmax(axis=1)
        rows = np.arange(len(starts))
        splits = (high - low)[rows, longest] > 1.0
        if not splits.any():
            return numbers
        middle = 0.5 * (high + low)[rows, longest]
        upper = splits[numbers] & (places[np.arange(len(places)), longest[numbers]] > middle[numbers])
        _, numbers = np.unique(2 * numbers + upper, return_inverse=True)
