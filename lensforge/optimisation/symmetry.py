"""The mirror symmetry that source and target share: a lens may have it, and no larger one."""

import torch

from lensforge.errors import InputError
from lensforge.receivers.losses import mirror_mean
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.targets import target_irradiance
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.surfaces.symmetry import NAMES, contains


def settled_symmetry(spec: Spec, source: Source) -> Spec:
    """``spec`` with ``lens.symmetry`` as one of ``surfaces.symmetry``: for "auto" the largest that the scene has.

    Raises :class:`InputError` for a symmetry that source or target have not: it would be a lie.
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
