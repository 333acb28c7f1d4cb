"""Ends of light of no use, by cause, as limits on losses read them in evaluation, search and yield."""

from typing import get_args

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.fate import Fate
from lensforge.optics.arrays import Array, like, module_of
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays
from lensforge.spec.light_limits import LossCause

LOSSES: tuple[LossCause, ...] = get_args(LossCause)  # behind them, each face before the exit
_FATES: dict[LossCause, tuple[Fate, ...]] = {
    "opening": (Fate.BACKWARD, Fate.OUTSIDE_CAVITY),
    "base": (Fate.BASE,),
    "flange": (Fate.FLANGE,),
    "total_reflection": (Fate.TOTAL_REFLECTION,),
    "trapped": (Fate.EVENT_LIMIT,),
}
NUMBER_BY_FATE = np.full(len(Fate), -1)  # a search that gave up, and faces that intersect, have criteria of their own
NUMBER_BY_FATE[Fate.LEFT_LENS] = LOSSES.index("beside")
for _cause, _fates in _FATES.items():
    NUMBER_BY_FATE[list(_fates)] = LOSSES.index(_cause)


def loss_names(chain: Chain | None) -> tuple[str, ...]:
    """The causes of a loss, in their order: those of every lens, then each face of ``chain`` before the exit."""
    return (*LOSSES, *(() if chain is None else chain.names[:-1]))


def last_face(met: Int[Array, "n e"]) -> Int[Array, " n"]:
    """Number of the face that each ray met last; -1 where it met none."""
    count = (met >= 0).sum(1)
    return met[module_of(met).arange(len(met)), count - 1]


def cause_numbers(rays: ExitRays, chain: Chain | None) -> Int[Array, " n"]:
    """Number of the cause by which each ray ends, of :func:`loss_names`; -1 for none.

    A ray that leaves by the exit has the number of light beside the window, wherever it lands.
    """
    module = module_of(rays.flux)
    fates = module.asarray(rays.fates, dtype=module.int64)
    numbers: Int[Array, " n"] = module.take(like(fates, NUMBER_BY_FATE), fates)
    if chain is None or rays.met is None:
        return numbers
    last = last_face(rays.met)
    leaks = rays.left_lens & (last < len(chain.names) - 1)
    return module.where(leaks, len(LOSSES) + last, numbers)


def with_beside(
    by_cause: Float[Array, "*r c"], in_window: Float[Array, "*r"], blocked: Float[Array, "*r"]
) -> Float[Array, "*r c"]:
    """Flux by cause, whose first column is of all light that left by the exit, with the light beside the window there.

    That is all light that left, by whichever face, and is neither ``in_window`` nor ``blocked`` by bodies of the scene,
    which is a cause of its own.
    """
    module = module_of(by_cause)
    left = by_cause[..., 0] + by_cause[..., len(LOSSES) :].sum(-1)
    columns = [left - in_window - blocked, *module.moveaxis(by_cause, -1, 0)[1:]]
    columns[LOSSES.index("housing")] = blocked
    return module.stack(columns, -1)
