"""Constraints in a search: sequential unconstrained minimisation with multipliers.

The paper takes the minimum over the hemisphere, whose gradient sees one point. Here every point carries its
own multiplier and Eq. (15) is averaged over the hemisphere's solid angle: the same feasible set, reached more smoothly.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

from lensforge.optimisation.chart_points import ChartOperator, constraint_points
from lensforge.optimisation.constraints import Constraint, constraints_of
from lensforge.spec import Spec
from lensforge.surfaces.spline import TableGrid


@dataclass
class AugmentedLagrangian:
    """Multipliers of ``c`` constraints at ``k`` points; the fields are scaled by each constraint's factor."""

    constraints: tuple[Constraint, ...]
    chart_operator: ChartOperator
    penalty: float = 2e4
    multipliers: Float[Tensor, "c k"] = field(init=False)

    @staticmethod
    def of(spec: Spec, grid: TableGrid, penalty: float = 2e4, *, sparse: bool = False) -> "AugmentedLagrangian":
        """The spec's constraints at points of ``grid``.

        ``sparse``: at a quarter of its nodes; at all for curvatures, and for a keep-out, whose outline is sharp.
        """
        constraints = constraints_of(spec)
        derivatives = any(constraint.derivatives for constraint in constraints)
        detailed = derivatives or spec.constraints.keep_out is not None
        every = (1 if detailed else 2) if sparse else None
        points = constraint_points(grid, spec.lens.basis.symmetry, every_node=every)
        spacing = grid.step * (1.0 if every is None else every * sqrt(2.0))  # with centres: triangles of three points
        return AugmentedLagrangian(constraints, ChartOperator.of(grid, points, derivatives, spacing), penalty)

    def __post_init__(self) -> None:
        area = self.chart_operator.points.scale**2
        self._area = area / area.sum()
        self._factor, self._margin = (
            torch.tensor(values, dtype=torch.float64)[:, None]
            for values in (
                [constraint.factor for constraint in self.constraints],
                [constraint.factor * constraint.margin for constraint in self.constraints],
            )
        )
        self.multipliers = torch.zeros(len(self.constraints), len(area), dtype=torch.float64)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the constraints in the history of a search."""
        return tuple(constraint.key for constraint in self.constraints)

    def fresh(self, penalty: float) -> "AugmentedLagrangian":
        """The same constraints with multipliers of 0."""
        return AugmentedLagrangian(self.constraints, self.chart_operator, penalty)

    def tightened(self, by: Mapping[str, float]) -> "AugmentedLagrangian":
        """The constraints with limits that are stricter by what ``by`` has under their keys, in the unit of each."""
        constraints = tuple(each.tightened(by.get(each.key, 0.0)) for each in self.constraints)
        return AugmentedLagrangian(constraints, self.chart_operator, self.penalty)

    def at_nearest(self, before: "AugmentedLagrangian", multipliers: Float[Tensor, "c j"]) -> Float[Tensor, "c k"]:
        """``multipliers`` at the points of ``before``, taken to these points: each has that of the nearest one.

        The force on a length, an angle or a curvature stays the same, whatever the factors of both.
        """
        here, there = (
            np.stack([each.points.x.numpy(), each.points.y.numpy()], axis=1)
            for each in (self.chart_operator, before.chart_operator)
        )
        nearest = multipliers[:, torch.from_numpy(cKDTree(there).query(here)[1])]
        return nearest * before._factor / self._factor

    def fields(self, inner: Float[Tensor, "side side"], outer: Float[Tensor, "side side"]) -> Float[Tensor, "c k"]:
        """Fields of the constraints at the points of two tables, each times its factor."""
        at_inner, at_outer = self.chart_operator.jets(inner, outer)
        values = [each.field(at_inner, at_outer, self.chart_operator.points) for each in self.constraints]
        return self._factor * torch.stack(values)

    def least(self, fields: Float[Tensor, "c k"]) -> dict[str, float]:
        """The minimum of each constraint over the points, in its unit, for the history of a search."""
        least = (fields.detach() / self._factor).amin(dim=1).tolist()
        return dict(zip(self.keys, least, strict=True))

    def term(self, fields: Float[Tensor, "c k"]) -> Float[Tensor, ""]:
        """The regularisation term of Eq. (15), averaged over the hemisphere."""
        updated = self._updated(fields)
        return torch.sum(self._area * (updated**2 - self.multipliers**2)) / (2.0 * self.penalty)

    def penalty_alone(self, fields: Float[Tensor, "c k"]) -> Float[Tensor, ""]:
        """The term without multipliers: lenses of different searches are judged alike."""
        missing = torch.clamp(self._margin - fields, min=0.0)
        return 0.5 * self.penalty * torch.sum(self._area * missing**2)

    def shortfall(self, fields: Float[Tensor, "c k"]) -> float:
        """Part of a constraint's margin missing at the worst point: 0 where all margins are kept, 1 at a limit."""
        return float(torch.clamp(1.0 - fields.detach() / self._margin, min=0.0).max())

    def update(self, fields: Float[Tensor, "c k"]) -> None:
        """First-order multiplier update; call it between rounds of minimisation."""
        self.multipliers = self._updated(fields.detach())

    def _updated(self, fields: Float[Tensor, "c k"]) -> Float[Tensor, "c k"]:
        return torch.clamp(self.multipliers - self.penalty * (fields - self._margin), min=0.0)
