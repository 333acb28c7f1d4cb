"""Perturbed parts drawn from the tolerances by quasi-Monte-Carlo: numbers of every factor for every part.

Numbers that are spread or one-sided are those of one scrambled Sobol sequence (Owen 1997): their means converge faster
than those of random numbers. The hundred numbers of form errors are independent: in so many dimensions a sequence gains
nothing, and the attribution of the spread to its causes rests on their independence.

The distribution of a factor is in units of its amount: quantiles, and the polynomials that are orthonormal under it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr, ndtri

from lensforge import seeds
from lensforge.spec.tolerances_section import Factor

_PER_AMOUNT = 2.0  # standard deviations of a normal distribution: 95 % of the parts lie within the amount
_TAIL = float(ndtr(-_PER_AMOUNT))
_QUADRATURE = 200  # Gauss points over the width of a distribution: moments to degree 8 are exact
_WIDEST = 10.0  # standard deviations of a normal distribution: beyond, no part is ever drawn


def quantiles(factor: Factor, levels: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Values (in units of the amount) below which the shares ``levels``, between 0 and 1, of the parts lie.

    Of a one-sided factor the distribution of the absolute value.
    """
    if factor.kind == "field":
        return np.asarray(ndtri(levels))
    share = 0.5 + 0.5 * levels if factor.kind == "one-sided" else levels
    if factor.distribution == "uniform":
        return 2.0 * share - 1.0
    if factor.distribution == "truncated":
        share = _TAIL + (1.0 - 2.0 * _TAIL) * share
    return np.asarray(ndtri(share) / _PER_AMOUNT)


def orthonormal(factor: Factor, values: Float[np.ndarray, "*n"], degree: int) -> Float[np.ndarray, "*n d"]:
    """Polynomials of degree 1 to ``degree`` at ``values`` (in units of the amount), orthonormal over the parts."""
    nodes, weights = _quadrature(factor)
    _, triangle = np.linalg.qr(np.vander(nodes, degree + 1, increasing=True) * np.sqrt(weights)[:, None])
    powers = values[..., None] ** np.arange(degree + 1)
    polynomials: Float[np.ndarray, "*n d"] = np.linalg.solve(triangle.T, powers.reshape(-1, degree + 1).T).T
    return polynomials.reshape(*values.shape, degree + 1)[..., 1:]


def _quadrature(factor: Factor) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Values, and the shares of the parts for which each stands."""
    high = _WIDEST / _PER_AMOUNT if factor.distribution == "normal" else 1.0
    low = 0.0 if factor.kind == "one-sided" else -high
    points, weights = _gauss()
    values = low + 0.5 * (high - low) * (points + 1.0)
    normal = np.exp(-((_PER_AMOUNT * values) ** 2) / 2.0) / np.sqrt(2.0 * np.pi)
    density = np.ones(_QUADRATURE) if factor.distribution == "uniform" else normal
    shares = weights * density
    return values, shares / shares.sum()


@cache
def _gauss() -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Points and weights on -1 to 1: 20 ms, which a study would spend once for each of its factors."""
    return np.polynomial.legendre.leggauss(_QUADRATURE)


Deviations = Mapping[str, Float[np.ndarray, " k"]]  # by the name of the factor, in mm, rad or as shares


@dataclass(frozen=True, eq=False)
class Draws:
    """``numbers`` (n, k) of each factor, by its name, in units of its amount.

    ``lamps``: of each part, one after the other in a row; those of a factor in ``common`` are the same for all.
    """

    factors: tuple[Factor, ...]
    numbers: Mapping[str, Float[np.ndarray, "n _"]]
    lamps: int = 1
    common: frozenset[str] = frozenset()

    @staticmethod
    def of(
        factors: tuple[Factor, ...], parts: int, seed: int, lamps: int = 1, common: frozenset[str] = frozenset()
    ) -> "Draws":
        """The first ``parts`` of the endless row of parts of a yield study with this ``seed``."""
        return Draws.seeded(factors, parts, seeds.of_parts(seed), lamps, common)

    @staticmethod
    def seeded(
        factors: tuple[Factor, ...], parts: int, own_seed: int, lamps: int = 1, common: frozenset[str] = frozenset()
    ) -> "Draws":
        """The first ``parts`` of the row of parts with ``own_seed``, one of :mod:`lensforge.seeds`.

        Numbers of one lamp among several are random and independent: a sequence would make their mean too exact.
        """
        apart = {factor.name for factor in factors if lamps > 1 and factor.name not in common}
        spread = [factor for factor in factors if factor.kind != "field" and factor.name not in apart]
        points = _sobol(sum(factor.numbers for factor in spread), parts, own_seed)
        numbers = {}
        first = 0
        for factor in spread:
            numbers[factor.name] = quantiles(factor, points[:, first : first + factor.numbers])
            first += factor.numbers
        for factor in factors:
            if factor.kind != "field" and factor.name not in apart:
                continue
            # a seed of its own: another tolerance given or left out changes no other
            rng = np.random.default_rng([own_seed, *factor.name.encode()])
            size = parts, factor.numbers * (lamps if factor.name in apart else 1)
            field = factor.kind == "field"
            numbers[factor.name] = rng.standard_normal(size) if field else quantiles(factor, _inside(rng.random(size)))
        return Draws(factors, numbers, lamps, common)

    def of_lamps(self, name: str) -> int:
        """Number of lamps that have numbers of their own of a factor."""
        return 1 if name in self.common else self.lamps

    def of_lamp(self, name: str, lamp: int) -> Float[np.ndarray, "n k"]:
        """Numbers of one factor for one lamp of every part."""
        if self.of_lamps(name) == 1:
            return self.numbers[name]
        return self.numbers[name].reshape(self.parts, self.lamps, -1)[:, lamp]

    @property
    def parts(self) -> int:
        """Number of parts."""
        return len(next(iter(self.numbers.values())))

    def deviations(self, part: int, scales: Mapping[str, float] | None = None, lamp: int = 0) -> Deviations:
        """Deviations of one part, or of one of its lamps, those of some factors scaled."""
        scales = scales or {}
        return {
            factor.name: self.of_lamp(factor.name, lamp)[part]
            * (factor.amount * factor.to_internal * scales.get(factor.name, 1.0))
            for factor in self.factors
        }

    def mirrored(self) -> "Draws":
        """The parts whose deviations to both sides and form errors are the opposite."""
        signs = {factor.name: 1.0 if factor.kind == "one-sided" else -1.0 for factor in self.factors}
        return replace(self, numbers={name: signs[name] * number for name, number in self.numbers.items()})


def _sobol(dimensions: int, count: int, seed: int) -> Float[np.ndarray, "n d"]:
    """Scrambled points, never 0 or 1."""
    if dimensions == 0:
        return np.zeros((count, 0))
    from scipy.stats import qmc  # a second, which only studies of parts need

    sequence = qmc.Sobol(dimensions, scramble=True, bits=52, rng=np.random.default_rng(seed))
    points: Float[np.ndarray, "n d"] = sequence.random_base2(int(np.ceil(np.log2(max(count, 1)))))[:count]
    return _inside(points)


def _inside(levels: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
    return np.clip(levels, 2.0**-53, 1.0 - 2.0**-53)
