"""The paper's three constraints, Eqs. (10) to (14), by sequential unconstrained minimisation with multipliers.

The paper takes the minimum over the hemisphere, whose gradient sees one point. Here every table node carries its own
multiplier and Eq. (15) is averaged over the hemisphere's solid angle: the same feasible set, a smoother way there.
"""

from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.gates import Gate
from lensforge.lens import Lens
from lensforge.spec import ConstraintsSection
from lensforge.surfaces import chart
from lensforge.surfaces.spline import TableGrid
from lensforge.surfaces.srbf import fibonacci_hemisphere

TOLERANCE_MM = 1e-3
# The search aims this far inside of the limits, relative to the largest radius allowed: its last steps still move by
# that much, and the nodes do not see the very peak between them. It costs nothing that can be measured.
_MARGIN = 3e-4
NAMES = ("g1_mm", "g2_mm", "g3_mm")
_REMEDIES = (
    "raise lens.inner_offset_mm or lower constraints.cavity_*",
    "raise lens.outer_offset_mm or lower constraints.min_thickness_mm",
    "raise constraints.max_radius_mm or lower lens.outer_offset_mm",
)


def constraint_fields(
    inner: Float[Tensor, " n"], outer: Float[Tensor, " n"], cosine: Float[Tensor, " n"], limits: ConstraintsSection
) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"], Float[Tensor, " n"]]:
    """The three constraints (mm) at directions of the given polar cosine; at least 0 where feasible."""
    squared = (inner**2) * (1.0 - cosine**2)
    cavity = limits.cavity_height_mm / limits.cavity_radius_mm**2 * squared + inner * cosine - limits.cavity_height_mm
    return cavity, outer - inner - limits.min_thickness_mm, limits.max_radius_mm - outer


@dataclass
class AugmentedLagrangian:
    """Multipliers at the nodes of ``grid`` within the hemisphere; lengths relative to the largest radius allowed."""

    limits: ConstraintsSection
    grid: TableGrid
    stringency: float = 2e4
    multipliers: Float[Tensor, "3 k"] = field(init=False)

    def __post_init__(self) -> None:
        nodes = chart.grid(self.grid.nodes)
        squared = np.sum(nodes * nodes, axis=-1)
        self._inside = torch.from_numpy(squared <= 1.0 + 1e-12)
        inside = torch.from_numpy(squared)[self._inside]
        self._cosine = (1.0 - inside) / (1.0 + inside)
        area = 4.0 / (1.0 + inside) ** 2
        self._share = area / area.sum()
        self.multipliers = torch.zeros(3, len(area), dtype=torch.float64)

    def _at_nodes(self, table: Float[Tensor, "side side"]) -> Float[Tensor, " k"]:
        rows = (table[:-2] + 4.0 * table[1:-1] + table[2:]) / 6.0
        return ((rows[:, :-2] + 4.0 * rows[:, 1:-1] + rows[:, 2:]) / 6.0)[self._inside]

    def fields(self, inner: Float[Tensor, "side side"], outer: Float[Tensor, "side side"]) -> Float[Tensor, "3 k"]:
        """The constraints at the nodes, relative to the largest radius allowed."""
        g = constraint_fields(self._at_nodes(inner), self._at_nodes(outer), self._cosine, self.limits)
        return torch.stack(g) / self.limits.max_radius_mm

    def least_mm(self, fields: Float[Tensor, "3 k"]) -> dict[str, float]:
        """The minimum of each constraint over the nodes; the history of a search keeps it."""
        least = self.limits.max_radius_mm * fields.detach().amin(dim=1)
        return dict(zip(NAMES, least.tolist(), strict=True))

    def term(self, fields: Float[Tensor, "3 k"]) -> Float[Tensor, ""]:
        """The regularisation term of Eq. (15), averaged over the hemisphere."""
        push = torch.clamp(self.multipliers - self.stringency * (fields - _MARGIN), min=0.0)
        return torch.sum(self._share * (push**2 - self.multipliers**2)) / (2.0 * self.stringency)

    def update(self, fields: Float[Tensor, "3 k"]) -> None:
        """First-order multiplier update; call it between rounds of minimisation."""
        self.multipliers = torch.clamp(self.multipliers - self.stringency * (fields.detach() - _MARGIN), min=0.0)


def measure_constraints(lens: Lens, directions: int = 60_000) -> dict[str, float]:
    """The constraints (mm) by the exact sum, minimum over a Fibonacci grid of the hemisphere and its rim."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 2048, endpoint=False)
    rim = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
    u = np.concatenate([fibonacci_hemisphere(directions), rim])
    inner, outer, cosine = (torch.from_numpy(a) for a in (lens.inner.radius(u), lens.outer.radius(u), u[:, 2].copy()))
    g = constraint_fields(inner, outer, cosine, lens.spec.constraints)
    return {name: float(value.min()) for name, value in zip(NAMES, g, strict=True)}


def constraint_gates(measured: dict[str, float]) -> list[Gate]:
    """One gate for each constraint: at least -1 um."""
    return [
        Gate(f"constraint {name[:2]}", measured[name], ">=", -TOLERANCE_MM, "mm", remedy)
        for name, remedy in zip(NAMES, _REMEDIES, strict=True)
    ]
