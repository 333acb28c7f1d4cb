"""Light through the optics behind the lens: the light that leaves one is the source of the next.

Each is a body as the lens is, of two faces that are met in their order, in a place of its own. Light comes to it with
the polarisation that the body before left. Light that a face reflects, that the body absorbs, that goes past it or ends
in it is lost there, and followed no further.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from lensforge.kernels.bicubic import FaceBounds, TableSpacing, surface_bounds
from lensforge.kernels.fate import Fate
from lensforge.kernels.traced_body import ByRaysOut, RaysIn, TracedBody
from lensforge.light.coated_glass import RayCoatings
from lensforge.light.passage import BodyPassage
from lensforge.optics.face_roles import DOUBLE
from lensforge.optics.media import Media, SecondaryOptic
from lensforge.optics.pose import IN_PLACE, FacePoses
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.rough_faces import Roughness, roughness
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, table_error, tabulate

TWO_FACES = Chain(DOUBLE, ("cavity", "body"), ("body", "outside"), 2)
_FEWEST_NODES = 49
_MOST_NODES = 769
_TABLE_ERROR_MM = 1e-6  # a nanometre


@dataclass(frozen=True, eq=False)
class TabledOptic:
    """The tables of both faces of an optic, their grid, the bounds that the kernels take, and its place."""

    tables: Float[np.ndarray, "2 side side"]
    grid: TableGrid
    bounds: FaceBounds
    placement: FacePoses


@lru_cache(maxsize=32)
def tabled(optic: SecondaryOptic) -> TabledOptic:
    """Tables of an optic within a nanometre of its faces, or as fine as tables can be."""
    nodes = _FEWEST_NODES
    faces = (optic.inner, optic.outer)
    while True:
        grid = TableGrid(nodes)
        tables = np.stack([tabulate(grid, face) for face in faces])
        errors = [table_error(grid, table, face) for table, face in zip(tables, faces, strict=True)]
        if max(errors) <= _TABLE_ERROR_MM or 2 * nodes > _MOST_NODES:
            break
        nodes *= 2
    bounds = FaceBounds.of([surface_bounds(table, grid.origin, grid.step) for table in tables])
    return TabledOptic(tables, grid, bounds, FacePoses(optic.pose.inverse, (IN_PLACE,), optic.pose))


def polarised(exits: ExitRays, fields: Float[np.ndarray, "n 12"]) -> ExitRays:
    """``exits`` of a body with their ``fields``."""
    squared = np.sum(fields**2, axis=1)
    carried = np.where(exits.left_lens, 2.0 * exits.flux / np.where(squared > 0.0, squared, 1.0), 0.0)
    return replace(exits, fields=fields, carried=carried)


def through_optics(
    exits: ExitRays, media: Media, rays: RayBundle, fresnel: bool = True
) -> tuple[ExitRays, tuple[BodyPassage, ...]]:
    """The ``exits`` of the lens behind all optics of ``media``, and the passage through each; ``rays``: as emitted.

    Unchanged without optics.
    """
    passages = list[BodyPassage]()
    for number, optic in enumerate(media.bodies):
        rough = roughness(optic.media(media), DOUBLE, rays, before=media.scattering_before(number))
        passage = _passage(optic, exits, media, rays, rough, fresnel)
        passages.append(passage)
        exits = _behind(passage, exits)
    return exits, tuple(passages)


def _passage(
    optic: SecondaryOptic, exits: ExitRays, around: Media, rays: RayBundle, rough: Roughness, fresnel: bool
) -> BodyPassage:
    if exits.fields is None or exits.carried is None:
        raise ValueError("light that comes to an optic has its polarisation")
    media = optic.media(around)
    place = tabled(optic)
    waves = rays.waves
    coatings = RayCoatings.of(replace(rays, flux=exits.carried), media, fresnel, f"body {optic.name!r}: ")
    body = TracedBody(
        tables=place.tables,
        bounds=place.bounds,
        grid=TableSpacing(place.grid.origin, 1.0 / place.grid.step),
        fresnel=fresnel,
        cavity_index=media.cavity_index,
        outside_index=media.outside_index,
        sides=TWO_FACES.packed(media),
        films=coatings.for_kernels(DOUBLE),
        placement=place.placement.packed(),
        slopes=rough.slopes,
        seen=rough.seen,
    )
    medium = media.body
    coming = RaysIn(
        exits.points,
        exits.directions,
        exits.carried,
        medium.index(waves),
        medium.absorption(waves),
        coatings.rows,
        noise=rough.noise,
        fields=exits.fields,
        shifts=rough.shifts,
        keys=rough.keys,
    )
    return BodyPassage.of(body, coming, TWO_FACES.events, exits.fates, axial=exits.axial is not None, fields=True)


def _behind(passage: BodyPassage, before: ExitRays) -> ExitRays:
    out = passage.exits
    left = out.fates == Fate.LEFT_LENS
    flux = np.where(before.left_lens, np.where(left, out.flux, 0.0), before.flux)
    none = np.zeros((0, len(flux))) if before.lost_in_bodies is None else before.lost_in_bodies
    behind = replace(
        before,
        points=out.points,
        directions=out.directions,
        flux=flux,
        fates=out.fates,
        axial=passage.axial,
        lost_in_bodies=np.concatenate([none, (before.flux - flux)[None]]),
    )
    return polarised(behind, out.fields)


def before_optics(passages: Sequence[BodyPassage], by: ByRaysOut) -> ByRaysOut:
    """Sensitivities to the rays behind the lens from those to the rays behind all optics.

    The sensitivity to flux is then contained in that to the fields; that to the exit sine is the lens's alone.
    """
    none = np.zeros(len(by.by_flux))
    for passage in reversed(passages):
        before = passage.back(by._replace(by_sin2=none))
        by = ByRaysOut(before.by_points, before.by_directions, none, by.by_sin2, by_fields=before.by_fields)
    return by
