"""Mirror symmetry that source, fixed surface, receivers and targets share: a lens may have it, and no larger one."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import InputError
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.surfaces.mirror_group import NAMES, contains, generators

_SAME = 1e-9  # of a mirrored frame, and of a centre relative to its distance

ChartMirrors = tuple[tuple[tuple[int, int], tuple[int, int]], ...]  # signed permutations of the chart's coordinates


def settled_symmetry(spec: Spec, source: Source) -> Spec:
    """``spec`` with ``lens.symmetry`` as one of ``surfaces.symmetry``: for "auto" the largest that the scene has.

    Raises :class:`InputError` for a symmetry that source, target or a fixed surface lacks.
    """
    name = spec.lens.symmetry
    if name == "auto":
        found = next(
            each
            for each in reversed(NAMES)
            if contains(source.symmetry, each) and _in_fixed(spec, each) is None and _in_targets(spec, each)
        )
        return spec.model_copy(update={"lens": spec.lens.model_copy(update={"symmetry": found})})
    if not contains(source.symmetry, name):
        raise InputError(f"lens.symmetry = {name!r}: the source has only {source.symmetry!r}; use that, or 'auto'")
    lacking = _in_fixed(spec, name)
    if lacking is not None:
        raise InputError(f"lens.symmetry = {name!r}: {lacking} is not symmetric in this way; use 'auto'")
    if not _in_targets(spec, name):
        raise InputError(f"lens.symmetry = {name!r}: the target is not symmetric in this way; use 'auto'")
    return spec


def _in_fixed(spec: Spec, name: str) -> str | None:
    """Field of a fixed surface that lacks the symmetry; None where both have it."""
    fields = ("lens.fixed_inner", "lens.fixed_outer")
    faces = zip(fields, spec.lens.fixed, strict=True)
    return next((field for field, face in faces if face is not None and not contains(face.symmetry, name)), None)


def _in_targets(spec: Spec, name: str) -> bool:
    """True where the targets have the symmetry, and the places of each limit."""
    receivers = receivers_of(spec, spec.optimise.pixels)
    every = [chart_mirrors(receiver, name) for receiver in receivers]
    wanted = [target_light(section.targets, each) for section, each in zip(spec.all_receivers, receivers, strict=True)]
    pictures = list(enumerate(wanted))
    for limit in light_limits(spec, receivers, 1.0, 1.0):  # whatever the lumens: only the places count
        places = np.asarray(limit.readings.sum(axis=0)).reshape(receivers[limit.receiver].grid.shape)
        pictures.append((limit.receiver, places))
    return all(_has_mirrors(picture, every[index]) for index, picture in pictures)


def _has_mirrors(picture: Float[np.ndarray, "h w"], mirrors: ChartMirrors | None) -> bool:
    if mirrors is None:
        return False
    own = torch.from_numpy(picture)
    return torch.allclose(mirrored_light(own, mirrors), own, rtol=1e-6, atol=1e-6 * float(own.max()))


def chart_mirrors(receiver: PosedReceiver, name: str) -> ChartMirrors | None:
    """Action of a mirror group's generators on a receiver's chart; None where its mirror image is another receiver."""
    found, axes, centre = [], receiver.pose.axes, np.array(receiver.pose.centre_mm)
    for mirror in generators(name):
        moved = np.linalg.norm(mirror @ centre - centre)
        action = axes @ mirror @ axes.T
        signs = np.round(action[:2, :2])
        swaps = signs[0, 0] == 0.0
        whole = np.block([[signs, np.zeros((2, 1))], [np.zeros((1, 2)), 1.0]])
        grid = receiver.grid
        square = grid.rows == grid.columns and grid.width == grid.height and receiver.kind != "cylinder"
        kept = np.allclose(action, whole, rtol=0.0, atol=_SAME) and moved <= _SAME * np.linalg.norm(centre)
        if not kept or (swaps and not square):
            return None
        (a, b), (c, d) = signs.astype(int).tolist()
        found.append(((a, b), (c, d)))
    return tuple(found)


def mirrored_light(image: Float[Tensor, "h w"], mirrors: ChartMirrors) -> Float[Tensor, "h w"]:
    """Mean over the mirror images of the light on a receiver: that of a scene with the symmetry, with more rays."""
    for (a, b), (c, d) in mirrors:
        turned = [axis for axis, sign in ((1, a + b), (0, c + d)) if sign < 0]
        image = 0.5 * (image + (image if a else image.T).flip(turned))
    return image


def mirror_mean(grid: Float[Tensor, "p p"], symmetry: str) -> Float[Tensor, "p p"]:
    """Mean over the mirror images of values on a square grid about the axis, first index x, second y."""
    if symmetry in ("mirror_x", "rectangle", "square"):
        grid = 0.5 * (grid + grid.flip(0))
    if symmetry in ("mirror_y", "rectangle", "square"):
        grid = 0.5 * (grid + grid.flip(1))
    if symmetry == "square":
        grid = 0.5 * (grid + grid.T)
    return grid
