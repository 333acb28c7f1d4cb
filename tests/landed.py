"""Rays through a lens and onto a plane: what most tests of the tracers look at, all in torch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from exact_surface import ExactSurface

from lensforge.light.reference_bodies import ReferenceBody
from lensforge.light.reference_hits import TracedFace
from lensforge.light.reference_trace import as_arrays, trace_reference
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import Media
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.made_part import AsMade
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import Landings
from lensforge.scene.receiver_shapes import Plane
from lensforge.search.light_path import landed_through
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class Landed:
    """Exit rays and their landings; ``hits``, ``flux`` and ``sin2_exit`` carry the gradient."""

    exits: ExitRays
    landings: Landings
    sin2_exit: torch.Tensor

    @property
    def hits(self) -> torch.Tensor:
        return self.landings.hits

    @property
    def flux(self) -> torch.Tensor:
        return self.landings.flux

    @property
    def landed(self) -> torch.Tensor:
        return self.landings.landed

    @property
    def missed_receiver(self) -> torch.Tensor:
        return self.landings.missed_receiver

    @property
    def fates(self) -> torch.Tensor:
        return self.exits.fates

    @property
    def carried(self) -> torch.Tensor:
        """Flux (W) that reached the last surface met, without a gradient where the kernels traced."""
        return self.exits.flux

    def mixed(self, distance: float) -> torch.Tensor:
        """A scalar in which every output has a random say; far hits have a bounded one."""
        by_hits, by_flux, by_sin2 = torch.from_numpy(np.random.default_rng(2).normal(size=(3, len(self.fates))))
        hits = torch.tanh(self.hits[self.landed] / distance) * by_hits[self.landed, None]
        return hits.sum() + (100.0 * by_flux * self.flux).sum() + (by_sin2 * self.sin2_exit).sum()


def plane_at(distance: float) -> Plane:
    return Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance)), PixelGrid.square(2.0 * distance, 16))


def as_tensors(exits: ExitRays) -> ExitRays:
    """The same rays as tensors on the CPU; what the scene has not is None, and stays so."""
    arrays = (getattr(exits, field.name) for field in fields(exits))
    return ExitRays(*(None if array is None else torch.as_tensor(array).cpu() for array in arrays))


def trace_bundle(tables: list[torch.Tensor], scene: Scene, rays: RayBundle) -> TracedBundle:
    """By the kernels, in NumPy."""
    return TracedBundle.of([table.detach().numpy() for table in tables], scene, rays)


def trace_tables(tables: list[torch.Tensor], scene: Scene, rays: RayBundle) -> ExitRays:
    """By the kernels, without a gradient."""
    return as_tensors(trace_bundle(tables, scene, rays).exits)


def trace_exact(
    inner: ExactSurface | TracedFace,
    outer: ExactSurface | TracedFace,
    media: Media,
    rays: RayBundle,
    made: AsMade | None = None,
) -> ExitRays:
    """Through two surfaces that take tensors, differentiable in what these are differentiable in."""
    faces = tuple(face if isinstance(face, TracedFace) else face.face() for face in (inner, outer))
    return trace_reference(ReferenceBody.of_lens(faces, Scene(media, TableGrid(24), made=made)), rays)


def on_device(
    tables: Sequence[torch.Tensor] | torch.Tensor, scene: Scene, rays: RayBundle, device: str = "cpu"
) -> ExitRays:
    """Through tables by the reference tracer on ``device``, differentiable in them; copied back."""
    there = torch.device(device)
    bodies = ReferenceBody.by_tables(torch.stack(list(tables)), scene, there)
    return as_tensors(trace_reference(bodies, rays, scene.fresnel, there))


def exactly(surfaces: Mapping[str, Surface], scene: Scene, rays: RayBundle) -> ExitRays:
    """Through surfaces themselves, by name, in NumPy."""
    return as_arrays(trace_reference(ReferenceBody.exact(surfaces, scene), rays, scene.fresnel))


def by_kernels(tables: list[torch.Tensor], scene: Scene, rays: RayBundle, distance: float) -> Landed:
    """Through two tables, differentiable in them."""
    (landings,), exits = landed_through(torch.stack(list(tables)), scene, rays, (plane_at(distance),))
    return Landed(trace_tables(tables, scene, rays), landings, exits.sin2_exit)


def in_torch(exits: ExitRays, distance: float) -> Landed:
    """Of rays that a tracer in torch has followed."""
    return Landed(exits, plane_at(distance).land_by_arrays(exits), exits.sin2_exit)
