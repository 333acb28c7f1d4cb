"""A third referee: the exported mesh under Mitsuba 3, its ray tracing kernel, its Snell and its Fresnel.

    pip install lensforge[mitsuba]
    python benchmarks/mitsuba_check.py DIR [--rays N]

DIR is a result folder with lens.json, lens.stl and evaluate.npz. Prints JSON; exit code 1 where Mitsuba's irradiance
differs from the design's by more than the noise of so many rays. Mitsuba's LLVM variants need an LLVM library of
version 16 or later: on Debian `apt install libllvm19`, and DRJIT_LIBLLVM_PATH set to its libLLVM-19.so.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from lensforge.accuracy import PRESETS
from lensforge.errors import LensforgeError
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import load_lens
from lensforge.sources.build import build_source
from lensforge.sources.bundle import RayBundle
from lensforge.verification.comparison import Expected, compare
from lensforge.verification.part import Part, load_part
from lensforge.verification.passage import Fate, Passage
from lensforge.verification.picture import Receiver, nmse, squared_norm
from lensforge.verification.verify import NOISE_ALLOWANCE, NOISE_FLOORS

SEED = 2**42  # apart from the seeds of design, evaluation and verification


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=Path)
    parser.add_argument("--rays", type=int, default=2**18)
    given = parser.parse_args()
    try:
        result = check(given.directory, given.rays)
    except ImportError as error:
        print(f"mitsuba_check: {error}; pip install lensforge[mitsuba]", file=sys.stderr)
        return 2
    except LensforgeError as error:
        print(f"mitsuba_check: {error}", file=sys.stderr)
        return 2
    print(json.dumps(result, indent=2))
    return 0 if result["nmse_vs_design"] <= result["nmse_limit"] else 1


def check(directory: Path, count: int) -> dict[str, Any]:
    lens = load_lens(directory / "lens.json")
    target = lens.spec.target
    source = build_source(lens.spec.source)
    rays = source.sample(min(count, source.population or count), SEED)
    scene = mitsuba_scene(load_part(directory / "lens.stl"))
    start = time.perf_counter()
    passage = send_through_mitsuba(scene, rays, lens.refractive_index, target.distance_mm)
    seconds = time.perf_counter() - start
    with np.load(directory / "evaluate.npz") as images:
        designed = images["irradiance"]
    receiver = Receiver(target.receiver_mm, len(designed), lens.spec.evaluate.filter_variance)
    image = receiver.irradiance(passage.landings, passage.flux)
    floor = float(receiver.noise(passage.landings, passage.flux).sum()) / squared_norm(designed)
    arrivals = TracedLens.of(lens, PRESETS[lens.accuracy].judge_nodes_per_sigma).trace(rays)
    hits = np.where(arrivals.arrived.numpy()[:, None], arrivals.hits.numpy(), np.nan)
    agreement = compare(rays, passage, Expected(designed, hits, arrivals.flux.numpy()), target.receiver_mm)
    return {
        "mitsuba": import_mitsuba().__version__,
        "rays": len(rays),
        "seconds": seconds,
        "nmse_vs_design": nmse(image, designed),
        "noise_floor_nmse": floor,
        "nmse_limit": NOISE_FLOORS * floor + NOISE_ALLOWANCE,
        "nmse_same_rays": nmse(image, receiver.irradiance(hits, arrivals.flux.numpy())),
        "deviation_mm": {"rms": agreement.rms, "p99": agreement.p99, "max": agreement.max},
        "flux_deviation": agreement.flux,
        "fate_disagreement_flux": agreement.fates_flux,
        "landed": float(passage.flux[passage.fates == Fate.LANDED].sum() / rays.weights.sum()),
    }


def import_mitsuba() -> Any:
    """Mitsuba in a variant that traces on the CPU, in single precision as all of its wheels do."""
    import mitsuba

    if mitsuba.variant() is None:
        mitsuba.set_variant("llvm_ad_mono")
    return mitsuba


def mitsuba_scene(part: Part) -> Any:
    """The part as a Mitsuba mesh with normals at its vertices: on flat facets light would go astray."""
    mi = import_mitsuba()
    rows = part.corners
    points = np.empty((len(part.fit.normals), 3))
    points[rows.ravel()] = part.mesh.vertices[part.mesh.faces.ravel()]
    mesh = mi.Mesh("lens", len(points), len(rows), has_vertex_normals=True)
    content = mi.traverse(mesh)
    content["vertex_positions"] = mi.Float(points.ravel().astype(np.float32))
    content["vertex_normals"] = mi.Float(part.fit.normals.ravel().astype(np.float32))
    content["faces"] = mi.UInt32(rows.ravel().astype(np.uint32))
    content.update()
    return mi.load_dict({"type": "scene", "lens": mesh})


def send_through_mitsuba(scene: Any, rays: RayBundle, refractive_index: float, distance_mm: float) -> Passage:
    """Every ray in, out, and to the plane z = ``distance_mm``; both hits above z = 0, as the design has it."""
    mi = import_mitsuba()
    start, towards = (mi.Vector3f(np.ascontiguousarray(a.T, np.float32)) for a in (rays.origins, rays.directions))
    ray = mi.Ray3f(mi.Point3f(start), towards)
    alive, flux = mi.Mask(True), mi.Float(rays.weights.astype(np.float32) / float(rays.weights.mean()))
    for entering in (True, False):
        hit = scene.ray_intersect(ray, mi.RayFlags.All, False, alive)
        alive &= hit.is_valid() & (hit.p.z > 0.0)
        incident = -ray.d  # Mitsuba's directions of light point away from the surface
        local = hit.sh_frame.to_local(incident)
        alive &= (local.z > 0.0) if entering else (local.z < 0.0)
        reflectance, cosine, _, ratio = mi.fresnel(local.z, refractive_index)
        flux = flux * (1.0 - reflectance)
        alive &= reflectance < 1.0
        ray = hit.spawn_ray(hit.sh_frame.to_world(mi.refract(local, cosine, ratio)))
    alive &= ray.d.z > 0.0
    length = (distance_mm - ray.o.z) / ray.d.z
    landed = np.array(alive)
    landings = np.stack([np.array(ray.o.x + length * ray.d.x), np.array(ray.o.y + length * ray.d.y)], axis=1)
    return Passage(
        landings=np.where(landed[:, None], landings, np.nan).astype(np.float64),
        flux=np.array(flux, dtype=np.float64) * rays.weights.mean(),
        fates=np.where(landed, Fate.LANDED, Fate.NO_HIT).astype(np.int64),
        facets_um=np.zeros((len(rays), 2)),
    )


if __name__ == "__main__":
    sys.exit(main())
