"""Sums of the rays of one gradient step on one receiver: its picture, and what the picture misses; of lamps together.

By the compiled kernels as one torch operation, or in torch where another device traces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from lensforge.kernels.image_sums import (
    SAFE_SIN2,
    SIN2_SCALE,
    ByRaysAtReceiver,
    RaysAtReceiver,
    collect,
    collect_adjoint,
)
from lensforge.kernels.parallel import CHUNKS, in_chunks, in_pieces
from lensforge.scene.lamp_pictures import LampPictures
from lensforge.scene.light_ends import LOSSES, with_beside
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver import Landings

_WORTH_SHARING = 2**16  # rays: a millisecond of work


@dataclass(frozen=True)
class Collected:
    """Sums over rays on one receiver, all in W and differentiable in the landings and the exit sines.

    ``image``: flux per pixel by the four-pixel splat. ``in_window``: flux in the receiver's window.
    ``outside_receiver``: flux off the receiver, each ray times ``e^2/(1+e^2)``, e its distance from it in half
    widths and heights, infinite for one that lands nowhere. ``total_reflection``: flux whose squared exit sine exceeds
    0.97, likewise bounded: its gradient brings totally reflected rays back and keeps others from it. The last two count
    the flux with which a ray left the source, as a constant. ``colours``: as ``image``, of the flux times two weights
    of each ray; ``losses``: the flux by cause, as ``scene.light_ends`` orders them; both None if they do not count.
    """

    image: Float[Tensor, "h w"]
    in_window: Float[Tensor, ""]
    outside_receiver: Float[Tensor, ""]
    total_reflection: Float[Tensor, ""]
    colours: Float[Tensor, "2 h w"] | None = None
    losses: Float[Tensor, " c"] | None = None

    def with_losses(
        self, flux: Float[Tensor, " n"], numbers: Int[Tensor, " n"], causes: int, blocked: Float[Tensor, ""]
    ) -> "Collected":
        """The same, and the ``flux`` by the ``numbers`` of so many ``causes`` by which rays end.

        ``blocked``: flux that bodies of the scene block.
        Light has no gradient at the window's edge, and an infinite one where a face begins to reflect totally: light
        beside the window has that of the flux off the receiver, light through faces that of total reflection.
        """
        ends = numbers >= 0
        by_cause = flux.new_zeros(causes).index_add(0, numbers[ends], flux.detach()[ends])
        towards = torch.zeros_like(by_cause)
        towards[LOSSES.index("total_reflection")] = 1.0
        towards[len(LOSSES) :] = 1.0
        gradients = towards * (self.total_reflection - self.total_reflection.detach())
        losses = with_beside(by_cause, self.in_window.detach(), blocked.detach()) + gradients
        losses = losses + _only(LOSSES.index("housing"), blocked - blocked.detach(), causes)
        return replace(self, losses=_more_beside(losses, self.outside_receiver - self.outside_receiver.detach()))


def _only(number: int, flux: Float[Tensor, ""], causes: int) -> Float[Tensor, " c"]:
    """``flux`` as that of the cause of this number, of so many."""
    return torch.nn.functional.one_hot(torch.tensor(number), causes).to(flux) * flux


def _more_beside(losses: Float[Tensor, " c"], flux: Float[Tensor, ""]) -> Float[Tensor, " c"]:
    return torch.cat([(losses[0] + flux)[None], losses[1:]])


class _Collect(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        hits: Tensor,
        flux: Tensor,
        sin2_exit: Tensor,
        landed: Tensor,
        emitted: Tensor,
        grid: PixelGrid,
        window: Window,
    ) -> Any:
        images = np.zeros((CHUNKS, *grid.shape))
        sums = np.zeros((CHUNKS, 3))
        rays = RaysAtReceiver(*(tensor.detach().numpy() for tensor in (hits, flux, sin2_exit, landed, emitted)))
        places = grid.size, window.packed()

        def work(chunk: int, part: slice) -> None:
            collect(rays.part(part), *places, images[chunk], sums[chunk])

        in_chunks(work, len(emitted), worth=_WORTH_SHARING)
        ctx.rays = rays
        ctx.places = places
        return torch.from_numpy(images.sum(axis=0)), torch.from_numpy(sums.sum(axis=0))

    @staticmethod
    def backward(ctx: Any, by_image: Tensor, by_sums: Tensor) -> Any:
        by_rays = ByRaysAtReceiver.empty(len(ctx.rays.flux))
        pixels = by_image.contiguous().numpy()
        sums = by_sums.contiguous().numpy()

        def work(part: slice) -> None:
            collect_adjoint(ctx.rays.part(part), *ctx.places, pixels, sums, by_rays.part(part))

        in_pieces(work, len(by_rays.by_flux), worth=_WORTH_SHARING)
        return *map(torch.from_numpy, by_rays), None, None, None, None


def collected(
    landings: Landings,
    sin2_exit: Float[Tensor, " n"],
    emitted: Float[Tensor, " n"],
    grid: PixelGrid,
    window: Window,
    weights: Float[Tensor, "2 n"] | None = None,
) -> Collected:
    """Collect rays that left the source with ``emitted`` (W); ``weights``: of the colours. Float64, CPU."""

    def summed(flux: Tensor) -> tuple[Tensor, Tensor]:
        return _Collect.apply(  # type: ignore[no-untyped-call]  # as torch has it
            landings.hits, flux, sin2_exit, landings.landed, emitted, grid, window
        )

    image, sums = summed(landings.flux)
    colours = None if weights is None else torch.stack([summed(landings.flux * weight)[0] for weight in weights])
    return Collected(image, sums[0], sums[1], sums[2], colours)


def collected_on_device(
    landings: Landings,
    sin2_exit: Float[Tensor, " n"],
    emitted: Float[Tensor, " n"],
    grid: PixelGrid,
    window: Window,
    weights: Float[Tensor, "2 n"] | None = None,
) -> Collected:
    """Collect rays that left the source with ``emitted`` (W); all tensors on one device, as :func:`collected`."""
    landed = landings.landed
    hits = landings.hits[landed]
    flux = landings.flux[landed]
    size = hits.new_tensor(grid.size)
    (half_width, half_height, square) = window.packed()
    distance = hits.abs()
    in_window = (distance[:, 0] <= half_width) & (distance[:, 1] <= half_height) & (hits.square().sum(dim=1) <= square)
    outside = (distance / (0.5 * size) - 1.0).clamp(min=0.0).square().sum(dim=1)
    over = (sin2_exit - SAFE_SIN2).clamp(min=0.0) / SIN2_SCALE
    return Collected(
        image=_splat(hits, flux, grid),
        in_window=flux[in_window].sum(),
        outside_receiver=(emitted[landed] * _bounded(outside)).sum() + emitted[~landed].sum(),
        total_reflection=(emitted * _bounded(over)).sum(),
        colours=None
        if weights is None
        else torch.stack([_splat(hits, flux * weight[landed], grid) for weight in weights]),
    )


def _bounded(excess: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Bounded excess ``e/(1+e)``: a few outliers cannot outweigh the image."""
    return excess / (1.0 + excess)


def _splat(hits: Float[Tensor, "n 2"], flux: Float[Tensor, " n"], grid: PixelGrid) -> Float[Tensor, "h w"]:
    """Share each ray's flux among the four nearest pixels; a frame for the shares outside is cut off."""
    size = hits.new_tensor(grid.size)
    pixels = hits.new_tensor([float(grid.columns), float(grid.rows)])
    position = (hits / size + 0.5) * pixels - 0.5
    near = ((position > -1.0) & (position < pixels)).all(dim=1)
    position = position[near]
    flux = flux[near]
    first = torch.floor(position.detach())
    (right, up) = (position - first).T
    (column, row) = (first.to(torch.int64) + 1).T
    shares = torch.stack(((1.0 - up) * (1.0 - right), (1.0 - up) * right, up * (1.0 - right), up * right))
    framed = grid.columns + 2
    corner = torch.tensor([0, 1, framed, framed + 1], device=flux.device)[:, None]
    # adds in a fixed order, on a GPU too
    image = flux.new_zeros((grid.rows + 2) * framed)
    image = image.index_put((row * framed + column + corner,), flux * shares, accumulate=True)
    return image.reshape(grid.rows + 2, framed)[1:-1, 1:-1]


class _Added(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, lamps: LampPictures, *pictures: Tensor) -> Tensor:
        ctx.lamps = lamps
        return torch.from_numpy(lamps.added([picture.detach().numpy() for picture in pictures]))

    @staticmethod
    def backward(ctx: Any, by_image: Tensor) -> Any:
        return None, *map(torch.from_numpy, ctx.lamps.spread(by_image.numpy()))


def mean_of_lamps(lamps: LampPictures, by_raster: Sequence[Collected]) -> Collected:
    """Mean light of a lamp on their receiver, from that of one on each raster.

    Where a raster is wider than the receiver, light is in the window by its pixels, and outside off the raster.
    """
    if lamps.is_single:
        return by_raster[0]
    image = _added(lamps, [collected.image for collected in by_raster])
    colours = None
    if by_raster[0].colours is not None:
        pairs = zip(*(collected.colours for collected in by_raster if collected.colours is not None), strict=True)
        colours = torch.stack([_added(lamps, pictures) for pictures in pairs])
    in_window = image.sum() if lamps.widened else lamps.mean([collected.in_window for collected in by_raster])
    outside = lamps.mean([collected.outside_receiver for collected in by_raster])
    losses = None
    if by_raster[0].losses is not None:
        in_windows = lamps.mean([collected.in_window for collected in by_raster])
        losses = _more_beside(lamps.mean([collected.losses for collected in by_raster]), in_windows - in_window)
    return Collected(image, in_window, outside, by_raster[0].total_reflection, colours, losses)


def _added(lamps: LampPictures, pictures: Sequence[Tensor]) -> Tensor:
    return _Added.apply(lamps, *pictures)  # type: ignore[no-untyped-call]  # as torch has it
