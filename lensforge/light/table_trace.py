"""Rays through the tables of all faces of a lens and the optics behind it, and the gradients by the tables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int8

from lensforge.errors import InputError
from lensforge.kernels.bicubic import FaceBounds, SurfaceBounds, TableSpacing, surface_bounds
from lensforge.kernels.face_records import FaceMedia
from lensforge.kernels.nearly_convex import chain_bounds
from lensforge.kernels.parallel import in_parallel_map
from lensforge.kernels.precision import DOUBLE_PRECISION, SINGLE_PRECISION, Precision
from lensforge.kernels.traced_body import ByRaysOut, RaysIn, TracedBody
from lensforge.light.coated_glass import RayCoatings, before_glass, behind_glass
from lensforge.light.passage import BodyPassage
from lensforge.light.secondary_optics import TWO_FACES, before_optics, polarised, through_optics
from lensforge.optics.face_roles import DOUBLE
from lensforge.optics.media import Media
from lensforge.optics.pose import FACES_IN_PLACE
from lensforge.optics.scattering import RingScatter
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.scene.made_part import AsMade
from lensforge.scene.rough_faces import Roughness, roughness, wall_numbers
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.lens_section import LensShape
from lensforge.surfaces.bicubic_table import TableGrid

Table = Float[np.ndarray, "side side"]
Tables = Float[np.ndarray, "f side side"]


@dataclass(frozen=True)
class Scene:
    """A body between the tables of its faces: the media, and the tables' grid.

    Without ``fresnel`` all faces let all light through that they do not reflect totally, coated or not. ``made``: where
    the lens is not as designed; None for one that is. ``chain``: the faces where a ray may meet any of them; None for
    a double lens, in which it is refracted at the inner face and then at the outer one. ``single``: whether the usual
    lens is traced in single precision, for a search: its noise is far above the error. ``drawn_half_mm``: of faces that
    are drawn along y half of their length; None for others.
    """

    media: Media
    grid: TableGrid
    fresnel: bool = True
    made: AsMade | None = None
    chain: Chain | None = None
    single: bool = False
    drawn_half_mm: float | None = None

    @staticmethod
    def of_lens(
        shape: LensShape, media: Media, grid: TableGrid, *, fresnel: bool = True, single: bool = False
    ) -> "Scene":
        """The faces of a lens of that ``shape``, as designed."""
        chain = Chain.of_lens(shape)
        return Scene(media, grid, fresnel, chain=chain, single=single, drawn_half_mm=shape.drawn_half_mm)

    @property
    def precision(self) -> Precision:
        """Precision of the kernels. Polarised light is followed in double precision."""
        return SINGLE_PRECISION if self.single and self.sides is None else DOUBLE_PRECISION

    @property
    def sides(self) -> FaceMedia | None:
        """Media on both sides of each face; None for a double lens alone, whose polarisation has a closed form.

        That holds up to its last face, behind which light may be spread by rings.
        """
        if self.chain is not None:
            return self.chain.packed(self.media)
        media = self.media
        spread = any(isinstance(scatter.model, RingScatter) and scatter.face != DOUBLE[-1] for scatter in media.scatter)
        return TWO_FACES.packed(media) if media.bodies or spread or (media.has_rings and media.cover_glass) else None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the faces, in the order of their tables."""
        return DOUBLE if self.chain is None else self.chain.names

    @property
    def events(self) -> int:
        """Largest number of events of a ray."""
        return len(DOUBLE) if self.chain is None else self.chain.events

    def body(self, tables: Tables, bounds: FaceBounds, rough: Roughness, coatings: RayCoatings) -> TracedBody:
        """The lens for the kernels; ``rough``: roughness at its rays."""
        placed = FACES_IN_PLACE if self.made is None else self.made.placed
        in_closed_form = self.made is None and self.sides is None
        return TracedBody(
            tables=tables,
            bounds=bounds,
            grid=TableSpacing(self.grid.origin, 1.0 / self.grid.step, self.drawn_half_mm),
            fresnel=self.fresnel,
            cavity_index=self.media.cavity_index,
            outside_index=self.media.outside_index,
            sides=self.sides,
            films=coatings.for_kernels(self.names),
            placement=None if in_closed_form else placed.packed(),
            slopes=rough.slopes,
            seen=rough.seen,
        )

    def coming(self, rays: RayBundle, rough: Roughness, coatings: RayCoatings) -> RaysIn:
        """Rays of a source for the kernels, with the lens's properties at each ray.

        In row order, as everywhere: for arrays in another order numba would compile another kernel, for seconds.
        """
        medium = self.media.body
        waves = rays.waves
        absorptions = medium.absorption(waves)
        if self.made is not None:
            absorptions = absorptions * self.made.scale  # paths are those in the lens as designed
        return RaysIn(
            np.ascontiguousarray(rays.origins),
            np.ascontiguousarray(rays.directions),
            rays.flux,
            medium.index(waves),
            absorptions,
            coatings.rows,
            rough.noise,
            shifts=rough.shifts,
            keys=rough.keys,
        )


@dataclass(frozen=True)
class TracedBundle:
    """Exit rays of a bundle, and the data for its adjoint.

    ``lens``: the passage through it, ``at_lens`` the rays that leave it. ``optics``: passages through the optics behind
    it, ``before_glass`` the rays behind these. ``exits``: behind the cover glass. All equal without optics and glass.
    """

    tables: Tables
    scene: Scene
    rays: RayBundle
    coatings: RayCoatings
    lens: BodyPassage
    at_lens: ExitRays
    optics: tuple[BodyPassage, ...]
    before_glass: ExitRays
    exits: ExitRays

    @staticmethod
    def of(
        tables: Tables | Iterable[Table], scene: Scene, rays: RayBundle, bounds: FaceBounds | None = None
    ) -> "TracedBundle":
        """Trace ``rays`` through the faces of these tables; see :func:`trace_tables`.

        ``bounds``: of the faces, to share between bundles; computed by default.
        """
        tables = tables if isinstance(tables, np.ndarray) else np.stack(list(tables))
        bounds = face_bounds(tables, scene) if bounds is None else bounds
        media = scene.media
        coatings = RayCoatings.of(rays, scene.media, scene.fresnel)
        rough = roughness(media, scene.names, rays, scene.made)
        lens = BodyPassage.of(
            scene.body(tables, bounds, rough, coatings),
            scene.coming(rays, rough, coatings),
            scene.events,
            axial=scene.fresnel and media.cover_glass is not None,
            fields=bool(media.bodies),
            precision=scene.precision,
        )
        at_lens = _at_lens(lens, scene)
        behind, optics = through_optics(at_lens, media, rays, scene.fresnel)
        exits = replace(behind_glass(behind, media, scene.fresnel, coatings), draws=wall_numbers(rays, media))
        return TracedBundle(tables, scene, rays, coatings, lens, at_lens, optics, behind, exits)

    @property
    def lengths(self) -> Float[np.ndarray, "n e"]:
        """Path (mm) of each ray in the lens to each of its events."""
        return self.lens.ways.lengths

    @property
    def met(self) -> Int8[np.ndarray, "n e"] | None:
        """Code of the face that each ray met there, as in ``kernels.traced_body``; None for a double lens alone."""
        return self.lens.ways.met

    def gradients(
        self, by: Sensitivities, by_flux: Float[np.ndarray, " n"], by_sin2: Float[np.ndarray, " n"]
    ) -> Tables:
        """Gradients by all tables, from sensitivities to the exit rays, their flux and their ``sin2_exit``.

        The flux that a lost ray carried counts as a constant.
        """
        by_points, by_directions = (np.ascontiguousarray(places) for places in (by.by_points, by.by_directions))
        behind = ByRaysOut(by_points, by_directions, by_flux, by_sin2)
        behind = before_glass(self.before_glass, self.scene.media, behind, self.scene.fresnel, self.coatings)
        return self.lens.gradients(before_optics(self.optics, behind))


def _at_lens(lens: BodyPassage, scene: Scene) -> ExitRays:
    out = lens.exits
    met = lens.ways.met
    exits = ExitRays(
        out.points,
        out.directions,
        out.flux,
        out.sin2_exit,
        out.fates,
        absorbed=out.absorbed if len(out.absorbed) == len(out.flux) else None,
        axial=lens.axial,
        met=None if met is None or scene.chain is None else met >> 2,
    )
    return polarised(exits, out.fields) if scene.media.bodies else exits


def checked_bounds(tables: Tables | Sequence[Table], scene: Scene) -> list[SurfaceBounds]:
    """The bounds of all tables. Raises :class:`InputError` when a surface has a radius that is not positive."""
    bounds = in_parallel_map(lambda table: surface_bounds(table, scene.grid.origin, scene.grid.step), list(tables))
    for name, bound in zip(scene.names, bounds, strict=True):
        if not (bound.least > 0.0 and np.isfinite(bound.most) and np.isfinite(bound.tiles).all()):
            raise InputError(f"{name} surface: its radius falls to {bound.least:.3g} mm; it must stay above 0")
    return bounds


def face_bounds(tables: Tables, scene: Scene) -> FaceBounds:
    """The bounds of all tables, with the data for the search among several faces.

    Raises as :func:`checked_bounds`.
    """
    bounds = FaceBounds.of(checked_bounds(tables, scene))
    chain = scene.chain
    if chain is None:
        return bounds
    return chain_bounds(tables, bounds, chain.packed(scene.media).before, scene.grid.origin, scene.grid.step)


def trace_tables(tables: Tables | Iterable[Table], scene: Scene, rays: RayBundle) -> ExitRays:
    """Trace ``rays`` through the faces of these tables (mm).

    Raises :class:`InputError` when a surface has a radius that is not positive.
    """
    return TracedBundle.of(tables, scene, rays).exits
