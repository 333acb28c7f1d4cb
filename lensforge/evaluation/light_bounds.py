"""Bounds on the light of a spec that sets no limits, by which the verdict and the yield judge it.

``benchmarks/verdicts.py`` calibrates both (docs/results.md): the worst of the shipped specs has an NMSE of 0.08 as a
draft, and puts 0.8 of what two faces transmit into its target; useless lenses (a 6 mm source in an 8 mm lens, a word
finer than the image of its source, a lens of hardly more than cavity and wall, a target beyond the étendue of its
source) have an NMSE from 0.2 to 0.75, and put 0.07 to 0.66 of it there.
"""

from lensforge.evaluation.receiver_light import ReceiverLight

LARGEST_NMSE = 0.10
LEAST_SHARE = 0.7  # of what is possible, and of what two faces transmit at normal incidence, must lie in the target


def possible_share(receiver: ReceiverLight, transmittance: float) -> tuple[float, str]:
    """Most of the flux that can lie in the target on ``receiver``, and by what; ``transmittance``: of both faces."""
    asked, possible = transmittance * receiver.wanted_in_target, receiver.possible.share_in_target
    if asked <= possible:
        return asked, "two faces transmit into the pattern"
    return possible, f"is possible (by {receiver.possible.law})"
