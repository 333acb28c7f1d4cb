"""Scatter of a face, ``[lens.outer.scatter]``: how it spreads the light that passes, or that its mirror reflects."""

from math import exp, radians, sqrt
from typing import Annotated, Literal

from pydantic import Field

from lensforge.optics.scattering import FacetTurn, GaussianFacets, gaussian
from lensforge.spec.spec_section import Section

_MOST_BACK = 0.5  # of the light along the normal: with more the face is no lens any more


class GaussianScatter(Section):
    """A frosted, etched or finely machined face: facets whose slopes are normally distributed."""

    kind: Literal["gaussian"] = "gaussian"
    sigma_deg: Annotated[float, Field(gt=0.0, le=45.0)]
    """Rms angle, along any line, by which the face spreads light that comes along its normal: of the transmitted light
    behind the face, of a mirror of the reflected light. An etched face has 1 to 10, a fine print 0.5 to 2.
    """

    def facets(self, turn: FacetTurn) -> GaussianFacets:
        """Facets whose rms slope turns light by that angle."""
        sigma = radians(self.sigma_deg)
        found = gaussian(sigma, turn) if sigma < turn.most_rad else None
        back = 1.0 if found is None else _turned_back(found.slope, turn)
        if found is None or back > _MOST_BACK:
            raise ValueError(
                f"sigma_deg = {self.sigma_deg:g}: {100.0 * back:.0f} % of the light along the normal would be turned "
                "back; take a smaller angle, on both faces if need be"
            )
        return found


def _turned_back(slope: float, turn: FacetTurn) -> float:
    """Share of Gaussian facets so steep that they reflect light along the normal totally."""
    if turn.ratio is None or turn.ratio <= 1.0:
        return 0.0
    steepest = 1.0 / sqrt(turn.ratio**2 - 1.0)
    return exp(-0.5 * (steepest / slope) ** 2)
