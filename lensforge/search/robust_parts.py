"""Parts that a robust search traces in place of the lens as designed: pairs with opposite deviations, new in each step.

Opposite parts are traced with the same rays: half of the difference of their images, which is the spread of the parts
to first order, then has hardly any ray noise.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from lensforge import seeds
from lensforge.scene.made_part import ErrorField, FaceNodes, MadePart, PartMaker, waviness
from lensforge.scene.perturbations import Draws
from lensforge.search.parameters import Parametrisation
from lensforge.spec import Spec
from lensforge.spec.tolerances_section import Factor, factors_of
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface

Pair = tuple[MadePart, MadePart]

_BLOCK = 2**10  # pairs of one Sobol sequence: consecutive steps share one, so that their parts complement each other
_HEMISPHERE = SrbfBasis((4,), 1.75)
_NO_DETAIL = TableGrid(4)  # so coarse that it resolves no waviness


@dataclass(eq=False)
class SearchParts:
    """Pairs of parts for the lenses of one search that have tables on one grid.

    Form errors are those of the surfaces from which the search starts: they depend on the shape by the cosine between
    radius and normal alone. All waviness counts as roughness, by its slope: as tables it would take seconds to prepare,
    and it spreads the light of a part by far less than the shifts do.
    """

    maker: PartMaker
    factors: tuple[Factor, ...]
    _drawn: dict[int, tuple[Draws, Draws]] = field(default_factory=dict)

    @staticmethod
    def of(spec: Spec, parametrisation: Parametrisation) -> "SearchParts":
        """Prepare the parts. Raises :class:`InputError` where all tolerances are 0."""
        factors, section = factors_of(spec.tolerances), spec.tolerances
        first, second = (
            _hemisphere(radius) if fixed is None else fixed
            for radius, fixed in zip(spec.lens.start_mm, parametrisation.fixed, strict=True)
        )
        smooth = tuple(factor for factor in factors if "waviness" not in factor.name)
        maker = PartMaker.of(spec, (first, second), parametrisation.grid, smooth)
        errors, side = dict(maker.errors), parametrisation.grid.side
        for factor in factors:
            if factor not in smooth:
                surface = first if factor.name.startswith("inner") else second
                band = section.waviness_shortest_mm, section.waviness_longest_mm, section.waviness_exponent
                slope = waviness(FaceNodes.of(_NO_DETAIL, surface), *band, 0).slope
                errors[factor.name] = ErrorField(np.zeros((0, side, side)), slope)
        return SearchParts(replace(maker, errors=errors), factors)

    def of_step(self, seed: int, step: int) -> Pair:
        """The pair of one gradient step, counted over all levels of a search."""
        block, number = divmod(step, _BLOCK)
        own_seed = seeds.of_parts_of_steps(seed, block)
        if own_seed not in self._drawn:
            draws = Draws.seeded(self.factors, _BLOCK, own_seed)
            self._drawn = {own_seed: (draws, draws.mirrored())}
        return self._made(self._drawn[own_seed], number)

    def of_validation(self, seed: int, count: int) -> tuple[Pair, ...]:
        """The ``count`` pairs by which a search with ``seed`` judges its progress."""
        draws = Draws.seeded(self.factors, count, seeds.of_validation_parts(seed))
        return tuple(self._made((draws, draws.mirrored()), number) for number in range(count))

    def _made(self, draws: tuple[Draws, Draws], number: int) -> Pair:
        first, second = (self.maker.part(each.deviations(number)) for each in draws)
        return first, second


def _hemisphere(radius_mm: float) -> Surface:
    return SrbfSurface(_HEMISPHERE, np.zeros(_HEMISPHERE.size), radius_mm)
