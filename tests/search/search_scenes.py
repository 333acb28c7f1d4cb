"""Scenes, steps and interrupts that several tests of a search share."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from presets import FEW
from scenes import small_spec

from lensforge.light.lens_light import searched_source
from lensforge.search.design_result import Design, Progress
from lensforge.search.kinds import LightOfKinds
from lensforge.search.optimiser import search
from lensforge.search.problem import Problems
from lensforge.sources.ray_bundle import Source
from lensforge.spec import AnyAccuracy, Spec

LARGE = {"source_shift_mm": 0.2, "source_height_mm": 0.2, "outer_shift_mm": 0.1, "inner_form_um": 20.0, "index": 0.01}
WHITE = {"kind": "table", "wavelength_nm": [440.0, 460.0, 550.0, 680.0], "weight": [0.0, 1.0, 0.6, 0.0]}
RECEIVERS: dict[str, dict[str, Any]] = {
    "tilted plane": {
        "kind": "plane", "centre_mm": [60.0, 20.0, 90.0], "tilt_deg": [-12.0, 30.0], "rotation_deg": 20.0,
        "width_mm": 200.0, "height_mm": 120.0,
        "targets": [{"kind": "disc", "diameter_mm": 60.0, "edge_mm": 4.0, "uniform_mm": 40.0}],
    },
    "far field": {
        "kind": "far_field", "half_angle_deg": 70.0, "axis": [0.1, 0.0, 1.0],
        "targets": [{"kind": "beam", "fwhm_deg": [40.0, 30.0]}],
    },
    "cylinder": {
        "kind": "cylinder", "radius_mm": 80.0, "width_mm": 200.0, "height_mm": 120.0, "rotation_deg": 10.0,
        "targets": [{"kind": "cross", "length_mm": 80.0, "stroke_mm": 30.0}],
    },
    "sphere": {
        "kind": "sphere", "radius_mm": 80.0, "half_angle_deg": 70.0, "centre_mm": [3.0, -4.0, 5.0],
        "targets": [{"kind": "rectangle", "width_mm": 90.0, "height_mm": 60.0}],
    },
}  # fmt: skip
STATES: dict[str, Any] = {
    "lens__index_per_k": -1e-4, "lens__expansion_per_k": 1e-4,
    "states": [
        {"name": "near", "weight": 3.0, "temperature_c": 80.0},
        {"name": "far", "shift_mm": [0.1, -0.2, 0.2], "tilt_deg": [-5.0, 20.0], "target": {
            "kind": "rectangle", "width_mm": 90.0, "height_mm": 60.0, "centre_mm": [20.0, 0.0],
            "distance_mm": 80.0, "receiver_mm": 150.0}},
    ],
}  # fmt: skip


class Step:
    """Merit of one step from a lens that is not round and too large, so that constraints count, too."""

    def __init__(self, changes: dict[str, Any], *, single: bool = False) -> None:
        spec = small_spec(**changes)
        rng = np.random.default_rng(0)
        source = searched_source(spec)
        self.problem = Problems(spec, source, 3.0, None, single).of((9, 25))
        parts = self.problem.parts
        self.pairs = () if parts is None else parts.of_step(0, 3)
        lenses = max(1, len(spec.all_lamps.kinds))
        weights = torch.from_numpy(rng.normal(size=(34, 2 * lenses)) * 0.01).requires_grad_()
        self.parameters = weights, torch.tensor(lenses * [1.0, 1.2], dtype=torch.float64, requires_grad=True)
        self.ways = torch.from_numpy(rng.normal(size=(34, 2 * lenses))), torch.from_numpy(rng.normal(size=2 * lenses))
        self.rays = source.sample(1024, 1)

    def loss(self, by: tuple[float, float] = (0.0, 0.0), **light: Any) -> torch.Tensor:
        """The merit with the parameters moved along their ways; ``light``: changes of the path of the light."""
        merit = self.problem.merit
        if light and isinstance(merit.light, LightOfKinds):
            paths = tuple(replace(path, **light) for path in merit.light.paths)
            merit = replace(merit, light=replace(merit.light, paths=paths))
        elif light:
            merit = replace(merit, light=replace(merit.light, **light))
        moved = (parameter + step * way for parameter, step, way in zip(self.parameters, by, self.ways, strict=True))
        return merit.step_loss(*moved, self.rays, self.problem.constraints, True, self.pairs).loss

    def values(self, **light: Any) -> tuple[torch.Tensor, ...]:
        """The merit and its gradient."""
        loss = self.loss(**light)
        return loss.detach(), *torch.autograd.grad(loss, self.parameters)


class Stop(KeyboardInterrupt):
    """An interrupt by the user."""


def search_interrupted(
    spec: Spec, source: Source, checkpoint: Path, stop_at: int, seed: int = 0, accuracy: AnyAccuracy = FEW
) -> None:
    """A search that is interrupted after ``stop_at`` steps, and leaves its checkpoint."""

    def stop(step: Progress) -> None:
        if step.steps_done == stop_at:
            raise Stop

    with pytest.raises(Stop):
        search(spec, source, accuracy=accuracy, seed=seed, checkpoint=checkpoint, progress=stop)


def require_same_bits_after(
    stop_at: int,
    spec: Spec,
    source: Source,
    checkpoint: Path,
    whole: Design,
    seed: int = 0,
    accuracy: AnyAccuracy = FEW,
) -> None:
    """Assert that a search interrupted after ``stop_at`` steps goes on to the bits of the ``whole`` one."""
    search_interrupted(spec, source, checkpoint, stop_at, seed, accuracy)
    for _ in range(2):  # the second time from the end of the search
        resumed = search(spec, source, accuracy=accuracy, seed=seed, checkpoint=checkpoint, resume=True)
        assert resumed.lens.sha256 == whole.lens.sha256
        assert (resumed.ended, resumed.history) == (whole.ended, whole.history)
