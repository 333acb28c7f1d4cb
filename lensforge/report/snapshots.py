"""Snapshots of a search: a record and a picture for each level, in ``DIR/snapshots``."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, OutdatedResult
from lensforge.report.lens_figures import snapshot_figure
from lensforge.results import Array, Count, Flag, Irradiance, NotNegative, Number, Positive, StageResult
from lensforge.results.chart import Chart, light_unit
from lensforge.results.figure_style import save_picture
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Progress
from lensforge.sources.build_source import build_source, summarise
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.srbf import MOST_LEVELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FOLDER = "snapshots"
_RAYS = 2**18  # enough for a picture
_POLAR, _AROUND = 61, 121  # nodes of the drawn surface
_MOVED_MM = 0.01  # two searches of one scene differ by more


class Snapshot(StageResult):
    """The lens at the end of a level: its outer surface (mm) with the slope d rho / d theta (mm/rad), and its light.

    On the first receiver: ``width``, ``height`` of its chart (mm; of the far field of the equal-area chart, as
    ``far_field`` says), ``irradiance``: W/m^2, in the far field intensity in W/sr, [row y, column x], after the filter.
    """

    stage: ClassVar[str] = "level"
    made_from: ClassVar[tuple[str, ...]] = ()
    command: ClassVar[str] = "design --snapshots"

    level: Count
    functions: Count
    step: Count
    nmse: NotNegative
    efficiency: Number
    width: Positive
    height: Positive
    far_field: Flag
    irradiance: Irradiance
    surface_mm: Annotated[Float[np.ndarray, "i j 3"], Array("i", "j", 3)]
    slope: Annotated[Float[np.ndarray, "i j"], Array("i", "j")]

    @property
    def chart(self) -> Chart:
        """Size of the map, for figures."""
        return Chart(self.width, self.height, self.far_field)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """The light after this level, in false colour."""
        from lensforge.results.plots import plot_map

        return plot_map(self.irradiance, self.chart, light_unit(None, far_field=self.far_field), axes)


def load_snapshots(directory: Path, lens: Lens) -> list[Snapshot]:
    """Snapshots of the design of ``lens`` in ``directory``, coarse first; none if of another design or version.

    Raises :class:`InputError` for a damaged file.
    """
    folder = Path(directory) / FOLDER
    files = snapshot_files(folder, ("json",))
    if len(files) > MOST_LEVELS:
        raise InputError(f"{folder}: {len(files)} snapshots, a design has at most {MOST_LEVELS}; delete the others")
    try:
        found = [Snapshot.read(folder, path.stem) for path in files]
    except OutdatedResult:
        return []
    return found if found and _ends_in(found[-1], lens) else []


def _ends_in(snapshot: Snapshot, lens: Lens) -> bool:
    """True where the outer surface of ``lens`` is that of ``snapshot``, compared on a circle around the axis.

    After the last snapshot a search may still move its lens by micrometres, back within its limits.
    """
    points = snapshot.surface_mm[len(snapshot.surface_mm) // 2]
    radius = np.linalg.norm(points, axis=1)
    if not radius.all():
        return False
    return bool(np.allclose(lens.outer.radius(points / radius[:, None]), radius, rtol=0.0, atol=_MOVED_MM))


def snapshot_files(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """The snapshots in ``folder`` by level."""
    named = re.compile(rf"level-(\d+)\.({'|'.join(suffixes)})")
    found = [(int(match[1]), path) for path in folder.glob("level-*") if (match := named.fullmatch(path.name))]
    return [path for _, path in sorted(found)]


class Snapshots:
    """An observer of a design that writes a snapshot at the end of every level.

    At the first step, when the folder is locked, it deletes those of earlier runs; with ``resume`` those are kept.
    """

    def __init__(self, spec: Spec, directory: Path, *, resume: bool = False) -> None:
        self._folder = Path(directory) / FOLDER
        self._source = build_source(spec.source, spec.lens.dispersion)
        self._outdated = not resume

    def on_step(self, step: Progress) -> None:
        """Write a snapshot if ``step`` was the last of its level."""
        if self._outdated:
            for path in snapshot_files(self._folder, ("json", "npz", "png")):
                path.unlink()
            self._outdated = False
        if not step.level_done:
            return
        from lensforge.light.evaluation import evaluate_traced
        from lensforge.light.simulation import TracedLens

        lens = step.lens()
        traced = TracedLens.of(lens, PRESETS[step.accuracy].nodes_per_sigma)  # the search's own tables
        light = evaluate_traced(traced, lens.spec, self._source, _RAYS, lens.seed)
        surface, slope = outer_slope(lens)
        snapshot = Snapshot(
            inputs={"lens": lens.sha256},
            level=step.level + 1,
            functions=step.functions,
            step=step.steps_done,
            nmse=light.nmse.value,
            efficiency=light.efficiency.value,
            width=light.first.width,
            height=light.first.height,
            far_field=light.first.chart.far_field,
            irradiance=light.map,
            surface_mm=surface,
            slope=slope,
        )
        self._write(snapshot, lens.spec)

    def _write(self, snapshot: Snapshot, spec: Spec) -> None:
        stem = f"level-{snapshot.level}"
        snapshot.write(self._folder, stem)
        unit = light_unit(summarise(self._source, spec.source).lumens_per_watt, far_field=snapshot.far_field)
        figure = snapshot_figure(snapshot.surface_mm, snapshot.slope, snapshot.irradiance, snapshot.chart, unit)
        save_picture(figure, self._folder / f"{stem}.png")


def outer_slope(lens: Lens) -> tuple[Float[np.ndarray, "i j 3"], Float[np.ndarray, "i j"]]:
    """Points of the outer surface (mm) by polar angle and azimuth, and d rho / d theta there (mm/rad)."""
    theta, phi = np.meshgrid(
        np.linspace(0.0, 0.5 * np.pi, _POLAR), np.linspace(0.0, 2.0 * np.pi, _AROUND), indexing="ij"
    )
    u = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    along = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)], axis=-1)
    radius = lens.outer.radius(u.reshape(-1, 3)).reshape(theta.shape)
    gradient = lens.outer.gradient(u.reshape(-1, 3)).reshape(u.shape)
    return radius[..., None] * u, np.sum(gradient * along, axis=-1)
