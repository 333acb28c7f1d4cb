"""Rays through two tables by the compiled kernels on all cores, and the gradients with respect to the tables."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.kernels.adjoint import empty_adjoint, trace_adjoint
from lensforge.kernels.bicubic import SurfaceBounds, surface_bounds
from lensforge.kernels.first_hit import empty_packet
from lensforge.kernels.parallel import CHUNKS, in_chunks
from lensforge.kernels.trace import trace
from lensforge.light.coated_glass import RayCoatings, before_glass, behind_glass
from lensforge.optics.media import Media
from lensforge.scene.as_made import AsMade, Placed, Rough, rough_part
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

Table = Float[np.ndarray, "side side"]


@dataclass(frozen=True)
class Scene:
    """The lens body between two tables: the media, and the tables' grid.

    Without ``fresnel`` both surfaces let all light through that they do not reflect totally, coated or not. ``made``:
    where the lens is not as designed; None for one that is.
    """

    media: Media
    grid: TableGrid
    fresnel: bool = True
    made: AsMade | None = None

    def packed(self) -> tuple[bool, float, float, float, float]:
        """The numbers that the kernels take."""
        media, grid = self.media, self.grid
        return self.fresnel, media.cavity_index, media.outside_index, grid.origin, 1.0 / grid.step

    def body(self, rays: RayBundle) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " j"]]:
        """The body's refractive index for each ray where they differ, or one for all; its absorption (1/mm) likewise.

        Nothing where the body is clear.
        """
        indices, absorptions = rays.refractive_indices, rays.absorption_per_mm
        if absorptions is None:
            absorptions = np.full(int(self.media.absorption_per_mm > 0.0), self.media.absorption_per_mm)
        if self.made is not None:
            absorptions = absorptions * self.made.scale  # paths are those in the lens as designed
        return np.array([self.media.refractive_index]) if indices is None else indices, absorptions


def _part(values: Float[np.ndarray, " k"], part: slice) -> Float[np.ndarray, " j"]:
    return values if len(values) <= 1 else values[part]


@dataclass(frozen=True)
class TracedBundle:
    """Exit rays of a bundle, and the data for its adjoint: the tables, and the path lengths to both surfaces (mm).

    ``at_lens``: the rays as they leave the lens; ``exits``: behind the cover glass, the same where there is none.
    ``placed`` and ``rough``: of the lens as made, None for one as designed, or polished.
    """

    inner: Table
    outer: Table
    scene: Scene
    rays: RayBundle
    coatings: RayCoatings
    placed: Placed | None
    rough: Rough | None
    lengths: Float[np.ndarray, "n 2"]
    at_lens: ExitRays
    exits: ExitRays

    @staticmethod
    def of(inner: Table, outer: Table, scene: Scene, rays: RayBundle) -> "TracedBundle":
        """Trace ``rays`` through two tables; see :func:`trace_tables`."""
        bounds = checked_bounds(inner, outer, scene)
        tables = inner, outer
        count, (indices, absorptions) = len(rays), scene.body(rays)
        points, directions = np.zeros((count, 3)), np.zeros((count, 3))
        coatings = RayCoatings.of(rays, scene.media, scene.fresnel)
        faces = coatings.for_kernels
        placed = None if scene.made is None else scene.made.placed
        rough = None if scene.made is None else scene.made.rough(count)
        lengths, fates = np.empty((count, 2)), np.empty(count, dtype=np.int8)
        flux, sin2_exit = np.empty(count), np.empty(count)
        absorbed = np.zeros(count if len(absorptions) else 0)
        axial = np.zeros(count) if scene.fresnel and scene.media.cover_glass else None

        def work(_: int, part: slice) -> None:
            trace(
                rays.origins[part], rays.directions[part], rays.flux[part],
                _part(indices, part), _part(absorptions, part), *tables, *bounds, scene.packed(),
                *faces, coatings.part(part), placed, rough_part(rough, part),
                lengths[part], points[part], directions[part], flux[part], absorbed[part],
                None if axial is None else axial[part], sin2_exit[part], fates[part], empty_packet(),
            )  # fmt: skip

        in_chunks(work, count)
        taken = absorbed if len(absorptions) else None
        exits = ExitRays(points, directions, flux, sin2_exit, fates, absorbed=taken, axial=axial)
        behind = behind_glass(exits, scene.media, scene.fresnel, coatings)
        return TracedBundle(*tables, scene, rays, coatings, placed, rough, lengths, exits, behind)

    def gradients(
        self, by: Sensitivities, by_flux: Float[np.ndarray, " n"], by_sin2: Float[np.ndarray, " n"]
    ) -> tuple[Table, Table]:
        """Gradients by both tables, from sensitivities to the exit rays, their flux and their ``sin2_exit``.

        The flux that a lost ray carried counts as a constant.
        """
        rays, fates, (indices, absorptions) = self.rays, self.exits.fates, self.scene.body(self.rays)
        coatings, faces = self.coatings, self.coatings.for_kernels
        by, by_flux, by_axial = before_glass(self.at_lens, self.scene.media, by, by_flux, self.scene.fresnel, coatings)
        totals = np.zeros((2, CHUNKS, *self.inner.shape))

        def work(chunk: int, part: slice) -> None:
            trace_adjoint(
                rays.origins[part], rays.directions[part], rays.flux[part],
                _part(indices, part), _part(absorptions, part),
                self.inner, self.outer, self.scene.packed(), *faces, coatings.part(part),
                self.placed, rough_part(self.rough, part), self.lengths[part], fates[part],
                by.by_points[part], by.by_directions[part], by_flux[part],
                None if by_axial is None else by_axial[part], by_sin2[part],
                *totals[:, chunk], empty_adjoint(),
            )  # fmt: skip

        in_chunks(work, len(rays))
        inner, outer = totals.sum(axis=1)
        return inner, outer


def checked_bounds(inner: Table, outer: Table, scene: Scene) -> tuple[SurfaceBounds, SurfaceBounds]:
    """The bounds of both tables. Raises :class:`InputError` when a surface has a radius that is not positive."""
    first, second = (surface_bounds(table, scene.grid.origin, scene.grid.step) for table in (inner, outer))
    for name, bound in (("inner", first), ("outer", second)):
        if not (bound.least > 0.0 and np.isfinite(bound.most) and np.isfinite(bound.tiles).all()):
            raise InputError(f"{name} surface: its radius falls to {bound.least:.3g} mm; it must stay above 0")
    return first, second


def trace_tables(inner: Table, outer: Table, scene: Scene, rays: RayBundle) -> ExitRays:
    """Trace ``rays`` through two tables (mm).

    Raises :class:`InputError` when a surface has a radius that is not positive.
    """
    return TracedBundle.of(inner, outer, scene, rays).exits
