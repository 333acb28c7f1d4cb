"""Scatter of several parts of one mould: within a cavity, between cavities, and of the face that they have in common.

With h_p the form deviation of part p, its scatter at a place is s^2 = sum (h_p - mean of its cavity)^2 / nu, with nu =
parts less cavities. Repeatability is the root of the mean of s^2 over the area. Its standard error is s/sqrt(2 nu f):
deviations are alike at neighbouring places, and f is how many places scatter independently, by the traces of the
covariance (unbiased: Bai & Saranadasa, Statistica Sinica 6, 311 (1996)). The common face is the mean of the cavities,
whatever their numbers of parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.results import Metric

_SEED = 0
_ALONE = 10.0  # times as far from every other part as these are from one another: no scatter of one process
_FEW = 5
# Where the best exchange of two labels is mere chance, it leaves more of the squares within cavities than
# exp(-10 x^-0.7), x the degrees of freedom times the modes, but in one series of fifty: measured for 8 to 24 parts and
# 1 to 10 modes.
_CHANCE = 10.0, -0.7
_LEAST_FREEDOM = 3  # of four parts in two cavities the modes are not known


@dataclass(frozen=True)
class PartScatter:
    """Form deviations (um) of the parts ``names`` at places of a face, which stand for ``shares`` of its area."""

    names: tuple[str, ...]
    cavities: tuple[str, ...]
    deviations: Float[np.ndarray, "p k"]
    shares: Float[np.ndarray, " k"]

    @cached_property
    def members(self) -> dict[str, list[int]]:
        """Numbers of the parts of each cavity."""
        members: dict[str, list[int]] = {}
        for part, cavity in enumerate(self.cavities):
            members.setdefault(cavity, []).append(part)
        return members

    @cached_property
    def groups(self) -> list[list[int]]:
        """Parts that scatter about one mean: those of each cavity, or all where a cavity has one part alone."""
        by_cavity = [*self.members.values()]
        return by_cavity if min(map(len, by_cavity)) > 1 else [[*range(len(self.cavities))]]

    @property
    def repeats(self) -> bool:
        """True where the scatter is that within cavities."""
        return len(self.groups) == len(self.members)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the scatter."""
        return len(self.cavities) - len(self.groups)

    @cached_property
    def weights(self) -> Float[np.ndarray, " p"]:
        """Weight of each part in the common face: cavities count alike."""
        return np.array([1.0 / (len(self.members) * len(self.members[cavity])) for cavity in self.cavities])

    @cached_property
    def means(self) -> Float[np.ndarray, "c k"]:
        """Mean deviation of each cavity."""
        return np.stack([self.deviations[members].mean(axis=0) for members in self.members.values()])

    @cached_property
    def common(self) -> Float[np.ndarray, " k"]:
        """Deviation that the cavities have in common."""
        return np.asarray(self.means.mean(axis=0))

    @cached_property
    def _residuals(self) -> Float[np.ndarray, "p k"]:
        left = self.deviations.copy()
        for group in self.groups:
            left[group] -= left[group].mean(axis=0)
        return left

    @cached_property
    def at_places(self) -> Float[np.ndarray, " k"]:
        """Standard deviation at each place."""
        return np.sqrt(np.sum(self._residuals**2, axis=0) / self.freedom)

    @cached_property
    def modes(self) -> float:
        """Number of places that scatter independently of one another, from 1."""
        freedom = self.freedom
        if freedom < 2:
            return 1.0
        covariance = (self._residuals * self.shares) @ self._residuals.T / freedom
        square = np.trace(covariance) ** 2
        of_squares = (np.sum(covariance**2) - square / freedom) * freedom**2 / ((freedom + 2.0) * (freedom - 1.0))
        return max(1.0, float(square / of_squares - 2.0 / freedom)) if of_squares > 0.0 else 1.0

    @property
    def repeatability(self) -> Metric:
        """Standard deviation (um) of a part's deviation from the mean of its cavity, rms over the area."""
        scatter = self.rms(self.at_places)
        error = scatter / np.sqrt(2.0 * self.freedom * self.modes)
        return Metric(value=scatter, unit="µm", standard_error=float(error))

    @property
    def between(self) -> Metric | None:
        """Standard deviation (um) of cavities about the common face, less what repeatability makes of it.

        None for one cavity, and where no scatter within cavities is known.
        """
        degrees = len(self.members) - 1
        if not (degrees and self.repeats):
            return None
        noise = self.repeatability.value**2 * np.mean([1.0 / len(group) for group in self.groups])
        square = float(self.shares @ np.sum((self.means - self.common) ** 2, axis=0)) / degrees - noise
        real = float(np.maximum(square, 0.0))
        of_cavities = 2.0 * noise * (noise + 2.0 * real) / degrees
        of_parts = 2.0 * noise**2 / self.freedom
        error = np.sqrt((of_cavities + of_parts) / self.modes)
        spread = np.sqrt(real)
        return Metric(value=float(spread), unit="µm", standard_error=float(error / (spread + np.sqrt(real + error))))

    @property
    def common_error_um(self) -> float:
        """Standard error of the common face, rms over the area: repeatability over the root of the number of parts."""
        return self.repeatability.value * float(np.sqrt(np.sum(self.weights**2)))

    def rms(self, values: Float[np.ndarray, " k"]) -> float:
        """Root mean square over the area."""
        return float(np.sqrt(self.shares @ values**2))

    def contrast(self) -> Float[np.ndarray, " p"]:
        """Factors of the parts' deviations from the common face that turn it into an error such as it may have.

        Each group's weighted factors sum to 0, so that what its parts have in common drops out, and their squares to
        those of the weights: the sum scatters as the mean does, whatever the shape of the scatter.
        """
        rng = np.random.default_rng(_SEED)
        factors = np.zeros(len(self.cavities))
        for group in self.groups:
            drawn = rng.normal(size=len(group))
            drawn -= drawn.mean()
            size = np.linalg.norm(self.weights[group]) / np.linalg.norm(drawn)
            factors[group] = size * drawn / self.weights[group]
        return factors

    @cached_property
    def _squares(self) -> Float[np.ndarray, "p p"]:
        """Mean squares of the differences of parts."""
        products = (self.deviations * self.shares) @ self.deviations.T
        squares = np.diag(products)
        return np.maximum(squares[:, None] + squares - 2.0 * products, 0.0)

    def require_alike(self) -> None:
        """Raise :class:`InputError` for a part that is like no other; of few parts none is told from the others."""
        if len(self.names) < _FEW:
            return
        distances = np.sqrt(self._squares + np.diag(np.full(len(self.names), np.inf)))
        part = int(distances.min(axis=1).argmax())
        others = np.delete(np.delete(distances, part, axis=0), part, axis=1)
        usual = float(np.median(others[np.isfinite(others)]))
        nearest = float(distances[part].min())
        if nearest > _ALONE * usual:
            raise InputError(
                f"{self.names[part]}: its form is {nearest:.3g} µm rms from that of the nearest part, where others "
                f"differ by {usual:.3g}: is it of another lens? Leave it out, or compare it alone"
            )

    def exchanged(self) -> tuple[str, ...]:
        """Names of two parts whose cavities seem to be mixed up: with them exchanged, cavities scatter far less."""
        labels = self.cavities
        pairs = [pair for pair in combinations(range(len(labels)), 2) if labels[pair[0]] != labels[pair[1]]]
        if not (pairs and self.repeats) or self.freedom < _LEAST_FREEDOM:
            return ()
        best = min((_swapped(labels, *pair) for pair in pairs), key=self._within)
        exchanged = replace(self, cavities=best)
        factor, power = _CHANCE
        by_chance = np.exp(-factor * (exchanged.freedom * exchanged.modes) ** power)
        if self._within(best) >= by_chance * self._within(labels):
            return ()
        return tuple(name for name, old, new in zip(self.names, labels, best, strict=True) if old != new)

    def _within(self, labels: Sequence[str]) -> float:
        """Sum of squares within cavities of these ``labels``, by the differences of their parts."""
        same = np.equal.outer(np.array(labels), np.array(labels))
        return float(np.sum(self._squares * same / (2.0 * same.sum(axis=0))))


def _swapped(labels: Sequence[str], first: int, second: int) -> tuple[str, ...]:
    swapped = [*labels]
    swapped[first] = labels[second]
    swapped[second] = labels[first]
    return tuple(swapped)
