"""Pictures of the light of a made lens with the LED moved, and their slopes by its unknowns.

A picture moves with its rays: with the picture M, the mean displacement D of the rays that land in a pixel by a unit of
an unknown, and their mean change T of flux, its slope is -div(M D) + T. Differences of binned pictures would be
noise of the rays for the most part: a ray changes its pixel, or does not. Pictures of the model and of the camera have
the same blur.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, laplace, map_coordinates

from lensforge import seeds
from lensforge.addons.measure.form_unknowns import FormUnknowns
from lensforge.light.simulation import TracedLens
from lensforge.made.part_light import rays_behind
from lensforge.optics.pose import Vector
from lensforge.scene.pixel_grid import PixelGrid, bin_flux
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.sources.ray_bundle import RayBundle, Source

Numbers = Float[np.ndarray, " k"]
Pictures = Float[np.ndarray, "p h w"]
Slopes = Float[np.ndarray, "k p h w"]

BLUR_PX = 1.5  # standard deviation of the blur, in pixels of the model
_STEP = 1e-2  # of the prior standard deviation of an unknown: the displacement of a ray is linear to 1e-4 over it


def blurred(picture: Float[np.ndarray, "*p h w"]) -> Float[np.ndarray, "*p h w"]:
    """``picture`` with the blur of all pictures; dark beyond its border."""
    axes = (picture.ndim - 2, picture.ndim - 1)
    return np.asarray(gaussian_filter(picture, BLUR_PX, mode="constant", axes=axes))


@dataclass(frozen=True, eq=False)
class PictureModel:
    """Light of a lens with ``unknowns`` on ``receiver``, its LED at each of the ``poses`` (mm from its place).

    Each picture is traced by several ``samples`` of ``rays`` rays, whose seeds follow from ``seed`` and their numbers.
    """

    traced: TracedLens
    receiver: PosedReceiver
    source: Source
    unknowns: FormUnknowns
    poses: Sequence[Vector]
    samples: range
    rays: int
    seed: int

    def by(self, samples: range) -> "PictureModel":
        """The model by other rays."""
        return replace(self, samples=samples)

    @property
    def grid(self) -> PixelGrid:
        """Pixels of the pictures."""
        return self.receiver.grid

    def pictures(self, numbers: Numbers) -> Float[np.ndarray, "r p h w"]:
        """Blurred pictures by each sample; the light of the LED is 1 on the mean over the pixels."""
        out = np.empty((len(self.samples), len(self.poses), *self.grid.shape))
        for sample, place in np.ndindex(*out.shape[:2]):
            landed = self._landed(numbers, place, self._rays(sample, place))
            out[sample, place] = self._scale * bin_flux(landed.hits, landed.flux, self.grid)
        return blurred(out)

    def slopes(self, numbers: Numbers) -> Float[np.ndarray, "r k p h w"]:
        """Derivatives of the blurred pictures by each number, for each sample."""
        shape = (len(self.samples), len(self.unknowns), len(self.poses), *self.grid.shape)
        out = np.empty(shape, dtype=np.float32)
        for sample, place in np.ndindex(shape[0], shape[2]):
            rays = self._rays(sample, place)
            before = self._landed(numbers, place, rays)
            for number, step in enumerate(_STEP * np.eye(len(numbers))):
                after = self._landed(numbers + step, place, rays)
                out[sample, number, place] = self._scale * _slope(before, after, self.grid) / _STEP
        return out

    def _rays(self, sample: int, place: int) -> RayBundle:
        return self.source.sample(self.rays, seeds.of_picture(self.seed, self.samples[sample], place))

    def _landed(self, numbers: Numbers, place: int, rays: RayBundle) -> Landings:
        part = self.unknowns.part(numbers, self.poses[place])
        return self.receiver.land(rays_behind(self.traced, part, rays))

    @property
    def _scale(self) -> float:
        return self.grid.columns * self.grid.rows / self.source.flux_w


def _slope(before: Landings, after: Landings, grid: PixelGrid) -> Float[np.ndarray, "h w"]:
    """Change of the blurred picture, to first order in the displacements of the rays that land both times."""
    both = before.arrived & after.arrived
    moved = np.where(both[:, None], after.hits - before.hits, 0.0) / np.array(grid.pixel)
    flux = np.where(both, before.flux, 0.0)
    gained = np.where(both, after.flux - before.flux, 0.0)
    across, along, more = (_signed(before.hits, amounts, grid) for amounts in (*(flux * moved.T), gained))
    by_x = gaussian_filter(across, BLUR_PX, order=(0, 1), mode="constant")
    by_y = gaussian_filter(along, BLUR_PX, order=(1, 0), mode="constant")
    return np.asarray(blurred(more) - by_x - by_y)


def _signed(
    hits: Float[np.ndarray, "n 2"], amounts: Float[np.ndarray, " n"], grid: PixelGrid
) -> Float[np.ndarray, "h w"]:
    """Sum of ``amounts`` of either sign in each pixel; bins take flux alone, which is nowhere below 0."""
    return bin_flux(hits, np.maximum(amounts, 0.0), grid) - bin_flux(hits, np.maximum(-amounts, 0.0), grid)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera on its stand: brightness of each of ``count`` pictures, corners of the target and blur in all of them.

    Its numbers are in units of their prior standard deviations: the logarithm of each brightness, column and row of
    each corner, and the variance of a blur beyond that of all pictures. ``corner_px``: prior standard deviation of a
    corner, in pixels of the model.
    """

    grid: PixelGrid
    count: int
    corner_px: float

    BRIGHTNESS = 0.05  # standard deviation of a logarithm, beyond the mean of the picture
    BLUR_PX2 = 0.3  # standard deviation of a variance, in pixels^2 of the model
    CORNERS = 8  # columns and rows

    def __len__(self) -> int:
        return self.count + self.CORNERS + 1

    def seen(self, pictures: Pictures, numbers: Numbers) -> Pictures:
        """``pictures`` of the model as the camera has them, rectified by the corners that were given."""
        columns, rows = np.meshgrid(np.arange(self.grid.columns), np.arange(self.grid.rows))
        brightness, corners, blur = np.split(numbers, [self.count, self.count + self.CORNERS])
        x, y = np.tensordot(self.corner_px * corners, self._moves, 1)
        bright = np.exp(self.BRIGHTNESS * brightness)
        widened = [picture + 0.5 * self.BLUR_PX2 * blur[0] * laplace(picture) for picture in pictures]
        moved = [map_coordinates(picture, [rows + y, columns + x], order=3, mode="nearest") for picture in widened]
        return np.asarray(bright[:, None, None] * np.stack(moved))

    def slopes(self, pictures: Pictures) -> Slopes:
        """Derivatives of ``pictures``, as the camera sees them, by each of its numbers."""
        out = np.zeros((len(self), *pictures.shape))
        for number in range(self.count):
            out[number, number] = self.BRIGHTNESS * pictures[number]
        step = 0.05
        for number in range(self.count, len(self)):
            change = step * np.eye(len(self))[number]
            out[number] = (self.seen(pictures, change) - self.seen(pictures, -change)) / (2.0 * step)
        return out

    @property
    def _moves(self) -> Float[np.ndarray, "8 2 h w"]:
        """Displacement of the picture for one of a corner by a pixel, first along its columns, then along its rows."""
        x, y = np.meshgrid(self.grid.x() / self.grid.width, self.grid.y() / self.grid.height)
        corners = 0.5 * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
        at_corners = np.concatenate([_homography_moves(*corners.T)[:, axis] for axis in (0, 1)], axis=1)
        by_corner = np.linalg.inv(at_corners).reshape(2, 4, 8).transpose(1, 0, 2).reshape(8, 8)
        return np.tensordot(by_corner, _homography_moves(x, y), 1)


def _homography_moves(x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "8 2 *n"]:
    """Displacements of points by each of the eight numbers of a homography near the identity."""
    none = np.zeros_like(x)
    plain = np.stack([none + 1.0, x, y])
    by_x = np.stack([plain, np.stack([none] * 3)], axis=1)
    by_y = np.stack([np.stack([none] * 3), plain], axis=1)
    tilted = np.stack([np.stack([x * x, x * y]), np.stack([x * y, y * y])])
    return np.concatenate([by_x, by_y, tilted])
