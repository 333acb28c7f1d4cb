"""Limits on light that is linear in the intensities of a lamp, as standards ask for it: at places, by equal lamps."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from lensforge.results import Sense
from lensforge.spec.quantities import Quantity

if TYPE_CHECKING:
    from scipy import sparse


@dataclass(frozen=True, eq=False)
class CandelaSum:
    """Light at ``k`` places, linear in the intensities (cd) in ``n`` directions.

    ``weights``: matrix [k, n]. ``azimuth_deg``: of the directions in a lamp, from its street towards the direction of
    travel of a driver who has the lamp at the right; ``gamma_deg``: from its axis.
    """

    azimuth_deg: Float[np.ndarray, " n"]
    gamma_deg: Float[np.ndarray, " n"]
    weights: "sparse.csr_array"

    def of(self, candela: Float[np.ndarray, "p n"]) -> Float[np.ndarray, "p k"]:
        """The light by each sample of intensities in these directions."""
        return (self.weights @ candela.T).T

    def directions(self, street_deg: float) -> Float[np.ndarray, "n 3"]:
        """Unit vectors in the frame of a lens whose street is at the azimuth ``street_deg``."""
        turn = np.radians(self.azimuth_deg + street_deg)
        gamma = np.radians(self.gamma_deg)
        aside = np.sin(gamma)
        return np.stack([aside * np.cos(turn), aside * np.sin(turn), np.cos(gamma)], axis=1)

    def times(self, factor: float) -> "CandelaSum":
        """The light of lamps so many times as bright."""
        return replace(self, weights=factor * self.weights)

    def mean(self) -> "CandelaSum":
        """The mean of all places, as one place."""
        from scipy import sparse

        return replace(self, weights=sparse.csr_array(self.weights.mean(axis=0).reshape(1, -1)))

    def places(self, chosen: slice) -> "CandelaSum":
        """Some of the places."""
        return replace(self, weights=self.weights[chosen])

    @staticmethod
    def joined(parts: "tuple[CandelaSum, ...]") -> "CandelaSum":
        """The places of all ``parts``, in their order."""
        from scipy import sparse

        return CandelaSum(
            np.concatenate([part.azimuth_deg for part in parts]),
            np.concatenate([part.gamma_deg for part in parts]),
            sparse.csr_array(sparse.block_diag([part.weights for part in parts])),
        )


# Intensities (cd) of a lamp: first those of its file, then those with one of the samples of rays left out each.
Candela = Callable[[CandelaSum], Float[np.ndarray, "p n"]]


class LumensBound(ABC):
    """Most light that the lumens of lamps leave, wherever they go, by a ``law`` in words; ``remedies``: what raises it.

    It counts where étendue leaves more.
    """

    law: ClassVar[str]
    remedies: ClassVar[str]

    @abstractmethod
    def per_lumen(self, units: Float[np.ndarray, "n 3"], street_deg: float) -> Float[np.ndarray, " n"]:
        """Light by one lumen of each lamp along each of ``units``, in the frame of a lens."""


@dataclass(frozen=True, eq=False)
class IntensityLimit:
    """The ``quantity`` of ``light`` is to be ``sense`` ``bound`` in ``unit``; ``most``: what physics allows."""

    name: str
    quantity: Quantity
    sense: Sense
    bound: float
    unit: str
    light: CandelaSum
    most: LumensBound | None = None
