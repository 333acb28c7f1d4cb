"""Acceptance of the light of rays that verification has drawn by itself: within noise of the design's."""

import math

from lensforge.criteria import Criterion, at_most
from lensforge.verification.allowances import FLUX_SHARE, NOISE_ALLOWANCE
from lensforge.verification.light_result import OwnRays

BLOCKS = 16  # of rays, whose pictures tell light from noise
LEAST_RAYS = 4 * BLOCKS  # for a picture of each block
_ERRORS = 4.0  # standard errors: of 100,000 right samplers 6 would be taken for a wrong one
# Of 27 means and products of a right sampler one is that many standard errors off in 1 of 975,000 verifications.
MOST_APART = 5.5
_WRONG = "the design's source is sampled wrongly, please report it"


def emission_criterion(apart: float) -> Criterion:
    """Acceptance criterion of the design's rays as they leave the source, against those that verification has drawn."""
    remedy = (
        f"the design's rays leave the source elsewhere, or in other directions, than its description says: {_WRONG}"
    )
    return at_most("own_rays_emission", apart, MOST_APART, "standard errors", remedy)


def own_rays_criteria(own: OwnRays) -> list[Criterion]:
    """Acceptance criteria of the light of these rays: within noise of the design's."""
    error = math.hypot(own.efficiency.standard_error or 0.0, own.efficiency_design.standard_error or 0.0)
    remedy = (
        "rays drawn from the source's description make another light than the design's: evaluate and verify again; if "
        f"it stays where all other criteria are met, {_WRONG}"
    )
    apart = abs(own.efficiency.value - own.efficiency_design.value)
    found = [at_most("own_rays_efficiency", apart, FLUX_SHARE + _ERRORS * error, "of the flux", remedy)]
    seen = own.nmse_less_noise
    if seen is not None:
        found.append(
            at_most("own_rays_nmse", seen.value, NOISE_ALLOWANCE + _ERRORS * (seen.standard_error or 0.0), "", remedy)
        )
    return found
