"""One level of a search as its snapshot holds it, and how those of a design are read again."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from jaxtyping import Float

from lensforge.errors import OutdatedResult
from lensforge.figures.light_unit import WATTS
from lensforge.lens import Lens
from lensforge.records import Array, Count, NotNegative, Number, Positive, StageResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FOLDER = "snapshots"


class Snapshot(StageResult):
    """The lens at the end of a level: its outer surface (mm) with the slope d rho / d theta (mm/rad), and its light.

    ``irradiance``: W/m^2 [row y, column x], after the filter.
    """

    stage: ClassVar[str] = "level"
    made_from: ClassVar[tuple[str, ...]] = ()
    command: ClassVar[str] = "design --snapshots"

    level: Count
    functions: Count
    step: Count
    nmse: NotNegative
    efficiency: Number
    receiver_mm: Positive
    irradiance: Annotated[Float[np.ndarray, "p p"], Array("p", "p")]
    surface_mm: Annotated[Float[np.ndarray, "i j 3"], Array("i", "j", 3)]
    slope: Annotated[Float[np.ndarray, "i j"], Array("i", "j")]

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """The light after this level, in false colour."""
        from lensforge.figures.plots import plot_map

        return plot_map(self.irradiance, self.receiver_mm, WATTS, axes)


def load_snapshots(directory: Path, lens: Lens) -> list[Snapshot]:
    """What the design of ``lens`` left in ``directory``, coarse first; nothing if another design or version left it.

    Raises :class:`InputError` for a damaged file.
    """
    folder = Path(directory) / FOLDER
    try:
        found = [Snapshot.read(folder, path.stem) for path in snapshot_files(folder, ("json",))]
    except OutdatedResult:
        return []
    return found if found and _ends_in(found[-1], lens) else []


def _ends_in(snapshot: Snapshot, lens: Lens) -> bool:
    """Whether the outer surface of ``lens`` is the one of ``snapshot``, judged on a circle around the axis."""
    points = snapshot.surface_mm[len(snapshot.surface_mm) // 2]
    radius = np.linalg.norm(points, axis=1)
    return bool(np.allclose(lens.outer.radius(points / radius[:, None]), radius, rtol=0.0, atol=1e-6))


def snapshot_files(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """The snapshots in ``folder`` by level."""
    named = re.compile(rf"level-(\d+)\.({'|'.join(suffixes)})")
    found = [(int(match[1]), path) for path in folder.glob("level-*") if (match := named.fullmatch(path.name))]
    return [path for _, path in sorted(found)]
