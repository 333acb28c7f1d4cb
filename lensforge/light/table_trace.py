"""Rays through the tables of all faces by the compiled kernels on all cores, and the gradients by the tables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int8

from lensforge.errors import InputError
from lensforge.kernels.adjoint import empty_adjoint, trace_adjoint
from lensforge.kernels.bicubic import FaceBounds, SurfaceBounds, surface_bounds
from lensforge.kernels.chain_adjoint import empty_chain
from lensforge.kernels.nearly_convex import chain_bounds
from lensforge.kernels.parallel import CHUNKS, in_chunks, in_parallel, in_pieces, part_of
from lensforge.kernels.precision import DOUBLE_PRECISION, SINGLE_PRECISION, Precision
from lensforge.kernels.ray_packet import empty_packet
from lensforge.kernels.trace import trace
from lensforge.light.coated_glass import RayCoatings, before_glass, behind_glass
from lensforge.light.further_bodies import TWO_FACES, BodyPassage, fields_of_two_faces, polarised, through_bodies
from lensforge.optics.media import DOUBLE, Media
from lensforge.scene.as_made import AsMade, Placed, Rough, rough_part
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

Table = Float[np.ndarray, "side side"]
Tables = Float[np.ndarray, "f side side"]

_WORTH_SHARING = 2**11  # rays: a millisecond of work


@dataclass(frozen=True)
class Scene:
    """A body between the tables of its faces: the media, and the tables' grid.

    Without ``fresnel`` all faces let all light through that they do not reflect totally, coated or not. ``made``: where
    the lens is not as designed; None for one that is. ``chain``: the faces where a ray may meet any of them; None for
    the usual lens, in which it is refracted at the inner face and then at the outer one. ``single``: whether the usual
    lens is traced in single precision, for a search: its noise is far above the error.
    """

    media: Media
    grid: TableGrid
    fresnel: bool = True
    made: AsMade | None = None
    chain: Chain | None = None
    single: bool = False

    @property
    def precision(self) -> Precision:
        """Precision of the kernels. Events of a chain go ray by ray: there single precision would gain little."""
        return SINGLE_PRECISION if self.single and self.traced_chain is None else DOUBLE_PRECISION

    @property
    def traced_chain(self) -> Chain | None:
        """The chain by which rays are traced; before further bodies the usual lens is one, for its polarisation.

        As it was made it is none: its faces then have frames of their own.
        """
        return TWO_FACES if self.chain is None and self.media.bodies and self.made is None else self.chain

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the faces, in the order of their tables."""
        return DOUBLE if self.chain is None else self.chain.names

    @property
    def events(self) -> int:
        """Largest number of events of a ray."""
        return len(DOUBLE) if self.chain is None else self.chain.events

    def packed(self) -> tuple[bool, float, float, float, float]:
        """The numbers that the kernels take."""
        media, grid = self.media, self.grid
        return self.fresnel, media.cavity_index, media.outside_index, grid.origin, 1.0 / grid.step

    def body(self, rays: RayBundle) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " j"]]:
        """The body's refractive index for each ray where they differ, or one for all; its absorption (1/mm) likewise.

        Nothing where the body is clear.
        """
        body, waves = self.media.body, rays.wavelengths_nm
        absorptions = body.absorption(waves)
        if self.made is not None:
            absorptions = absorptions * self.made.scale  # paths are those in the lens as designed
        return body.index(waves), absorptions


@dataclass(frozen=True)
class TracedBundle:
    """Exit rays of a bundle, and the data for its adjoint: the tables, and the path lengths to all events (mm).

    ``at_lens``: the rays as they leave the lens; ``exits``: behind the cover glass or the further bodies, the same
    where there are none; ``passages``: through each of the bodies.
    ``body``: its indices and absorptions, as :meth:`Scene.body` answers them. ``placed`` and ``rough``: of the lens as
    made, None for one as designed, or polished. ``met``: the face of each event as in ``kernels.chain``; None for the
    usual lens.
    """

    tables: Tables
    scene: Scene
    rays: RayBundle
    body: tuple[Float[np.ndarray, " k"], Float[np.ndarray, " j"]]
    coatings: RayCoatings
    placed: Placed | None
    rough: Rough | None
    lengths: Float[np.ndarray, "n e"]
    met: Int8[np.ndarray, "n e"] | None
    at_lens: ExitRays
    exits: ExitRays
    passages: tuple[BodyPassage, ...] = ()

    @staticmethod
    def of(
        tables: Tables | Iterable[Table], scene: Scene, rays: RayBundle, bounds: FaceBounds | None = None
    ) -> "TracedBundle":
        """Trace ``rays`` through the faces of these tables; see :func:`trace_tables`.

        ``bounds``: of the faces, for several bundles through the same; by default they are computed.
        """
        tables = tables if isinstance(tables, np.ndarray) else np.stack(list(tables))
        bounds = face_bounds(tables, scene) if bounds is None else bounds
        count, body, precision = len(rays), scene.body(rays), scene.precision
        indices, absorptions = body
        points, directions = np.zeros((count, 3)), np.zeros((count, 3))
        coatings = RayCoatings.of(rays, scene.media, scene.fresnel)
        faces = coatings.for_kernels(scene.names)
        placed = None if scene.made is None else scene.made.placed
        rough = None if scene.made is None else scene.made.rough(count)
        chain = None if scene.traced_chain is None else scene.traced_chain.packed(scene.media)
        met = None if chain is None else np.full((count, scene.events), -1, dtype=np.int8)
        lengths, fates = np.empty((count, scene.events)), np.empty(count, dtype=np.int8)
        flux, sin2_exit = np.empty(count), np.empty(count)
        absorbs = len(absorptions) > 0 or (chain is not None and bool((chain[2] > 0.0).any()))  # body, or mirrors
        absorbed = np.zeros(count if absorbs else 0)
        axial = np.zeros(count) if scene.fresnel and scene.media.cover_glass else None
        ended = np.zeros((count, 12)) if scene.media.bodies else None
        run, given = precision.kernel(trace), precision.of((tables, bounds, scene.packed(), faces))

        def work(part: slice) -> None:
            run(
                rays.origins[part], rays.directions[part], rays.flux[part],
                part_of(indices, part), part_of(absorptions, part), *given,
                *precision.of((coatings.part(part), placed, rough_part(rough, part))),
                chain, None, lengths[part], None if met is None else met[part], points[part], directions[part],
                flux[part], absorbed[part], None if axial is None else axial[part], sin2_exit[part], fates[part],
                None if ended is None else ended[part], empty_packet(precision),
            )  # fmt: skip

        in_pieces(work, count, worth=_WORTH_SHARING)
        taken = absorbed if absorbs else None
        faces_met = None if met is None or scene.chain is None else met >> 2
        exits = ExitRays(points, directions, flux, sin2_exit, fates, absorbed=taken, axial=axial, met=faces_met)
        if ended is not None and chain is None and placed is not None:
            ended = fields_of_two_faces(rays, exits, lengths[:, 0], placed, body[0], scene.media, coatings)
        exits = polarised(exits, ended)
        behind = behind_glass(exits, scene.media, scene.fresnel, coatings)
        behind, passages = through_bodies(behind, scene.media, rays, scene.fresnel)
        return TracedBundle(tables, scene, rays, body, coatings, placed, rough, lengths, met, exits, behind, passages)

    def gradients(
        self, by: Sensitivities, by_flux: Float[np.ndarray, " n"], by_sin2: Float[np.ndarray, " n"]
    ) -> Tables:
        """Gradients by all tables, from sensitivities to the exit rays, their flux and their ``sin2_exit``.

        The flux that a lost ray carried counts as a constant. Not of a usual lens as made before further bodies.
        """
        assert self.scene.traced_chain is not None or not self.passages, "a robust search refuses bodies"
        rays, fates, (indices, absorptions) = self.rays, self.at_lens.fates, self.body
        scene, coatings, faces = self.scene, self.coatings, self.coatings.for_kernels(self.scene.names)
        by, by_flux, by_axial = before_glass(self.at_lens, scene.media, by, by_flux, scene.fresnel, coatings)
        by_ended = None
        for passage in reversed(self.passages):
            by, by_flux, by_ended = passage.back(by, by_flux, by_ended)
        chain, met = None if scene.traced_chain is None else scene.traced_chain.packed(scene.media), self.met
        totals, precision = np.zeros((CHUNKS, *self.tables.shape)), scene.precision
        run, given = precision.kernel(trace_adjoint), precision.of((self.tables, scene.packed(), faces))

        def work(chunk: int, part: slice) -> None:
            run(
                rays.origins[part], rays.directions[part], rays.flux[part],
                part_of(indices, part), part_of(absorptions, part), *given,
                *precision.of((coatings.part(part), self.placed, rough_part(self.rough, part))),
                chain, None, self.lengths[part],
                None if met is None else met[part], fates[part],
                by.by_points[part], by.by_directions[part], by_flux[part],
                None if by_axial is None else by_axial[part], by_sin2[part],
                None if by_ended is None else by_ended[part], None,
                totals[chunk], empty_adjoint(precision), empty_chain(scene.events), np.zeros(12),
            )  # fmt: skip

        in_chunks(work, len(rays), worth=_WORTH_SHARING)
        total: Tables = totals.sum(axis=0)
        return total


def checked_bounds(tables: Tables | Sequence[Table], scene: Scene) -> list[SurfaceBounds]:
    """The bounds of all tables. Raises :class:`InputError` when a surface has a radius that is not positive."""
    found = dict[int, SurfaceBounds]()

    def work(face: int) -> None:
        found[face] = surface_bounds(tables[face], scene.grid.origin, scene.grid.step)

    in_parallel(work, len(tables))
    bounds = [found[face] for face in range(len(tables))]
    for name, bound in zip(scene.names, bounds, strict=True):
        if not (bound.least > 0.0 and np.isfinite(bound.most) and np.isfinite(bound.tiles).all()):
            raise InputError(f"{name} surface: its radius falls to {bound.least:.3g} mm; it must stay above 0")
    return bounds


def face_bounds(tables: Tables, scene: Scene) -> FaceBounds:
    """The bounds of all tables together, in a chain with what it needs; raises as :func:`checked_bounds`."""
    bounds = FaceBounds.of(checked_bounds(tables, scene))
    if scene.traced_chain is None:
        return bounds
    return chain_bounds(tables, bounds, scene.traced_chain.packed(scene.media)[0], scene.grid.origin, scene.grid.step)


def trace_tables(tables: Tables | Iterable[Table], scene: Scene, rays: RayBundle) -> ExitRays:
    """Trace ``rays`` through the faces of these tables (mm).

    Raises :class:`InputError` when a surface has a radius that is not positive.
    """
    return TracedBundle.of(tables, scene, rays).exits
