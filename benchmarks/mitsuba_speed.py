"""Rays per second, forward and gradient, against Mitsuba 3 (LLVM) through meshes whose normals are as good.

    python benchmarks/mitsuba_speed.py [--rays 524288] [--repeat 5] [--single]

``--single``: lensforge traces in single precision, too, as a search does.

Needs the [mitsuba] extra and an LLVM library; DRJIT_LIBLLVM_PATH names one (15 and 16 fail on AVX-512, 19 works).

Both trace the same rays of the flat top through the same two surfaces, refract by Snell, lose flux by Fresnel, land on
the receiver and take the gradient of the same scalar: Mitsuba by the radii of all mesh vertices (its vertex normals
follow them), lensforge by all table coefficients. The measure of accuracy is the normal at fixed directions against the
exact sum: the mesh is the coarsest of a series whose rms error is no larger than the table's. A step of Mitsuba
includes the update of its meshes, as a step of lensforge includes its bounds; the search's own part (loss, constraints,
new rays) is in neither.
"""

import lensforge  # noqa: F401  before torch, whose idle threads then sleep

# isort: split
import argparse
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import torch
from convergence.reference import directions
from convergence.tables import table_normals
from gradient_step import Step, median_seconds

from lensforge.search.light_path import landed_through
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces import surface as chart
from lensforge.surfaces.surface import Surface

MESH_NODES = (64, 128, 256, 384, 512, 640)  # beyond that single precision limits the vertex normals


def rms_angle(found: np.ndarray, surface: Surface) -> float:
    """Rms angle (rad) between unit normals at :func:`directions` and the exact ones."""
    chord = np.linalg.norm(found - surface.normal(directions()), axis=1)
    return float(np.sqrt(np.mean((2.0 * np.arcsin(0.5 * chord)) ** 2)))


class Meshes:
    """Both surfaces as height fields over the chart, vertices along fixed directions, radii free."""

    def __init__(self, surfaces: list[Surface], nodes: int) -> None:
        self.u = chart.to_sphere(chart.grid(nodes)).reshape(-1, 3)
        corner = (np.arange(nodes - 1)[:, None] * nodes + np.arange(nodes - 1)).ravel()
        faces = np.concatenate(
            [
                np.stack([corner, corner + nodes, corner + nodes + 1], axis=1),
                np.stack([corner, corner + nodes + 1, corner + 1], axis=1),
            ]
        )
        self.scenes, self.params, self.radii = [], [], []
        for name, surface in zip(("inner", "outer"), surfaces, strict=True):
            mesh = mi.Mesh(name, len(self.u), len(faces), has_vertex_normals=True)
            params = mi.traverse(mesh)
            params["faces"] = mi.UInt32(faces.ravel().astype(np.uint32))
            radius = mi.Float(surface.radius(self.u))
            params["vertex_positions"] = self.positions(radius)
            params.update()
            scene = mi.load_dict({"type": "scene", name: mesh})
            self.scenes.append(scene)
            self.params.append(mi.traverse(scene))
            self.radii.append(radius)

    def positions(self, radius: Any) -> Any:
        x, y, z = (mi.Float(np.ascontiguousarray(column)) for column in self.u.T)
        return dr.ravel(mi.Point3f(x * radius, y * radius, z * radius))

    def update(self, radii: list[Any]) -> None:
        for params, radius, name in zip(self.params, radii, ("inner", "outer"), strict=True):
            params[f"{name}.vertex_positions"] = self.positions(radius)
            params.update()

    def normal_error(self, surfaces: list[Surface]) -> float:
        u, worst = directions(), 0.0
        for scene, surface in zip(self.scenes, surfaces, strict=True):
            ray = mi.Ray3f(mi.Point3f(0.0), mi.Vector3f(*(mi.Float(np.ascontiguousarray(c)) for c in u.T)))
            worst = max(worst, rms_angle(np.array(scene.ray_intersect(ray).sh_frame.n).T, surface))
        return worst


def mitsuba_step(meshes: Meshes, rays: RayBundle, index: float, distance_mm: float) -> None:
    radii = [mi.Float(radius) for radius in meshes.radii]
    for radius in radii:
        dr.enable_grad(radius)
    meshes.update(radii)
    origin = mi.Point3f(*(mi.Float(np.ascontiguousarray(c)) for c in rays.origins.T))
    direction = mi.Vector3f(*(mi.Float(np.ascontiguousarray(c)) for c in rays.directions.T))
    ray, flux, alive = mi.Ray3f(origin, direction), mi.Float(rays.flux), mi.Bool(True)
    for scene in meshes.scenes:
        hit = scene.ray_intersect(ray, alive)
        local = hit.sh_frame.to_local(-ray.d)
        reflectance, cosine, _, ratio = mi.fresnel(local.z, index)
        alive = alive & hit.is_valid() & (reflectance < 1.0)
        flux = flux * (1.0 - reflectance)
        ray = mi.Ray3f(hit.p, hit.sh_frame.to_world(mi.refract(local, cosine, ratio)))
    along = (distance_mm - ray.o.z) / ray.d.z
    x, y = ray.o.x + along * ray.d.x, ray.o.y + along * ray.d.y
    value = dr.select(alive & (ray.d.z > 0.0), flux * (dr.square(x) + dr.square(y)), 0.0)
    dr.backward(dr.sum(value))
    dr.eval(*(dr.grad(radius) for radius in radii))
    dr.sync_thread()


def lensforge_step(step: Step, tables: torch.Tensor, single: bool) -> None:
    light = step.merit.light
    (landings,), _ = landed_through(tables, replace(light.scene, single=single), step.bundle, light.receivers)
    (landings.flux * (landings.hits**2).sum(dim=1)).sum().backward()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rays", type=int, default=2**19)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--single", action="store_true")
    options = parser.parse_args()
    mi.set_variant("llvm_ad_mono")
    dr.set_thread_count(torch.get_num_threads())

    step = Step(options.rays)
    spec, target = step.merit.spec, step.merit.spec.target
    assert target is not None and target.distance_mm is not None, "the flat top stands on the axis"
    distance_mm = target.distance_mm
    lens = step.parametrisation.lens(step.weights.detach(), step.offsets.detach(), spec, 0, "standard")
    surfaces: list[Surface] = [lens.inner, lens.outer]
    tables = step.parametrisation.tables(step.weights, step.offsets).detach().requires_grad_()
    grid = step.parametrisation.grid
    ours = max(
        rms_angle(table_normals(grid, table.detach().numpy(), directions())[1], surface)
        for table, surface in zip(tables, surfaces, strict=True)
    )
    precision = "single" if options.single else "double"
    print(f"table of {grid.nodes} nodes per side: normals {1e6 * ours:.1f} urad rms, rays in {precision} precision")

    ratios: list[tuple[float, float]] = []
    for nodes in MESH_NODES:
        meshes = Meshes(surfaces, nodes)
        error = meshes.normal_error(surfaces)
        seconds = median_seconds(
            lambda meshes=meshes: mitsuba_step(meshes, step.bundle, lens.refractive_index, distance_mm),
            options.repeat,
        )
        mine = median_seconds(lambda: lensforge_step(step, tables, options.single), options.repeat)
        ratios.append((error, seconds / mine))
        print(
            f"mesh of {nodes} nodes per side: normals {1e6 * error:.1f} urad rms, float32; "
            f"Mitsuba {mi.__version__} {options.rays / seconds:.3g} rays/s, "
            f"lensforge {options.rays / mine:.3g} rays/s, ratio {seconds / mine:.2f}"
        )
    good = [ratio for error, ratio in ratios if error <= ours]
    if good:
        print(f"at equal normal error: {good[0]:.2f} times Mitsuba")
    else:
        error, ratio = min(ratios)
        print(f"no mesh is as good; at the best, {error / ours:.1f} times the table's error: {ratio:.2f} times Mitsuba")


if __name__ == "__main__":
    main()
