"""Terms of the merit function of the limits on the light: one-sided, 0 where the picture keeps them with a margin."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.optimisation.image_terms import Image, Images, not_dark, smoothed
from lensforge.receivers.posed import PosedReceiver
from lensforge.spec import Spec
from lensforge.targets.limits import LightLimit, light_limits

# The search aims this far inside each bound, relative to it: the picture of a step has noise, and pixels of its own.
_MARGIN = 0.03
# Factors of the mean excess over the places of a limit: of a few places each counts, of many all together.
_OF_EACH, _AT_MOST = 30.0, 300.0


@dataclass(frozen=True, eq=False)
class LimitTerm:
    """One limit on the picture of a receiver: its readings as a torch matrix."""

    limit: LightLimit
    readings: Tensor
    factor: float

    @staticmethod
    def of(limit: LightLimit) -> "LimitTerm":
        """The term of ``limit``."""
        coo = limit.readings.tocoo()
        places = torch.from_numpy(np.stack([coo.row, coo.col]).astype(np.int64))
        matrix = torch.sparse_coo_tensor(places, torch.from_numpy(coo.data), coo.shape, check_invariants=False)
        return LimitTerm(limit, matrix.coalesce(), min(_OF_EACH * coo.shape[0], _AT_MOST))

    def loss(self, images: Images) -> Float[Tensor, ""]:
        """Mean of e^2/(1+e) over the places, e what is missing to the bound or above it, relative to the bound."""
        picture = smoothed(images[self.limit.receiver])
        light = torch.mv(self.readings, picture.reshape(-1))
        excess = self._excess(light, picture).clamp(min=0.0)
        return self.factor * torch.mean(excess**2 / (1.0 + excess))

    def _excess(self, light: Float[Tensor, " k"], picture: Image) -> Float[Tensor, " k"]:
        """Excess at each place; of an even zone at its dark places, of a beam angle at those on the wrong side."""
        limit = self.limit
        match limit.quantity:
            case "light" | "share":
                scale: Tensor | float = 1.0
            case "relative":
                scale = not_dark(picture.detach().max() * limit.light_per_flux)
            case "min_over_mean":
                scale = not_dark(light.mean())
            case "min_over_max":
                scale = not_dark(light.detach().max())
            case "beam_angle":
                return self._beside_the_beam(light)
        return self._beyond(light / (scale * limit.bound))

    def _beyond(self, relative: Float[Tensor, " k"]) -> Float[Tensor, " k"]:
        """Excess of light relative to its bound over that with its margin."""
        return 1.0 + _MARGIN - relative if self.limit.sense == ">=" else relative - (1.0 - _MARGIN)

    def _beside_the_beam(self, light: Float[Tensor, " k"]) -> Float[Tensor, " k"]:
        """Light within a least angle must be above the level, light outside of a largest one below it."""
        limit = self.limit
        assert limit.angles_deg is not None
        off = torch.from_numpy(np.abs(limit.angles_deg)) - 0.5 * limit.bound
        beyond = self._beyond(light / (limit.level * not_dark(light.detach().max())))
        return torch.where(off < 0.0 if limit.sense == ">=" else off > 0.0, beyond, 0.0)


def limit_terms(
    spec: Spec, receivers: tuple[PosedReceiver, ...], lumens_per_watt: float | None, flux_w: float
) -> tuple[LimitTerm, ...]:
    """Terms of all limits of ``spec``. Raises :class:`InputError` for limits that no light keeps."""
    return tuple(LimitTerm.of(limit) for limit in light_limits(spec, receivers, lumens_per_watt, flux_w))
