"""Landings as plain arrays, to be compared ray by ray."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.receivers.receiver import Landings


@dataclass(frozen=True)
class Hits:
    """Hits (mm) and flux (W) of rays on a receiver; 0 for rays that did not land."""

    hits: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]

    @staticmethod
    def of(landings: Landings) -> "Hits":
        """The arrays of ``landings``, in float64 and without a gradient."""
        return Hits(*(tensor.detach().cpu().double().numpy() for tensor in (landings.hits, landings.flux)))

    @property
    def arrived(self) -> Bool[np.ndarray, " n"]:
        """Rays that brought flux."""
        return self.flux > 0.0

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> "Hits":
        """Those of some of the rays."""
        return Hits(self.hits[rows], self.flux[rows])
