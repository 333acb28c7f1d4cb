"""How far an irradiance is from the wanted one: differentiable, on torch images [row y, column x]."""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor


def nmse_loss(flux: Float[Tensor, "p p"], wanted: Float[Tensor, "p p"]) -> Float[Tensor, ""]:
    """Normalised mean-square error, Eq. (7); ``wanted`` carries the flux that one hopes for, so a dim image errs."""
    return torch.sum((flux - wanted) ** 2) / torch.sum(wanted**2)


def uniformity_loss(flux: Float[Tensor, "p p"], mask: Bool[Tensor, "p p"]) -> Float[Tensor, ""]:
    """Relative variance inside ``mask``, Eq. (8), with the mean taken over the mask's pixels."""
    inside = flux[mask]
    return torch.mean((inside / _scale(inside) - 1.0) ** 2)


def _scale(inside: Float[Tensor, " k"]) -> Float[Tensor, ""]:
    """The mean; 1 where all is dark, so that a mask without a ray is bad, not undefined."""
    mean = inside.mean()
    return torch.where(mean > 0.0, mean, 1.0)


def shortfall_loss(flux: Float[Tensor, "p p"], mask: Bool[Tensor, "p p"], margin: float) -> Float[Tensor, ""]:
    """Mean square of what pixels inside ``mask`` lack to ``1 - margin`` of the mask's mean.

    Uniformity is least over mean: a variance hardly sees the one corner that decides it. The image is smoothed by
    the 3 x 3 Gaussian of the evaluation first, so that ray noise does not count as a shortfall.
    """
    taps = torch.tensor([math.exp(-0.5), 1.0, math.exp(-0.5)], dtype=flux.dtype)
    kernel = torch.outer(taps, taps) / taps.sum() ** 2
    padded = torch.nn.functional.pad(flux[None, None], (1, 1, 1, 1), mode="replicate")
    inside = torch.nn.functional.conv2d(padded, kernel[None, None])[0, 0][mask]
    return torch.mean(torch.clamp(1.0 - margin - inside / _scale(inside), min=0.0) ** 2)


def mirror_mean(image: Float[Tensor, "p p"], symmetry: str) -> Float[Tensor, "p p"]:
    """Mean over the mirror images of a scene that has this symmetry: the same light from up to 8 times the rays."""
    if symmetry in ("mirror_x", "rectangle", "square"):
        image = 0.5 * (image + image.flip(1))
    if symmetry in ("mirror_y", "rectangle", "square"):
        image = 0.5 * (image + image.flip(0))
    if symmetry == "square":
        image = 0.5 * (image + image.T)
    return image
