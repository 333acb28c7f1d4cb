"""Luminance image as an emitting area: each pixel emits in proportion to its value."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.pictures.picture import Luminance
from lensforge.pictures.reading import read_light
from lensforge.sources.inverse_cdf import choose
from lensforge.surfaces.symmetry import largest_symmetry


@dataclass(frozen=True, eq=False)
class LuminanceImage:
    """Image centred on the axis, row 0 at its top (+y); each pixel uniform, ``values`` relative luminance."""

    values: Float[np.ndarray, "h w"]
    pitch_mm: float

    @classmethod
    def read(cls, path: Path, width_mm: float, luminance: Luminance = "as_stored") -> "LuminanceImage":
        """Read an image file, colours and values by ``luminance``. Raises :class:`InputError` if it cannot be used."""
        values = read_light(path, luminance, missing="give an image file")
        if not values.max() > 0.0:
            raise InputError(f"{path}: pixels must not be all dark")
        return cls(values / values.sum(), width_mm / values.shape[1])

    @property
    def symmetry(self) -> str:
        """Largest mirror group found by comparing the image with its mirror images, bit by bit."""
        return largest_symmetry(lambda mirror: np.array_equal(self._mirrored(mirror), self.values))

    def _mirrored(self, mirror: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "a b"]:
        upright = self.values[::-1].T  # first index x, second y
        turned = upright.T if mirror[0, 0] == 0.0 else upright
        signs = mirror.sum(axis=1)
        return turned[:: int(signs[0]), :: int(signs[1])].T[::-1]

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Choose the row by the first number, the column by the second given the row; uniform inside the pixel."""
        height, width = self.values.shape
        row, down = choose(np.cumsum(self.values.sum(axis=1)), points[:, 0])
        cumulative = np.cumsum(self.values)  # flat: a row's own distribution is a stretch of it
        first = np.where(row > 0, cumulative[row * width - 1], 0.0)
        last = cumulative[row * width + width - 1]
        flat, across = choose(cumulative, (first + points[:, 1] * (last - first)) / cumulative[-1])
        column = np.clip(flat - row * width, 0, width - 1)
        x = (column + across) - 0.5 * width
        y = 0.5 * height - (row + down)
        return self.pitch_mm * np.stack([x, y], axis=1)

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Share of the flux per mm^2 in the pixel in which each point (mm) lies."""
        height, width = self.values.shape
        column = np.clip(np.floor(points[:, 0] / self.pitch_mm + 0.5 * width), 0, width - 1).astype(int)
        row = np.clip(np.floor(0.5 * height - points[:, 1] / self.pitch_mm), 0, height - 1).astype(int)
        found: Float[np.ndarray, " n"] = self.values[row, column] / self.pitch_mm**2
        return found

    def corners(self) -> Float[np.ndarray, "4 2"]:
        """Rectangle (mm) around the pixels that emit."""
        height, width = self.values.shape
        rows, columns = np.nonzero(self.values)
        left, right = columns.min() - 0.5 * width, columns.max() + 1 - 0.5 * width
        top, bottom = 0.5 * height - rows.min(), 0.5 * height - rows.max() - 1
        return self.pitch_mm * np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
