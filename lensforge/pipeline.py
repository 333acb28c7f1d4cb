"""The whole way and its stages: each reads what the one before left in the result folder, and leaves its own files.

A stage that fails a gate still writes its files; the gates are collected and judged at the end.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch

from lensforge.accuracy import PRESETS, Preset
from lensforge.optimisation.checkpoint import FILE_NAME as CHECKPOINT
from lensforge.optimisation.optimiser import Progress, design
from lensforge.errors import InputError
from lensforge.evaluation.evaluate import evaluate_lens
from lensforge.evaluation.simulate import TracedLens
from lensforge.files import read_json, write_json
from lensforge.gates import Gate
from lensforge.lens import Lens, load_lens
from lensforge.sources.build import account_of, build_source
from lensforge.spec import Accuracy, Spec
from lensforge.spec.source import RayfileSource
from lensforge.surfaces.srbf import fibonacci_hemisphere

# Each stage's file, in the order of the data; the gates of all of them decide the exit code.
STAGES = ("design", "evaluate", "export", "check", "verify")
_VERIFY_SEED = 2**41  # apart from the seeds of the design and of its evaluation
_STRAY_RAYS = 2**15  # every one of them becomes some ten: more would not be waited for


def run(
    spec: Spec,
    directory: Path,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    rays: int | None = None,
    device: torch.device | None = None,
    resume: bool = False,
    observer: Callable[[Progress], None] = lambda _: None,
    announce: Callable[[str], None] = lambda _: None,
) -> list[Gate]:
    """Design, evaluate, export, check, verify, report into ``directory``; the gates of all stages.

    ``observer`` sees every gradient step, ``announce`` the name of every later stage as it begins. ``device`` is that
    of the search alone: what judges the lens runs on the CPU.
    """
    run_design(
        spec, directory, accuracy=accuracy, seed=seed, rays=rays, device=device, resume=resume, observer=observer
    )
    for stage in (run_evaluate, run_export, run_check, run_verify, run_report):
        announce(stage.__name__.removeprefix("run_"))
        stage(directory)
    (directory / CHECKPOINT).unlink(missing_ok=True)  # not before: an interrupt in any stage resumes from it
    return gates_of(directory)


def run_design(
    spec: Spec,
    directory: Path,
    *,
    accuracy: Accuracy = "standard",
    seed: int = 0,
    rays: int | None = None,
    device: torch.device | None = None,
    resume: bool = False,
    observer: Callable[[Progress], None] = lambda _: None,
) -> Lens:
    """Search for the lens, on ``device`` as ``design`` has it.

    Writes ``lens.json`` and ``design.json``, and a checkpoint while it runs.
    """
    if spec.base.file is not None:  # a file that is no base is better known before the search than after it
        import_module("lensforge.geometry.step_base").read_base(spec.base.file)
    source = build_source(spec.source, spec.lens.dispersion)
    result = design(
        spec,
        source,
        accuracy=accuracy,
        seed=seed,
        rays=rays,
        device=device,
        checkpoint=directory / CHECKPOINT,
        resume=resume,
        observer=observer,
    )
    result.lens.save(directory / "lens.json")
    noted = {"source_outline_mm": source.outline().tolist(), "source": account_of(source, spec.source)}
    write_json(directory / "design.json", result.to_json() | _size(result.lens) | noted)
    return result.lens


def _size(lens: Lens) -> dict[str, float]:
    directions = fibonacci_hemisphere(20_000)
    radius = lens.outer.radius(directions)
    return {"max_radius_mm": float(radius.max()), "height_mm": float((radius * directions[:, 2]).max())}


def _lens_and_preset(directory: Path) -> tuple[Lens, Preset]:
    lens = load_lens(directory / "lens.json")
    if lens.accuracy not in PRESETS:
        raise InputError(f"{directory / 'lens.json'}: accuracy = {lens.accuracy!r}: one of {', '.join(PRESETS)}")
    return lens, PRESETS[lens.accuracy]


def run_evaluate(
    directory: Path, *, rays: int | None = None, pixels: int | None = None, source: Path | None = None
) -> dict[str, Any]:
    """Simulate the finished lens; ``source`` is a ray file that takes the place of the spec's source."""
    lens, preset = _lens_and_preset(directory)
    emitter = build_source(_replaced_source(lens.spec, source), lens.spec.lens.dispersion)
    result = evaluate_lens(lens, emitter, preset, rays=rays, pixels=pixels)
    result.save(directory)
    return result.report


def _replaced_source(spec: Spec, file: Path | None) -> Any:
    if file is None:
        return spec.source
    if isinstance(spec.source, RayfileSource):
        return spec.source.model_copy(update={"file": file})
    return RayfileSource(kind="rayfile", file=file, origin="virtual_focus", flux_w=spec.source.flux_w)


def run_export(directory: Path, **options: Any) -> dict[str, Any]:
    """STEP, STL and 3MF, proven by reading them back; ``options`` of ``geometry.export_lens``. CAD loads here only."""
    lens, _ = _lens_and_preset(directory)
    result: dict[str, Any] = import_module("lensforge.geometry.export").export_lens(lens, directory, **options)
    return result


def run_check(directory: Path) -> dict[str, Any]:
    """Whether the part can be cut."""
    lens, _ = _lens_and_preset(directory)
    result: dict[str, Any] = import_module("lensforge.manufacturing.check").check_lens(lens, directory)
    return result


def run_sensitivity(directory: Path, *, rays: int | None = None) -> dict[str, Any]:
    """What small errors of making and mounting do to the light."""
    lens, preset = _lens_and_preset(directory)
    measure = import_module("lensforge.tolerancing.sensitivity").measure_sensitivity
    source = build_source(lens.spec.source, lens.spec.lens.dispersion)
    result: dict[str, Any] = measure(lens, source, preset, directory, rays=rays)
    return result


def run_handover(directory: Path) -> dict[str, Any]:
    """What goes to the shop with the STEP file."""
    result: dict[str, Any] = import_module("lensforge.drawings.build").build_handover(directory)
    return result


def run_verify(directory: Path, *, rays: int | None = None) -> dict[str, Any]:
    """Cast rays through the exported STL, and some through the STEP, and compare with where the design sends them."""
    lens, preset = _lens_and_preset(directory)
    spec = lens.spec
    irradiance = _design_irradiance(directory)
    source = build_source(spec.source, spec.lens.dispersion)
    count = min(rays or preset.verify_rays, source.population or 2**40)
    bundle = source.sample(count, _VERIFY_SEED + lens.seed)
    arrivals = TracedLens.of(lens, preset.judge_nodes_per_sigma).trace(bundle)
    hits = np.where(arrivals.arrived.numpy()[:, None], arrivals.hits.numpy(), np.nan)
    step, mitsuba = directory / "lens.step", import_module("lensforge.verification.mitsuba_cast")
    result: dict[str, Any] = import_module("lensforge.verification.verify").verify_part(
        directory / "lens.stl",
        directory,
        rays=bundle,
        refractive_index=lens.refractive_index,
        distance_mm=spec.target.distance_mm,
        receiver_mm=spec.target.receiver_mm,
        window_mm=spec.evaluate.window_mm or spec.target.receiver_mm,
        pixels=len(irradiance),
        design_irradiance=irradiance,
        design_hits=hits,
        design_weights=arrivals.flux.numpy(),
        filter_variance=spec.evaluate.filter_variance,
        step=step if step.exists() else None,
        mitsuba_rays=mitsuba.RAYS if mitsuba.installed() else 0,
        threads=torch.get_num_threads(),
    )
    return result


def run_stray(directory: Path, *, rays: int | None = None, base: str = "polished") -> dict[str, Any]:
    """Follow rays through the exported STL with reflections, base and absorption: what the design leaves out."""
    lens, preset = _lens_and_preset(directory)
    spec = lens.spec
    source = build_source(spec.source, spec.lens.dispersion)
    count = min(rays or min(preset.verify_rays, _STRAY_RAYS), source.population or 2**40)
    bundle = source.sample(count, _VERIFY_SEED + lens.seed)
    receiver = import_module("lensforge.verification.picture").Receiver
    result: dict[str, Any] = import_module("lensforge.verification.stray").trace_stray(
        directory / "lens.stl",
        directory,
        rays=bundle,
        refractive_index=lens.refractive_index,
        absorption_per_mm=spec.lens.absorption_per_mm,
        distance_mm=spec.target.distance_mm,
        receiver=receiver(spec.target.receiver_mm, spec.evaluate.pixels, spec.evaluate.filter_variance),
        window_mm=spec.evaluate.window_mm or spec.target.receiver_mm,
        base=base,
    )
    return result


def run_compare_photo(
    directory: Path,
    *,
    on: Path,
    off: Path | None,
    corners: Sequence[tuple[float, float]] | None,
    target_mm: float | None = None,
    gamma: float = 1.0,
) -> dict[str, Any]:
    """Compare a photograph with the simulation; ``target_mm``: side of the square of ``corners``, found if None."""
    lens, _ = _lens_and_preset(directory)
    target = lens.spec.target
    photo = import_module("lensforge.measurement.photo")
    result: dict[str, Any] = photo.compare_photo(
        photo.Shot(on, off, None if corners is None else np.array(corners, dtype=np.float64), target_mm, gamma),
        directory,
        simulated=_design_irradiance(directory),
        receiver_mm=target.receiver_mm,
        uniform_mm=target.uniform_mm,
    )
    return result


def run_compare_surface(
    directory: Path, *, points: Path, surface: str, registration: str = "rigid", rays: int | None = None
) -> dict[str, Any]:
    """Register measured points to one surface, map its form deviation, and simulate the lens with it."""
    lens, preset = _lens_and_preset(directory)
    result: dict[str, Any] = import_module("lensforge.measurement.surface").compare_surface(
        import_module("lensforge.measurement.cloud").read_cloud(points),
        directory,
        lens=lens,
        side=surface,
        source=build_source(lens.spec.source, lens.spec.lens.dispersion),
        preset=preset,
        rays=rays,
        freedom=registration,
    )
    return result


def _design_irradiance(directory: Path) -> np.ndarray:
    path = directory / "evaluate.npz"
    try:
        with np.load(path) as images:
            irradiance: np.ndarray = images["irradiance"]
            return irradiance
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; run `lensforge evaluate {directory}` first") from None
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: damaged ({error}); run `lensforge evaluate {directory}` again") from None


def run_report(directory: Path) -> Path:
    """``report.html`` from the files in ``directory``."""
    path: Path = import_module("lensforge.report.build").build_report(directory)
    return path


def gates_of(directory: Path) -> list[Gate]:
    """The gates of every stage that has run in ``directory``."""
    paths = [directory / f"{stage}.json" for stage in STAGES]
    return [Gate.from_json(entry) for path in paths if path.exists() for entry in read_json(path)["gates"]]
