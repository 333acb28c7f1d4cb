"""Rays through the exported mesh by Mitsuba 3, where installed: its own ray casting and refraction.

The variant that every wheel has knows neither polarisation nor coatings: what the faces transmit is computed from
Mitsuba's directions and normals, as for the other casts.

Mitsuba's scalar variant needs no LLVM and no GPU, and traces about 10,000 rays per second in single precision. Its
meshes are flat facets with interpolated normals, so landings are off by the sag of the curved surface over a facet.
"""

from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from lensforge.errors import refused
from lensforge.optics.media import Media
from lensforge.proof.cast_results import Gaps, MitsubaCast
from lensforge.proof.facet_tilt import Arrival, FaceNumbers, facet_slopes, tilted
from lensforge.proof.optical_faces import OpticalFaces
from lensforge.proof.part_comparison import Expected, compare, drawn, gap_quantiles, share
from lensforge.proof.part_mesh import PartMesh
from lensforge.proof.receiver_screen import nmse
from lensforge.proof.refraction import LitRays
from lensforge.proof.sequential_cast import CastFate, Passage, SurfaceHits, absorb, at_faces, behind_lens, dim, mirrors
from lensforge.sources.ray_bundle import RayBundle

RAYS = 2**16
VARIANT = "scalar_rgb"  # in every wheel, and the only one that runs on any machine


def installed() -> bool:
    """True if Mitsuba 3 is installed; it is not loaded."""
    return find_spec("mitsuba") is not None


def cast_mitsuba(
    part: PartMesh, rays: RayBundle, media: Media, expected: Sequence[Expected], count: int = RAYS
) -> list[tuple[MitsubaCast, Gaps]]:
    """Cast ``count`` of ``rays``, drawn at random, through ``part``; and quantiles of the landing gaps (mm).

    For each screen. ``expected`` holds the design's results for all rays.
    """
    start = perf_counter()
    rows = drawn(count, len(rays))
    some = rays.take(rows)
    version, passage = send_through_mitsuba(part, some, media)
    seconds = perf_counter() - start
    casts = []
    for receiver in expected:
        landed = passage.landed(receiver.screen)
        design = receiver.take(rows)
        screen = receiver.screen
        # The irradiance of the drawn rays is scaled to the flux of all of them.
        flux = landed.flux / share(rays, some.flux)
        design_flux = design.flux / share(rays, some.flux)
        image, off, noise_floor = screen.against(landed.landings, flux, receiver.irradiance)
        cast = MitsubaCast(
            version=version,
            rays=len(rows),
            nmse_vs_design=off,
            noise_floor_nmse=noise_floor,
            nmse_same_rays=nmse(image, screen.irradiance(design.landings, design_flux)),
            against_design=compare(some, landed, design),
            seconds=seconds,
        )
        casts.append((cast, gap_quantiles(landed, design)))
    return casts


def send_through_mitsuba(part: PartMesh, rays: RayBundle, media: Media) -> tuple[str, Passage]:
    """Trace every ray in and out, all hits above z = 0.

    Returns Mitsuba's version, too. A variant that the caller has set is restored. Raises :class:`InputError` where
    Mitsuba does not load.
    """
    with refused("mitsuba", "does not load (…); reinstall it or remove it", ImportError):
        import mitsuba as mi

        before = mi.variant()
        mi.set_variant(VARIANT)
    try:
        caster = _Caster(mi, part, media)
        passage = Passage.of(rays, part.optical.events)
        whole = LitRays.of(rays, media, part.optical.names)
        met: list[list[tuple[int, _Met]]] = [[] for _ in range(part.optical.events)]
        drawn = FaceNumbers(whole.numbers, whole.keys)
        rows = np.arange(len(rays))[:, None]
        index = media.body.indices(rays.waves, len(rays))
        steps = np.column_stack([index / media.cavity_index, index / media.outside_index])
        table = zip(
            part.optical.expansion.to_files(rays.origins).tolist(),
            rays.directions.tolist(),
            steps.tolist(),
            strict=True,
        )
        for row, (origin, direction, indices) in enumerate(table):
            passage.fates[row], end, events = caster.cast(origin, direction, indices, drawn.take(rows[row]))
            if end is not None:
                passage.points[row], passage.directions[row] = end
                if part.optical.opening is not None:
                    passage.met[row, len(events)] = part.optical.opening
            for event, place in zip(met, events, strict=False):
                event.append((row, place))
        for number, event in enumerate(met):
            if not event:
                continue
            passage.met[[row for row, _ in event], number] = [place.face for _, place in event]
            _share(passage, whole, event, part.optical, media)
        return str(mi.__version__), behind_lens(passage, rays, media, part.optical)
    finally:
        if before is not None:
            mi.set_variant(before)


class _Met(NamedTuple):
    """A face hit by a ray: direction, normal, path (mm) in the body so far, and number.

    And True if the face faces away from the origin, if the ray comes from the body, and if it is refracted.
    """

    direction: list[float]
    normal: list[float]
    length: float
    face: int
    away: bool
    inside: bool
    passes: bool


def _share(passage: Passage, whole: LitRays, met: list[tuple[int, _Met]], optical: OpticalFaces, media: Media) -> None:
    """Divide the flux of rays at the faces that they meet at the same event."""
    rows = np.array([row for row, _ in met])
    columns = (np.array(column) for column in zip(*(event for _, event in met), strict=True))
    directions, normals, lengths, faces, away, inside, passes = columns
    absorb(passage, rows, optical.expansion.scale * lengths, whole.absorptions[rows])
    light = replace(whole.take(rows), directions=directions, fields=passage.fields[rows], inside=inside)
    hits = SurfaceHits(passes, directions, normals, inside, away, faces, lengths, lengths)
    dim(passage, rows, at_faces(optical, media.polished, light, hits), passes)  # the normals are those of the facets


class _Caster:
    """Rays one by one through ``part``, by Mitsuba's own casting, refraction and reflection."""

    def __init__(self, mi: Any, part: PartMesh, media: Media) -> None:
        self.mi = mi
        self.faces = part.faces
        self.scene = _scene(mi, part)
        optical = part.optical
        self.mirrors = mirrors(optical, media)
        self.opening = optical.opening
        self.flange = optical.flange
        self.rms = facet_slopes(media, optical.names)
        self.goes_on = [optical.goes_on(event) for event in range(optical.events)]

    def cast(
        self, origin: list[float], direction: list[float], indices: list[float], drawn: FaceNumbers
    ) -> tuple[CastFate, tuple[list[float], list[float]] | None, list[_Met]]:
        """Fate of one ray; its exit point (mm) and direction, None if it is lost; the faces on its way.

        ``indices``: of the body against what fills the cavity, and what surrounds it; ``drawn``: for its facets.
        """
        mi = self.mi
        met = list[_Met]()
        inside = False
        ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
        for event, goes_on in enumerate(self.goes_on):
            hit = self.scene.ray_intersect(ray, mi.RayFlags.All, False, True)
            if not hit.is_valid():
                if self.opening is None or inside or ray.d.z <= 0.0:
                    return CastFate.NO_HIT, None, met
                return CastFate.LANDED, (list(ray.o), list(ray.d)), met
            if hit.p.z <= 0.0:
                return CastFate.BASE if inside else CastFate.OPENING, None, met
            frame = self._frame(hit, ray, drawn, [earlier.face for earlier in met])
            local = frame.to_local(-ray.d)  # Mitsuba's directions of light point away from the surface
            away = hit.n.x * hit.p.x + hit.n.y * hit.p.y + hit.n.z * hit.p.z > 0.0  # as ``faces_away``
            if inside and (local.z > 0.0 or not (away or goes_on)):
                return CastFate.BACK_INTO_CAVITY, None, met
            if not inside and (local.z <= 0.0 or away):
                return CastFate.STARTS_OUTSIDE if local.z > 0.0 else CastFate.STARTS_INSIDE, None, met
            face = int(self.faces[hit.prim_index])
            if inside and face == self.flange:
                return CastFate.FLANGE, None, met
            reflectance, cosine, _, ratio = mi.fresnel(local.z, indices[away])
            passes = reflectance < 1.0 and face not in self.mirrors
            length = float(hit.t) if inside else 0.0
            met.append(_Met(list(ray.d), list(frame.n), length, face, away, inside, passes))
            way = mi.refract(local, cosine, ratio) if passes else mi.reflect(local)
            ray = hit.spawn_ray(frame.to_world(way))
            if passes and inside and away:
                return CastFate.LANDED, (list(ray.o), list(ray.d)), met
            if not (goes_on or (passes and not inside and event + 1 < len(self.goes_on))):
                break
            inside = inside != passes
        whole = not passes and face not in self.mirrors
        return CastFate.TOTAL_REFLECTION if whole else CastFate.EVENT_LIMIT, None, met

    def _frame(self, hit: Any, ray: Any, drawn: FaceNumbers, before: list[int]) -> Any:
        """Frame of the facet hit by a ray that has met the faces ``before``."""
        face = int(self.faces[hit.prim_index])
        if face == self.flange or self.rms[face] == 0.0:
            return hit.sh_frame
        met = Arrival(*(np.array([list(vector)]) for vector in (hit.p, hit.sh_frame.n, ray.d)))
        facet = tilted(met, self.rms[[face]], drawn.at(np.array([face]), np.array([before.count(face)])))[0]
        return self.mi.Frame3f(self.mi.Vector3f(facet.tolist() if facet @ met.normals[0] > 0.0 else (-facet).tolist()))


def _scene(mi: Any, part: PartMesh) -> Any:
    """The part as a Mitsuba mesh with vertex normals: facet normals would refract to wrong directions."""
    rows = part.corners
    points = np.empty((len(part.fit.fitted), 3))
    points[rows.ravel()] = part.mesh.vertices[part.mesh.faces.ravel()]
    mesh = mi.Mesh("lens", len(points), len(rows), has_vertex_normals=True)
    content = mi.traverse(mesh)
    content["vertex_positions"] = points.ravel().astype(np.float32)
    content["vertex_normals"] = part.fit.fitted.ravel().astype(np.float32)
    content["faces"] = rows.ravel().astype(np.uint32)
    content.update()
    return mi.load_dict({"type": "scene", "lens": mesh})
