"""The picture of each level while a design runs: ``DIR/snapshots/level-1.png``, and its numbers beside it as npz."""

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.optimisation.optimiser import Progress
from lensforge.errors import InputError
from lensforge.evaluation.evaluate import evaluate_traced
from lensforge.evaluation.simulate import TracedLens
from lensforge.files import replacing
from lensforge.lens import Lens
from lensforge.report.drawing import save_picture
from lensforge.figures.light_unit import light_unit
from lensforge.report.snapshot_figure import snapshot_figure
from lensforge.sources.build import build_source
from lensforge.spec import Spec

FOLDER = "snapshots"
_RAYS = 2**18  # enough for a picture
_POLAR, _AROUND = 61, 121  # nodes of the drawn surface


@dataclass(frozen=True)
class Snapshot:
    """The lens at the end of a level: its outer surface (mm) with the slope d rho / d theta (mm/rad), and its light."""

    level: int
    functions: int
    step: int
    nmse: float
    efficiency: float
    receiver_mm: float
    irradiance: Float[np.ndarray, "p p"]
    surface_mm: Float[np.ndarray, "i j 3"]
    slope: Float[np.ndarray, "i j"]


class Snapshots:
    """An observer of a design that writes a snapshot at the end of every level; those of an earlier run go first."""

    def __init__(self, spec: Spec, directory: Path, *, resume: bool = False) -> None:
        self._folder = Path(directory) / FOLDER
        self._source = build_source(spec.source, spec.lens.dispersion)
        for path in () if resume else _files(self._folder, ("npz", "png")):
            path.unlink()

    def on_step(self, step: Progress) -> None:
        """After a gradient step."""
        if step.level_done:
            lens = step.lens()
            traced = TracedLens.of(lens, PRESETS[step.accuracy].nodes_per_sigma)  # the search's own tables
            result = evaluate_traced(traced, lens.spec, self._source, _RAYS, lens.seed)
            surface, slope = outer_slope(lens)
            snapshot = Snapshot(
                level=step.level + 1,
                functions=step.functions,
                step=step.steps_done,
                nmse=_number(result.report["nmse"]),
                efficiency=_number(result.report["efficiency"]),
                receiver_mm=result.report["receiver_mm"],
                irradiance=result.irradiance,
                surface_mm=surface,
                slope=slope,
            )
            self._write(snapshot, lens)

    def _write(self, snapshot: Snapshot, lens: Lens) -> None:
        path = self._folder / f"level-{snapshot.level}.npz"
        with replacing(path) as temporary:
            np.savez_compressed(temporary, **vars(snapshot))
        figure = snapshot_figure(
            snapshot.surface_mm, snapshot.slope, snapshot.irradiance, snapshot.receiver_mm, light_unit(lens.spec)
        )
        save_picture(figure, path.with_suffix(".png"))


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


def load_snapshots(directory: Path, lens: Lens) -> list[Snapshot]:
    """What the design of ``lens`` left in ``directory``, coarse first; nothing if another design left it.

    Raises :class:`InputError` for a damaged file.
    """
    found = [_load(path) for path in _files(Path(directory) / FOLDER, ("npz",))]
    return found if found and _ends_in(found[-1], lens) else []


def _ends_in(snapshot: Snapshot, lens: Lens) -> bool:
    """Whether the outer surface of ``lens`` is the one of ``snapshot``, judged on a circle around the axis."""
    points = snapshot.surface_mm[len(snapshot.surface_mm) // 2]
    radius = np.linalg.norm(points, axis=1)
    return bool(np.allclose(lens.outer.radius(points / radius[:, None]), radius, rtol=0.0, atol=1e-6))


def _load(path: Path) -> Snapshot:
    try:
        with np.load(path, allow_pickle=False) as file:
            content: dict[str, Any] = {name: file[name] for name in Snapshot.__dataclass_fields__}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: damaged snapshot ({type(error).__name__}); delete it or design again") from None
    return Snapshot(**{name: value.item() if value.ndim == 0 else value for name, value in content.items()})


def _files(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """The snapshots in ``folder`` by level."""
    named = re.compile(rf"level-(\d+)\.({'|'.join(suffixes)})")
    found = [(int(match[1]), path) for path in folder.glob("level-*") if (match := named.fullmatch(path.name))]
    return [path for _, path in sorted(found)]


def _number(value: float | None) -> float:
    return float("nan") if value is None else value
