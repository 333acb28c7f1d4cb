"""The picture of each level while a design runs: ``DIR/snapshots/level-1.png``, and its numbers as a record beside."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.evaluation.evaluate import evaluate_traced
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.optimisation.progress import Progress
from lensforge.report.drawing import save_picture
from lensforge.report.snapshot import FOLDER, Snapshot, snapshot_files
from lensforge.report.snapshot_figure import snapshot_figure
from lensforge.report.task import unit_of_light
from lensforge.sources.build import build_source
from lensforge.spec import Spec

_RAYS = 2**18  # enough for a picture
_POLAR, _AROUND = 61, 121  # nodes of the drawn surface


class Snapshots:
    """An observer of a design that writes a snapshot at the end of every level; those of an earlier run go first."""

    def __init__(self, spec: Spec, directory: Path, *, resume: bool = False) -> None:
        self._folder = Path(directory) / FOLDER
        self._source = build_source(spec.source, spec.lens.dispersion)
        for path in () if resume else snapshot_files(self._folder, ("json", "npz", "png")):
            path.unlink()

    def on_step(self, step: Progress) -> None:
        """After a gradient step."""
        if step.level_done:
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
                receiver_mm=light.receiver_mm,
                irradiance=light.map,
                surface_mm=surface,
                slope=slope,
            )
            self._write(snapshot, lens.spec)

    def _write(self, snapshot: Snapshot, spec: Spec) -> None:
        stem = f"level-{snapshot.level}"
        snapshot.write(self._folder, stem)
        figure = snapshot_figure(
            snapshot.surface_mm, snapshot.slope, snapshot.irradiance, snapshot.receiver_mm, unit_of_light(spec)
        )
        save_picture(figure, self._folder / f"{stem}.png")


def outer_slope(lens: Lens) -> tuple[Float[np.ndarray, "i j 3"], Float[np.ndarray, "i j"]]:
    """Points of the outer surface (mm) on polar angle and azimuth, and d rho / d theta there (mm/rad)."""
    theta, phi = np.meshgrid(
        np.linspace(0.0, 0.5 * np.pi, _POLAR), np.linspace(0.0, 2.0 * np.pi, _AROUND), indexing="ij"
    )
    u = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    along = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)], axis=-1)
    radius = lens.outer.radius(u.reshape(-1, 3)).reshape(theta.shape)
    gradient = lens.outer.gradient(u.reshape(-1, 3)).reshape(u.shape)
    return radius[..., None] * u, np.sum(gradient * along, axis=-1)
