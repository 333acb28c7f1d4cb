"""The last touch of a search: the nearest lens that is feasible.

A search of a few hundred noisy steps ends close to its limits, on either side of them: its multipliers still swing by
some micrometres. Where a limit is missed, the parameters are moved to the nearest that keep it, which the light does
not notice. A search that ended inside of its limits is left as it is, to the bit.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.parameters import Parametrisation

_ROUNDS, _ITERATIONS, _STRINGENCY = 12, 40, 1e6
_INSIDE = 0.7  # of the margin may be missing: the peak between the watched points is a little higher than they are
_PROGRESS = 0.8  # a round that leaves more of the shortfall than this leads nowhere


def nearest_feasible(
    parametrisation: Parametrisation,
    constraints: AugmentedLagrangian,
    weights: Float[Tensor, "m 2"],
    offsets: Float[Tensor, "2"],
) -> tuple[Float[Tensor, "m 2"], Float[Tensor, "2"]]:
    """``weights`` and ``offsets`` moved by as little as makes the watched points feasible, with some of the margin.

    Least squares in the relative parameters, by augmented Lagrangian. What is too far off for that is left as it is.
    """
    constraints = constraints.fresh(_STRINGENCY)
    moved = torch.zeros(len(weights) + 1, 2, dtype=torch.float64, requires_grad=True)

    def fields() -> Float[Tensor, "c k"]:
        return constraints.fields(*parametrisation.tables(weights + moved[1:], offsets + moved[0]))

    lacking = constraints.shortfall(fields())
    for _ in range(_ROUNDS):
        if lacking <= _INSIDE:
            break
        optimiser = torch.optim.LBFGS([moved], max_iter=_ITERATIONS, line_search_fn="strong_wolfe")

        def closure(optimiser: torch.optim.LBFGS = optimiser) -> Tensor:
            optimiser.zero_grad()
            loss = 0.5 * torch.sum(moved**2) + constraints.term(fields())
            loss.backward()
            return loss

        optimiser.step(closure)
        with torch.no_grad():
            now = fields()
        constraints.update(now)
        before, lacking = lacking, constraints.shortfall(now)
        if lacking > _PROGRESS * before:
            break
    if lacking > 1.0:
        return weights, offsets
    return weights + moved[1:].detach(), offsets + moved[0].detach()
