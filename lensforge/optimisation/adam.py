"""Adam (Kingma and Ba, ICLR 2015) on a few tensors: the bits of torch's, without what torch loads for it.

torch's own optimisers load the compiler of torch when the first one is made: over a second before a search begins.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor


class Adam:
    """Steps along the gradients of ``parameters``; ``moments``: mean and mean square of the gradient of each.

    A parameter without a gradient stays where it is.
    """

    def __init__(self, parameters: Sequence[Tensor], betas: tuple[float, float], least_gradient: float) -> None:
        self.parameters, self.steps = tuple(parameters), 0
        self._betas, self._least_gradient = betas, least_gradient
        self.moments = [(torch.zeros_like(each).detach(), torch.zeros_like(each).detach()) for each in self.parameters]

    def resume(self, steps: int, moments: Sequence[tuple[Float[Tensor, "..."], Float[Tensor, "..."]]]) -> None:
        """Go on with the ``moments`` after that many ``steps``."""
        self.steps, self.moments = steps, [(mean.clone(), square.clone()) for mean, square in moments]

    def zero_grad(self) -> None:
        """Forget the gradients of the step before."""
        for each in self.parameters:
            each.grad = None

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """Take a step of the learning rate ``rate``; means, which begin at 0, are divided by the weights in them."""
        self.steps += 1
        first, second = self._betas
        length, spread = rate / (1.0 - first**self.steps), (1.0 - second**self.steps) ** 0.5
        for each, (mean, square) in zip(self.parameters, self.moments, strict=True):
            if each.grad is None:
                continue
            mean.lerp_(each.grad, 1.0 - first)
            square.mul_(second).addcmul_(each.grad, each.grad, value=1.0 - second)
            each.addcdiv_(mean, (square.sqrt() / spread).add_(self._least_gradient), value=-length)
