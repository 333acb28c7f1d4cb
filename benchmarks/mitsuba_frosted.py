"""Frosted faces against Mitsuba 3's `roughdielectric` (Beckmann) of the same rms slope: a flat plate, and a lens.

    pip install lensforge[mitsuba]
    python benchmarks/mitsuba_frosted.py [--rays 262144] [--spec quickstart] [--sigma 3]

Mitsuba draws facets, refracts and takes off what they reflect. Beside that, by Walter et al. (2007), a facet counts by
the area that the light sees of it, and less where others hide it: both are 1 for us. So its light is compared as it is,
and without these weights. "chi": root mean square of the differences over their standard errors, 1 where both are the
same; "shift": distance of the mean directions, or places, over the rms width of the light.
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np

from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.proof.mitsuba_cast import _scene
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

EXAMPLES = Path(__file__).parents[1] / "examples"
GRID, BINS, OURS = TableGrid(161), 8, 8  # bins along each axis; times as many rays of ours


class Spread(NamedTuple):
    """Light in two coordinates, with its flux: none where it is turned back or lost."""

    places: np.ndarray
    flux: np.ndarray

    def against(self, other: "Spread") -> str:
        """Differences from ``other`` over bins of equal light along each axis."""
        lit = other.flux > 0.0
        edges = [np.quantile(other.places[lit, axis], np.linspace(0.0, 1.0, BINS + 1)[1:-1]) for axis in (0, 1)]
        (own, own_error), (found, error) = (each._in(edges) for each in (self, other))
        chi = float(np.sqrt(np.mean((own - found) ** 2 / (own_error**2 + error**2))))
        width = np.sqrt(np.sum(np.average((other.places - other._mean) ** 2, axis=0, weights=other.flux)))
        away = np.linalg.norm(self._mean - other._mean) / width
        return f"flux {self.flux.mean():.5f} / {other.flux.mean():.5f}, chi {chi:.2f}, shift {away:.4f}"

    @property
    def _mean(self) -> np.ndarray:
        return np.asarray(np.average(self.places, axis=0, weights=self.flux))

    def _in(self, edges: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        x, y = (np.searchsorted(edge, self.places[:, axis]) for axis, edge in enumerate(edges))
        sums = [np.bincount(BINS * y + x, self.flux**power, BINS**2) / len(self.flux) for power in (1, 2)]
        return sums[0], np.sqrt((sums[1] - sums[0] ** 2) / len(self.flux))


class RoughFace:
    """A face with the rms ``slope`` between ``inside`` and air; of a slope of 0 polished."""

    def __init__(self, slope: float, inside: float) -> None:
        content: dict[str, Any] = {"type": "dielectric", "int_ior": inside, "ext_ior": 1.0}
        if slope > 0.0:
            content |= {"type": "roughdielectric", "distribution": "beckmann", "alpha": float(np.sqrt(2.0) * slope)}
            content["sample_visible"] = False  # facets as they lie; what light sees of them is in the weight
        self.bsdf, self.slope, self.inside = mi.load_dict(content), slope, inside
        self.context = mi.BSDFContext(mi.TransportMode.Importance)
        self.context.type_mask = mi.BSDFFlags.Transmission

    def passed(self, hit: Any, rng: np.random.Generator) -> tuple[Any, float, float]:
        """Local direction behind the face, the share that passes, and the same without what light sees of facets."""
        found, weight = self.bsdf.sample(self.context, hit, rng.random(), mi.Point2f(rng.random(), rng.random()))
        share = float(weight[0])
        if self.slope == 0.0 or share == 0.0:
            return found.wo, share, share
        eta = self.inside if hit.wi.z > 0.0 else 1.0 / self.inside
        normal = np.array(hit.wi) + eta * np.array(found.wo)  # of the facet: Walter et al., eq. 16
        normal /= np.linalg.norm(normal) * np.sign(normal[2])
        reflected = float(mi.fresnel(float(np.array(hit.wi) @ normal), self.inside)[0])
        wider = 1.2 - 0.2 * np.sqrt(abs(hit.wi.z))  # by which Mitsuba draws slopes, which the weight takes back
        squared = 0.5 * (normal[2] ** -2 - 1.0) / self.slope**2
        return found.wo, share, (1.0 - reflected) * wider**2 * np.exp(-squared * (1.0 - wider**-2))


def plate(sigma_deg: float, angle_deg: float, rays: int) -> Iterator[tuple[str, Spread, Spread]]:
    """Light that leaves a plate by its frosted face; by direction cosines along the face. A sphere that is met at one
    place stands for the plate."""
    spec = lf.load_spec(EXAMPLES / "quickstart.toml")
    index = spec.lens.refractive_index
    frosted = {"lens.cavity_index": index, "lens.outer.scatter": {"kind": "gaussian", "sigma_deg": sigma_deg}}
    media, turn = spec.replace(frosted).media, np.radians(angle_deg)
    (face,) = media.scatter
    rng, count = np.random.default_rng(1), OURS * rays
    origins, ways = np.tile([3.0 * np.sin(turn), 0.0, 0.1], (count, 1)), np.tile([0.0, 0.0, 1.0], (count, 1))
    bundle = RayBundle(origins, ways, np.ones(count), facets=rng.random((count, 2)))
    tables = np.stack([tabulate(GRID, sphere(radius)) for radius in (2.0, 3.0)])
    exits = TracedBundle.of(tables, Scene(media, GRID), bundle).exits
    along = np.array([[np.cos(turn), 0.0, -np.sin(turn)], [0.0, 1.0, 0.0]])  # of the face, where it is met
    ours = Spread(exits.directions @ along.T, np.where(exits.left_lens, exits.flux, 0.0))
    rough, hit = RoughFace(face.model.slope, index), mi.SurfaceInteraction3f()
    hit.wi = mi.Vector3f(np.sin(turn), 0.0, -np.cos(turn))  # where light comes from
    every = [rough.passed(hit, rng) for _ in range(rays)]
    places = np.array([[-way[0], way[1]] if share > 0.0 else [0.0, 0.0] for way, share, _ in every])
    places[:, 0] *= -1.0 if places[:, 0].mean() * ours._mean[0] < 0.0 else 1.0
    for number, words in ((1, "as it is"), (2, "without weights")):
        yield words, ours, Spread(places, np.array([each[number] for each in every]))


def through_lens(name: str, sigma_deg: float, rays: int) -> Iterator[tuple[str, Spread, Spread]]:
    """Light of a draft with a frosted outer face on its receiver: through its tables, and by Mitsuba by its mesh."""
    spec = lf.load_spec(EXAMPLES / f"{name}.toml")
    polished = lf.design(spec, accuracy="draft").lens
    lens = replace(polished, spec=spec.replace({"lens.outer.scatter": {"kind": "gaussian", "sigma_deg": sigma_deg}}))
    source, receiver = build_source(lens.spec.source, facets=1), receivers_of(lens.spec, 64)[0]
    traced = TracedLens.of(lens, PRESETS["draft"].evaluate_nodes_per_sigma)
    ours = _landed(receiver, traced.trace(source.sample(OURS * rays, 1)), OURS * rays)
    part = read_part_mesh(lf.build(polished).stl)
    scene, rng, bundle = _scene(mi, part), np.random.default_rng(2), source.sample(rays, 2)
    faces = [RoughFace(slope, spec.lens.refractive_index) for slope in (0.0, lens.media.scatter[0].model.slope)]
    points, ways, shares = np.zeros((rays, 3)), np.tile([0.0, 0.0, 1.0], (rays, 1)), np.zeros((rays, 2))
    for row, (origin, way) in enumerate(zip(bundle.origins.tolist(), bundle.directions.tolist(), strict=True)):
        ray, share = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(way)), np.ones(2)
        for face in faces:
            hit = scene.ray_intersect(ray, mi.RayFlags.All, False, True)
            if not hit.is_valid() or hit.p.z <= 0.0:
                share[:] = 0.0
                break
            hit.wi = hit.sh_frame.to_local(-ray.d)
            behind, *passed = face.passed(hit, rng)
            ray, share = hit.spawn_ray(hit.sh_frame.to_world(behind)), share * passed
        points[row], ways[row], shares[row] = list(ray.o), list(ray.d), share
    for number, words in enumerate(("as it is", "without weights")):
        exits = replace(traced.trace(bundle), points=points, directions=ways, flux=bundle.flux * shares[:, number])
        exits = replace(exits, fates=np.where(shares[:, 0] > 0.0, 0, exits.fates.max()).astype(np.int8))
        yield words, ours, _landed(receiver, exits, rays)


def _landed(receiver: Any, exits: Any, rays: int) -> Spread:
    landed = receiver.land(exits)
    on = landed.landed & receiver.window.contains(landed.hits)
    return Spread(np.where(on[:, None], landed.hits, 0.0), np.where(on, landed.flux * rays, 0.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=2**18, help="of Mitsuba; eight times as many of lensforge")
    parser.add_argument("--spec", default="quickstart")
    parser.add_argument("--sigma", type=float, default=3.0, help="of the lens, degrees")
    options = parser.parse_args()
    mi.set_variant("scalar_rgb")
    for sigma in (3.0, 8.0):
        for angle in (0.0, 15.0, 30.0):
            for words, ours, theirs in plate(sigma, angle, options.rays):
                print(
                    f"plate, {sigma:g} deg, at {angle:g} deg to its normal, {words}: {ours.against(theirs)}", flush=True
                )
    for words, ours, theirs in through_lens(options.spec, options.sigma, options.rays):
        print(f"{options.spec}, {options.sigma:g} deg, {words}: {ours.against(theirs)}", flush=True)


if __name__ == "__main__":
    main()
