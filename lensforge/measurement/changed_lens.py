"""Light of a lens with changed radii on one face beside that of the design, simulated with the same rays."""

from dataclasses import dataclass

import torch

from lensforge.evaluation.replicate_metrics import TracedLight, traced_light
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.measurement.comparison import Side
from lensforge.sources.bundle import Source
from lensforge.surfaces.spline import grid_for, tabulate
from lensforge.surfaces.surface import Surface
from lensforge.tracing.tables import Scene

# A change is a thousandth of the radius: five nodes for its shortest wave keep its slopes to some hundredths.
_WIDER = 2.0


@dataclass(frozen=True)
class ChangedLens:
    """Simulation of a lens with changed radii on one ``side``, always with the same rays."""

    lens: Lens
    side: Side
    source: Source
    nodes_per_sigma: float
    rays: int

    def lights(self, *changes: Surface | None) -> list[TracedLight]:
        """Light of the lens with each of ``changes`` (mm) added to the radius; None: the design."""
        details = [_WIDER * change.detail_rad for change in changes if change is not None]
        grid = grid_for(min(self.lens.detail_rad, *details), self.nodes_per_sigma)
        tables = {name: tabulate(grid, getattr(self.lens, name)) for name in ("inner", "outer")}
        scene, found = Scene(self.lens.media, grid), []
        for change in changes:
            own = dict(tables)
            if change is not None:
                own[self.side] = own[self.side] + tabulate(grid, change)  # tables are linear in the radius
            inner, outer = (torch.from_numpy(own[name]) for name in ("inner", "outer"))
            traced = TracedLens(scene, inner, outer, {})
            found.append(traced_light(traced, self.lens.spec, self.source, self.rays, self.lens.seed))
        return found
