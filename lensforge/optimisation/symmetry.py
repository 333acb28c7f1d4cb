"""Mirror symmetry that source and target share: a lens may have it, and no larger one."""

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import InputError
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.targets import target_irradiance
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.surfaces.symmetry import NAMES, contains


def settled_symmetry(spec: Spec, source: Source) -> Spec:
    """``spec`` with ``lens.symmetry`` as one of ``surfaces.symmetry``: for "auto" the largest that the scene has.

    Raises :class:`InputError` for a symmetry that source or target lacks.
    """
    name = spec.lens.symmetry
    if name == "auto":
        found = next(each for each in reversed(NAMES) if contains(source.symmetry, each) and _in_target(spec, each))
        return spec.model_copy(update={"lens": spec.lens.model_copy(update={"symmetry": found})})
    if not contains(source.symmetry, name):
        raise InputError(f"lens.symmetry = {name!r}: the source has only {source.symmetry!r}; use that, or 'auto'")
    if not _in_target(spec, name):
        raise InputError(f"lens.symmetry = {name!r}: the target is not symmetric in this way; use 'auto'")
    return spec


def _in_target(spec: Spec, name: str) -> bool:
    wanted = torch.from_numpy(target_irradiance(spec.target, PixelGrid(spec.target.receiver_mm, spec.optimise.pixels)))
    return torch.allclose(mirror_mean(wanted, name), wanted, rtol=1e-6, atol=1e-6 * float(wanted.max()))


def mirror_mean(grid: Float[Tensor, "p p"], symmetry: str, x_axis: int = 1) -> Float[Tensor, "p p"]:
    """Mean over the mirror images of values on a square grid about the axis, x along ``x_axis``.

    For an image (row y, column x) of a scene with this symmetry it is the same light with up to 8 times the rays.
    """
    if symmetry in ("mirror_x", "rectangle", "square"):
        grid = 0.5 * (grid + grid.flip(x_axis))
    if symmetry in ("mirror_y", "rectangle", "square"):
        grid = 0.5 * (grid + grid.flip(1 - x_axis))
    if symmetry == "square":
        grid = 0.5 * (grid + grid.T)
    return grid
