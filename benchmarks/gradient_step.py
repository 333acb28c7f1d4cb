"""One gradient step of the flat top: time of its parts, growth with rays and functions, set-up, memory.

    python benchmarks/gradient_step.py [--rays 524288] [--repeat 7]

Prints the median of each part over the repeats, and ratios within this run; absolute times depend on the machine.
"""

import lensforge  # noqa: F401  before torch, whose idle threads then sleep

# isort: split
import argparse
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import trimesh

from lensforge.light.table_trace import Scene, Tables, TracedBundle
from lensforge.scene.exit_rays import Sensitivities
from lensforge.search.problem import Problems
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.search.schedule import rays_ahead
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec, load_spec
from lensforge.spec.housing_sections import HousingFile

LEVELS, MANY, AUTOMATIC = (25, 81, 289), (25, 81, 289, 1089, 2741), (9, 25, 81, 289, 1089)
# With a face of each that is frosted, and the levels of its functions.
FROSTED = (("flat_top", "outer", (25, 81)), ("spot", "exit", ()), ("reflector", "cup", ()), ("shelf", "outer", ()))
SPEC, CHAIN, BEZEL = (Path(__file__).parents[1] / "examples" / f"{name}.toml" for name in ("flat_top", "spot", "bezel"))


def median_seconds(work: Callable[[], object], repeat: int) -> float:
    work()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


class Step:
    """The step of the design loop, with its parts callable one by one."""

    def __init__(
        self, rays: int, levels: tuple[int, ...] = LEVELS, *, automatic: bool = False, spec: Spec | None = None
    ) -> None:
        spec, start = spec or load_spec(SPEC), time.perf_counter()
        self.source = build_source(spec.source, spec.lens.dispersion)
        spec = spec if automatic else spec.with_levels(levels)
        problem = Problems(settled_symmetry(spec, self.source), self.source, 3.4, None).of(levels)
        self.set_up_s = time.perf_counter() - start
        self.parametrisation, self.merit, self.constraints = problem.parametrisation, problem.merit, problem.constraints
        rng = np.random.default_rng(0)
        size = self.parametrisation.basis.size
        self.weights = torch.from_numpy(rng.normal(size=(size, 2)) * 0.005).requires_grad_()
        self.offsets = torch.ones(2, dtype=torch.float64, requires_grad=True)
        self.rays = rays
        self.bundle = self.source.sample(rays, 0)

    def sample(self) -> None:
        self.source.sample(self.rays, 0)

    def tables(self) -> None:
        inner, outer = self.parametrisation.tables(self.weights, self.offsets)
        (inner.sum() + outer.sum()).backward()

    def forward(self) -> None:
        with torch.no_grad():
            self.evaluate()

    def evaluate(self) -> torch.Tensor:
        return self.merit.step_loss(self.weights, self.offsets, self.bundle, self.constraints, False).loss

    def gradient(self) -> None:
        self.evaluate().backward()

    def processor_seconds(self) -> float:
        """Processor time of a step with fresh rays, on all threads."""
        start = time.process_time()
        self.bundle = self.source.sample(self.rays, 0)
        self.gradient()
        return time.process_time() - start

    def with_fresh_rays(self, repeat: int) -> list[float]:
        """Seconds of ``repeat`` steps of a search, which draws the next rays while it traces these."""
        times, start = [], 0.0
        for bundle in rays_ahead(self.source, self.rays, range(repeat + 2)):
            self.bundle = bundle
            times.append(time.perf_counter() - start)
            start = time.perf_counter()
            self.gradient()
        return times[2:]


def times_the_cost(other: Step, step: Step, rounds: int) -> float:
    """Ratio of the medians, measured alternately: other load of the machine affects both alike."""
    seconds: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for each, times in zip((other, step), seconds, strict=True):
            times += each.with_fresh_rays(3)
    return statistics.median(seconds[0]) / statistics.median(seconds[1])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rays", type=int, default=2**19)
    parser.add_argument("--repeat", type=int, default=7)
    options = parser.parse_args()
    step = Step(options.rays)
    functions = 2 * step.parametrisation.basis.size
    print(f"{options.rays} rays, {functions} SRBFs, 64 x 64 pixels, {torch.get_num_threads()} threads, float64")
    parts = {
        name: median_seconds(getattr(step, name), options.repeat)
        for name in ("sample", "tables", "forward", "gradient")
    }
    for name, seconds in parts.items():
        print(f"{name:10s} {1e3 * seconds:8.1f} ms")
    print(f"{'rays/s':10s} {options.rays / parts['gradient']:8.3g}  forward and gradient")
    print(f"{'memory':10s} {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:8.2f} GiB peak so far")
    print(f"{'whole':10s} {1e3 * statistics.median(step.with_fresh_rays(options.repeat)):8.1f} ms, with fresh rays")
    ratio = times_the_cost(step, Step(options.rays // 4), options.repeat)
    print(f"{'rays':10s} {ratio:8.2f}  times the cost for 4 times the rays")
    larger = Step(options.rays, MANY)
    ratio = times_the_cost(larger, step, options.repeat)
    print(f"{'functions':10s} {ratio:8.2f}  times the cost for {2 * larger.parametrisation.basis.size} functions")
    by_patches(2**16, options.repeat)
    ratio, triangles = beside_a_body(2**16, options.repeat)
    print(f"{'body':10s} {ratio:8.2f}  times the cost beside a body of {triangles} triangles")
    for surface in ("diffuse", "mirror"):
        print(
            f"{'tube':10s} {in_a_tube(surface, 2**16, options.repeat):8.2f}  times the cost in a black tube: {surface}"
        )
    print(f"{'chain':10s} {chain_to_double(2**16, options.repeat):8.2f}  times the cost of the flat top at equal rays")
    for name, face, levels in FROSTED:
        ratio = frosted_to_polished(name, face, levels, options.repeat)
        print(f"{'frosted':10s} {ratio:8.2f}  times the cost of a step of {name} with its {face} polished")
    print(f"{'single':10s} {single_to_double(2**16, options.repeat):8.2f}  times the cost in double precision")


def traced_and_back(tables: Tables, scene: Scene, rays: RayBundle) -> float:
    """Processor time of one trace and its adjoint, in which every ray has a random say."""
    rng, count = np.random.default_rng(0), len(rays)
    by = Sensitivities(rng.normal(size=(count, 3)), rng.normal(size=(count, 3)))
    by_flux, by_sin2 = rng.normal(size=(2, count))
    start = time.process_time()
    TracedBundle.of(tables, scene, rays).gradients(by, by_flux, by_sin2)
    return time.process_time() - start


def beside_a_body(rays: int, repeat: int) -> tuple[float, int]:
    """Cost of a step of ``bezel`` whose bezel is a file of many triangles over that of one without it; their number."""
    spec = load_spec(BEZEL).replace({"lens.symmetry": "none"})
    (bezel,) = spec.scene
    ring = trimesh.creation.annulus(bezel.bore_radius_mm, bezel.radius_mm, bezel.length_mm, sections=98)
    while len(ring.faces) < 50_000:
        ring = ring.subdivide()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bezel.stl"
        ring.export(file)
        body = HousingFile(name=bezel.name, file=file, centre_mm=bezel.centre_mm)
        steps = [Step(rays, spec=spec.replace(scene=scene)) for scene in ([body], [])]
        times = [[step.processor_seconds() for step in steps] for _ in range(repeat + 1)][1:]
        return statistics.median(one / other for one, other in times), len(ring.faces)


def in_a_tube(surface: str, rays: int, repeat: int) -> float:
    """Cost of a step of ``bezel`` in a tube around all of its beam that reflects, over that in a black one."""
    spec = load_spec(BEZEL).replace({"lens.symmetry": "none"})
    tube = {"kind": "cylinder", "name": "tube", "bore_radius_mm": 26.0, "radius_mm": 28.0, "length_mm": 100.0}
    tubes = [
        {**tube, "centre_mm": [0.0, 0.0, 70.0], **finish} for finish in ({"surface": surface, "reflectance": 0.8}, {})
    ]
    steps = [Step(rays, spec=spec.replace(scene=[body])) for body in tubes]
    times = [[step.processor_seconds() for step in steps] for _ in range(repeat + 1)][1:]
    return statistics.median(reflecting / black for reflecting, black in times)


def chain_to_double(rays: int, repeat: int) -> float:
    """Trace and adjoint of the start of ``spot``, four faces, over those of the flat top, in turns."""
    spec = load_spec(CHAIN)
    source, flat = build_source(spec.source, spec.lens.dispersion), Step(rays)
    problem = Problems(settled_symmetry(spec.with_levels(()), source), source, 3.4, None).of(())
    with torch.no_grad():
        chain = problem.parametrisation.tables(*problem.parametrisation.start()).numpy()
        double = np.stack([table.numpy() for table in flat.parametrisation.tables(flat.weights, flat.offsets)])
    cases = (
        (chain, problem.merit.light.scene, source.sample(rays, 0)),
        (double, flat.merit.light.scene, flat.bundle),
    )
    times = [[traced_and_back(*case) for case in cases] for _ in range(repeat + 1)][1:]
    return statistics.median(one / other for one, other in times)


def frosted_to_polished(name: str, face: str, levels: tuple[int, ...], repeat: int) -> float:
    """Processor time of a whole step with fresh rays, 2^16 of them, with a frosted face over that without, in turns."""
    scatter = {f"lens.{face}.scatter": {"kind": "gaussian", "sigma_deg": 3.0}}
    steps = [whole_step(name, change, levels, 2**16) for change in (scatter, {})]
    times = [[processor_seconds(step) for step in steps] for _ in range(repeat + 1)][1:]
    return statistics.median(one / other for one, other in times)


def whole_step(name: str, change: dict[str, object], levels: tuple[int, ...], rays: int) -> Callable[[], None]:
    """A step of the search of a changed example, from its start."""
    spec = load_spec(SPEC.parent / f"{name}.toml").replace(change)
    source = build_source(spec.source, spec.lens.dispersion, facets=len(change))
    spec = spec.with_levels(levels)
    problem = Problems(settled_symmetry(spec, source), source, 3.4, None).of(levels)
    start = [values.detach().requires_grad_() for values in problem.parametrisation.start()]

    def step() -> None:
        loss = problem.merit.step_loss(*start, source.sample(rays, 0), problem.constraints, False).loss
        loss.backward()

    return step


def processor_seconds(work: Callable[[], None]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def single_to_double(rays: int, repeat: int) -> float:
    """Trace and adjoint of the flat top in single precision over those in double, in turns."""
    step = Step(rays)
    with torch.no_grad():
        tables = np.stack([table.numpy() for table in step.parametrisation.tables(step.weights, step.offsets)])
    scenes = [replace(step.merit.light.scene, single=single) for single in (True, False)]
    times = [[traced_and_back(tables, scene, step.bundle) for scene in scenes] for _ in range(repeat + 1)][1:]
    return statistics.median(one / other for one, other in times)


def by_patches(rays: int, repeat: int) -> None:
    """Costs of an automatic search's finest level, by patches as there, and by the maps of given levels."""
    few, maps, patches = Step(rays), Step(rays, AUTOMATIC), Step(rays, AUTOMATIC, automatic=True)
    print(f"{rays} rays a step, {maps.parametrisation.basis.size} functions a surface, by maps and by patches:")
    for name, step in (("maps", maps), ("patches", patches)):
        tables = 1e3 * median_seconds(step.tables, repeat)
        ratio = times_the_cost(step, few, repeat)
        print(
            f"{name:10s} {step.set_up_s:8.2f} s of set-up, {tables:.0f} ms to tables and back, a step "
            f"{ratio:.2f} times the cost of one with {few.parametrisation.basis.size} functions by maps"
        )


if __name__ == "__main__":
    main()
