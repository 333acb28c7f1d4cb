"""Share of the made parts that hold all limits, as a smooth term of the merit, by the parts of a step.

Each reading is taken as normal over the parts: its mean e, the excess over its bound, and its spread s are those of the
parts that a step has traced. With u = e/w, w^2 = s^2 + n^2, n the noise of a step's reading, Phi(-u) of the parts hold
it, and the product P of all Phi(-u) hold all of them, as if these were independent; flux, which moves many alike, makes
P larger. What counts is v = -Phi^-1(P), a smooth maximum of the u: of one reading v = u, of several far beyond their
bounds v^2 is the sum of u^2, so that a slope is left where no part passes. The share is held where v <= -Phi^-1(share).
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from scipy.special import ndtri, ndtri_exp
from torch import Tensor

_ALL = -1e-12  # logarithm of a share: above, all parts hold all


def share_term(excess: Sequence[Float[Tensor, "p _"]], noise: Sequence[float], share: float) -> Float[Tensor, ""]:
    """The term for a ``share`` of the parts: x^2/(1+x), x the standard deviations by which it is missed.

    ``excess``: of ``p`` parts at the places of each limit, and its ``noise``, in the same unit.
    """
    missing = (deviations_beyond(excess, noise) + float(ndtri(share))).clamp(min=0.0)
    return missing**2 / (1.0 + missing)


def deviations_beyond(excess: Sequence[Float[Tensor, "p _"]], noise: Sequence[float]) -> Float[Tensor, ""]:
    """Standard deviations by which the parts lie beyond all their limits, below 0 where most of them hold all."""
    held_by_limit = [_held(excess_of_part, scatter) for excess_of_part, scatter in zip(excess, noise, strict=True)]
    held = torch.stack(held_by_limit).sum().clamp(max=_ALL)
    value = float(held.detach())
    beyond = -float(ndtri_exp(value))
    # the derivative of log Phi(-v) is -phi(v)/Phi(-v), by its logarithm: both may be too small for a number
    slope = torch.exp(held.new_tensor(-0.5 * beyond**2 - value)) / (2.0 * torch.pi) ** 0.5
    return beyond - (held - value) / slope


def _held(excess: Float[Tensor, "p k"], noise: float) -> Float[Tensor, ""]:
    """Logarithm of the share of the parts that hold one limit at all its places."""
    mean = excess.mean(dim=0)
    variance = (excess - mean).square().mean(dim=0)
    return torch.special.log_ndtr(-mean / torch.sqrt(variance + noise**2)).sum()
