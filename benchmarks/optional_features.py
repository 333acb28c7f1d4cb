"""Costs of each optional feature when it is on, and its share of the time when it is off.

    python benchmarks/optional_features.py DIR [--rays 262144] [--repeat 5]

DIR is a finished result folder of a spec with a symmetric lens, such as
cad_out/cross. On: processor time of the stage with the feature over that without it, the least of the repeats on
one thread. Off: the share of the profiled time of the same stage that is spent in the feature's own modules.
"""

import lensforge  # before torch, whose idle threads then sleep

# isort: split
import argparse
import cProfile
import pstats
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from lensforge.cad.form_error import fit_to_form
from lensforge.cad.mesh import build_mesh
from lensforge.cad.plan import make_plan
from lensforge.light.simulation import TracedLens, design_landings
from lensforge.optics.face_roles import CAVITY, OUTSIDE
from lensforge.optics.material import MATERIALS
from lensforge.optics.media import CoatingLayer, CoverGlass, FaceCoating, FaceScatter, IndexCurve, LayerStack, Media
from lensforge.optics.scattering import GaussianFacets
from lensforge.proof.casts import stray_light
from lensforge.proof.part_comparison import Expected
from lensforge.proof.proof_inputs import screens_of
from lensforge.proof.verification import FilesOfPart, LightOfDesign, verify_part
from lensforge.report.folder import Run, load
from lensforge.scene.lens import Lens, load_lens
from lensforge.scene.pixel_grid import splat_flux
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.merit import MeritFunction
from lensforge.search.parameters import SphereParameters, chart_mirrors, mirrored_light
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.spec import BaseSection
from lensforge.spec.accuracy import PRESETS

Work = Callable[[], object]


@dataclass(frozen=True)
class Feature:
    """An optional feature, on and off; ``modules``: parts of the names of files used only by it."""

    name: str
    stage: str
    without: Work
    with_it: Work
    modules: tuple[str, ...]


def processor_seconds(work: Work, repeat: int) -> float:
    work()
    times = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def share_of(work: Work, modules: tuple[str, ...]) -> float:
    """Share of the profiled time of ``work`` in files whose names contain one of ``modules``."""
    files = [str(path) for path in Path(lensforge.__file__).parent.rglob("*.py")]
    absent = [part for part in modules if not any(part in file for file in files)]
    if absent:
        raise SystemExit(f"{', '.join(absent)}: no such module; the share would be 0 for its name alone")
    profile = cProfile.Profile()
    profile.runcall(work)
    entries = pstats.Stats(profile).stats.items()  # type: ignore[attr-defined]
    total = sum(entry[2] for _, entry in entries)
    return sum(entry[2] for (file, *_), entry in entries if any(part in file for part in modules)) / total


def light_features(lens: Lens, rays: int) -> Iterator[Feature]:
    traced = TracedLens.of(lens, PRESETS[lens.accuracy].evaluate_nodes_per_sigma)
    source = build_source(lens.spec.source, lens.spec.lens.dispersion)
    bundle = source.sample(rays, 0)
    trace = partial(traced.trace, bundle)
    dark = replace(traced, scene=replace(traced.scene, fresnel=False))
    yield Feature("Fresnel losses", "trace", partial(dark.trace, bundle), trace, ())
    coloured = replace(bundle, wavelengths_nm=np.linspace(450.0, 650.0, rays))
    body = replace(lens.media.body, material=MATERIALS["PMMA"])
    glassy = replace(traced, scene=replace(traced.scene, media=replace(lens.media, body=body)))
    yield Feature("an index for each ray", "trace", trace, partial(glassy.trace, coloured), ("spectrum", "material"))
    for name, media, modules in _media(lens):
        changed = replace(traced, scene=replace(traced.scene, media=media))
        yield Feature(name, "trace", trace, partial(changed.trace, bundle), modules)
        steps = (_step(lens, lens.spec.lens.symmetry, source, bundle, each) for each in (None, media))
        yield Feature(name, "gradient step", *steps, modules)
    measured = RaySetEmitter(bundle, 1.0)
    few = rays // 4
    yield Feature("ray file", "sample", partial(source.sample, few, 1), partial(measured.sample, few, 1), ("ray_set",))
    plain, mirrored = (_step(lens, name, source, bundle) for name in ("none", lens.spec.lens.symmetry))
    yield Feature("symmetry", "gradient step", plain, mirrored, ("symmetry",))


def _media(lens: Lens) -> Iterator[tuple[str, Media, tuple[str, ...]]]:
    """What a lens may be made of, filled with and covered by, and the modules that only it uses."""
    air = lens.media
    yield "absorption", replace(air, body=replace(air.body, absorption_per_mm=0.01)), ()
    yield "gel in the cavity", replace(air, cavity_index=1.41), ()
    frosted = (FaceScatter("outer", GaussianFacets(0.1)),)
    yield "scatter of the outer face", replace(air, scatter=frosted), ("rough_faces",)
    magnesium_fluoride = CoatingLayer(IndexCurve((1.38,)), 100.0)
    layer = LayerStack((magnesium_fluoride,), IndexCurve((air.body.refractive_index,)), (300.0, 2000.0))
    faces = tuple(FaceCoating(face, around, layer) for face, around in (("inner", CAVITY), ("outer", OUTSIDE)))
    yield "coated faces", replace(air, coatings=faces), ("coating",)
    yield "cover glass", replace(air, cover_glass=CoverGlass(1.52, 3.0, 20.0)), ()


def _step(lens: Lens, symmetry: str, source: Source, rays: RayBundle, media: Media | None = None) -> Work:
    spec = lens.spec.model_copy(update={"lens": lens.spec.lens.model_copy(update={"symmetry": symmetry})})
    parametrisation = SphereParameters.of(spec, PRESETS[lens.accuracy].nodes_per_sigma)
    merit = MeritFunction.of(spec, source, parametrisation)
    if media is not None:
        merit = replace(merit, light=replace(merit.light, scene=replace(merit.light.scene, media=media)))
    constraints = AugmentedLagrangian.of(spec, parametrisation.grid)
    weights = torch.zeros(parametrisation.basis.size, 2, dtype=torch.float64, requires_grad=True)
    offsets = torch.ones(2, dtype=torch.float64, requires_grad=True)
    return lambda: merit.evaluate(weights, offsets, rays, constraints, False).loss.backward()


def part_features(lens: Lens, directory: Path) -> Iterator[Feature]:
    inner, outer = fit_to_form(lens.inner), fit_to_form(lens.outer)

    def mesh(base: BaseSection) -> object:
        return build_mesh(make_plan(inner, outer, base), 96)

    yield Feature(
        "base", "mesh", partial(mesh, BaseSection(kind="none")), partial(mesh, lens.spec.base), ("geometry/base",)
    )
    run = load(directory)
    verify = partial(_verify, run, 2**13)

    def with_stray() -> None:
        verify()
        stray_light(run.part, rays=2**11)

    yield Feature("cast through the STEP", "verify", verify, partial(verify, run.part.step), ("brep_cast",))
    yield Feature("stray light, 2048 rays", "verify", verify, with_stray, ("stray", "nonsequential"))


def _verify(run: Run, count: int, step: bytes | None = None) -> None:
    """The verification of ``count`` rays, through the STEP as well where there is one."""
    lens, light = run.lens, run.light
    rays = build_source(lens.spec.source, lens.spec.lens.dispersion).sample(count, 1)
    traced = TracedLens.of(lens, PRESETS[lens.accuracy].evaluate_nodes_per_sigma)
    landed, screen = design_landings(traced, lens.spec, rays)[0], screens_of(lens.spec, light.pixels)[0]
    expected = [Expected(screen, light.map, landed.hits, landed.flux)]
    verify_part(FilesOfPart(run.part.stl, step), LightOfDesign(rays, lens.media, expected))


def noise_of_symmetry(lens: Lens, rays: int, runs: int = 16) -> tuple[float, float]:
    """NMSE of the design's picture by ray noise, as it is and as the mean over its mirror images."""
    traced = TracedLens.of(lens, PRESETS[lens.accuracy].nodes_per_sigma)
    source = build_source(lens.spec.source, lens.spec.lens.dispersion)
    receiver = receivers_of(lens.spec, lens.spec.optimise.pixels)[0]
    mirrors = chart_mirrors(receiver, lens.symmetry) or ()
    images = []
    for k in range(runs):
        landings = receiver.land(traced.trace(source.sample(rays, k)))
        image = splat_flux(landings.hits, landings.flux, receiver.grid)
        images.append(torch.from_numpy(image))
    whole = torch.stack(images)
    mirrored = torch.stack([mirrored_light(image, mirrors) for image in images])
    plain, folded = (float(i.var(dim=0).sum() / (whole.mean(dim=0) ** 2).sum()) for i in (whole, mirrored))
    return plain, folded


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=Path)
    parser.add_argument("--rays", type=int, default=2**18)
    parser.add_argument("--repeat", type=int, default=5)
    given = parser.parse_args()
    torch.set_num_threads(1)
    lens = load_lens(given.directory / "lens.json")
    print("| feature | stage | time with it, over without | share of the stage when off |\n|---|---|---|---|")
    for features in (light_features(lens, given.rays), part_features(lens, given.directory)):
        for one in features:
            ratio = processor_seconds(one.with_it, given.repeat) / processor_seconds(one.without, given.repeat)
            off = f"{100.0 * share_of(one.without, one.modules):.2f} %" if one.modules else "a branch in the kernel"
            print(f"| {one.name} | {one.stage} | {ratio:.3f} | {off} |", flush=True)
    for rays in (2**12, 2**14, 2**16):
        plain, folded = noise_of_symmetry(lens, rays)
        print(f"\nnoise of {rays} rays, NMSE: {plain:.3g}; of the mean over mirror images: {folded:.3g}")
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "lensforge", "--help"], check=True, capture_output=True)
    print(f"\nlensforge --help: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    main()
