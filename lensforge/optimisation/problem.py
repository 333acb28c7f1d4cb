"""Problem that a stage solves: the merit of lenses with certain levels of functions, under their constraints."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.merit import MeritFunction
from lensforge.optimisation.parameters import Parametrisation
from lensforge.optimisation.search_parts import SearchParts
from lensforge.sources.bundle import Source
from lensforge.spec import Spec


@dataclass(frozen=True)
class Problem:
    """Merit function and constraints for the levels of ``spec``, numbers here; ``sparse``: the latter at few points.

    ``parts``: of a robust search.
    """

    spec: Spec
    merit: MeritFunction
    constraints: AugmentedLagrangian
    sparse: bool = False
    parts: SearchParts | None = None

    @property
    def parametrisation(self) -> Parametrisation:
        """Parameters and tables of its lenses."""
        return self.merit.parametrisation

    def in_full(self) -> tuple[Parametrisation, AugmentedLagrangian]:
        """Parametrisation and constraints of the end of a search: where its steps look at few points, at many.

        Those between the nodes, too: there led_colours exceeds its radius by 9 um in a draft.
        """
        if not self.sparse:
            return self.parametrisation, self.constraints
        finer = self.parametrisation.refined()
        return finer, AugmentedLagrangian.of(self.spec, finer.grid)

    def multipliers_of(self, before: "Problem", multipliers: Float[Tensor, "c j"]) -> Float[Tensor, "c k"]:
        """``multipliers`` of another problem at the points of this one: those of the nearest point."""
        return self.constraints.at_nearest(before.constraints, multipliers)


@dataclass
class Problems:
    """The problems of one search, of which the last is kept.

    Automatic levels are traced through patches, and their constraints hold at fewer points.
    """

    spec: Spec
    source: Source
    nodes_per_sigma: float
    device: torch.device | None
    _last: Problem | None = None

    def of(self, levels: tuple[int, ...]) -> Problem:
        """The problem of lenses with ``levels``."""
        if self._last is None or self._last.spec.lens.levels != levels:
            spec = self.spec.with_levels(levels)
            automatic = self.spec.lens.levels == "auto"
            make = Parametrisation.patched if automatic else Parametrisation.of
            parametrisation = make(spec, self.nodes_per_sigma)
            merit = MeritFunction.of(spec, self.source, parametrisation, self.device)
            constraints = AugmentedLagrangian.of(spec, parametrisation.grid, sparse=automatic)
            parts = SearchParts.of(spec, parametrisation) if spec.optimise.robust else None
            self._last = Problem(spec, merit, constraints, automatic, parts)
        return self._last
