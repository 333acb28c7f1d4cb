"""``evaluate.json`` and ``evaluate.npz``: the finished lens under the paper's protocol."""

import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import Preset
from lensforge.evaluation.metrics import jackknife, nmse, relative_deviation, uniformity
from lensforge.evaluation.preset_error import measure_preset
from lensforge.evaluation.simulate import Simulation, TracedLens, simulate
from lensforge.files import replacing, write_json
from lensforge.gates import Gate
from lensforge.lens import Lens
from lensforge.receivers.filter import gaussian3
from lensforge.receivers.plane import Receiver
from lensforge.receivers.targets import target_irradiance
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.tracing.fates import Fate

# The contract's six causes; everything under "missed" is told apart by ``missed_by_cause``.
_MISSED = (Fate.BACKWARD, Fate.OUTSIDE_CAVITY, Fate.BASE, Fate.AVERTED, Fate.CROSSED)


@dataclass(frozen=True)
class Evaluation:
    """Metrics, flux account and images (W/m^2) of a lens under a source."""

    report: dict[str, Any]
    irradiance: Float[np.ndarray, "p p"]
    raw: Float[np.ndarray, "p p"]
    target: Float[np.ndarray, "p p"]
    axis_mm: Float[np.ndarray, " p"]

    def save(self, directory: Path) -> None:
        """Write ``evaluate.json`` and the images, ``evaluate.npz``."""
        write_json(directory / "evaluate.json", self.report)
        with replacing(directory / "evaluate.npz") as temporary:
            np.savez_compressed(
                temporary, irradiance=self.irradiance, raw=self.raw, target=self.target, axis_mm=self.axis_mm
            )


def evaluate_lens(
    lens: Lens, source: Source, preset: Preset, *, rays: int | None = None, pixels: int | None = None
) -> Evaluation:
    """Simulate ``lens``: rays from the argument, the spec, or the preset, in this order; pixels likewise.

    What the preset's tables leave on this scene is measured as well: ``preset_error`` of the report.
    """
    traced = TracedLens.of(lens, preset.judge_nodes_per_sigma)
    count = rays or lens.spec.evaluate.rays or preset.evaluate_rays
    result = evaluate_traced(traced, lens.spec, source, count, lens.seed, pixels)
    tables = {"design": TracedLens.of(lens, preset.nodes_per_sigma), "evaluation": traced}
    return replace(result, report=result.report | {"preset_error": measure_preset(lens, source, tables)})


def evaluate_traced(
    traced: TracedLens, spec: Spec, source: Source, rays: int, seed: int, pixels: int | None = None
) -> Evaluation:
    """Simulate surfaces that are tables already, such as measured ones, under the protocol of ``spec``."""
    started = time.perf_counter()
    receiver = Receiver(spec.target.receiver_mm, pixels or spec.evaluate.pixels)
    window_mm = spec.evaluate.window_mm or spec.target.receiver_mm
    simulation = simulate(traced, source, receiver, window_mm, rays, seed)
    images = np.stack([gaussian3(image, spec.evaluate.filter_variance) for image in simulation.images])
    target = target_irradiance(spec.target, receiver)
    report = _metrics(images, simulation, target, receiver, spec.target.uniform_mm)
    report |= _flux_account(simulation)
    report |= {
        "rays": simulation.rays,
        "replicates": len(images),
        "pixels": receiver.pixels,
        "filter": f"3x3 Gaussian, variance {spec.evaluate.filter_variance:g} pixel^2, hard bins",
        "receiver_mm": receiver.side_mm,
        "window_mm": window_mm,
        "table_nodes": traced.scene.grid.nodes,
        "table_error_nm": traced.table_error_nm,
        "seconds": time.perf_counter() - started,
        "gates": [_all_converged(simulation).to_json()],
    }
    mean, raw = images.mean(axis=0), simulation.images.mean(axis=0)
    wanted = target * mean.sum()
    area = receiver.pixel_area_m2
    return Evaluation(report, mean / area, raw / area, wanted / area, receiver.axis_mm())


def _metrics(
    images: Float[np.ndarray, "r p p"],
    simulation: Simulation,
    target: Float[np.ndarray, "p p"],
    receiver: Receiver,
    uniform_mm: float | None,
) -> dict[str, Any]:
    report: dict[str, Any] = {}

    def add(name: str, value: float | None, error: float | None) -> None:
        report[name], report[f"{name}_standard_error"] = value, error

    lit = images.sum() > 0.0
    mask = receiver.square_mask(uniform_mm or 0.0)
    in_mask = uniform_mm is not None and mask.any() and lit
    add("uniformity", *(jackknife(images, partial(uniformity, mask=mask)) if in_mask else (None, None)))
    add("rsd", *(jackknife(images, partial(relative_deviation, mask=mask)) if in_mask else (None, None)))
    add("nmse", *(jackknife(images, partial(nmse, target=target)) if lit else (None, None)))
    report["nmse_of_noise"] = _noise(images) if lit else None
    efficiency, error = jackknife(simulation.window[:, None], lambda mean: float(mean[0]))
    add("efficiency", efficiency / simulation.emitted_w, None if error is None else error / simulation.emitted_w)
    return report


def _noise(images: Float[np.ndarray, "r p p"]) -> float | None:
    """The share of the NMSE that ray noise alone makes: variance of the mean image over its square."""
    if len(images) < 2:
        return None
    mean = images.mean(axis=0)
    return float(images.var(axis=0, ddof=1).sum() / len(images) / np.sum(mean**2))


def _flux_account(simulation: Simulation) -> dict[str, Any]:
    share = simulation.by_fate.mean(axis=0) / simulation.emitted_w
    detected = float(simulation.window.mean() / simulation.emitted_w)
    missed = {fate.name.lower(): float(share[fate]) for fate in _MISSED}
    flux = {
        "detected": detected,
        "outside": float(share[Fate.ARRIVED]) - detected,
        "missed": sum(missed.values()),
        "total_reflection": float(share[Fate.TOTAL_REFLECTION]),
        "not_converged": float(share[Fate.NOT_CONVERGED]),
        "absorbed_fresnel": 1.0 - float(share.sum()),
    }
    return {"flux": flux, "missed_by_cause": missed}


def _all_converged(simulation: Simulation) -> Gate:
    lost = float(simulation.by_fate[:, Fate.NOT_CONVERGED].mean() / simulation.emitted_w)
    return Gate("flux not converged", lost, "<=", 0.0, "of the source", "raise --accuracy; please report the lens.json")
