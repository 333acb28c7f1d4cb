"""Rays through the exported mesh by Mitsuba 3, where installed: its own ray casting and refraction.

The variant that every wheel has knows neither polarisation nor coatings: what the faces transmit is computed from
Mitsuba's directions and normals, as for the other casts.

Mitsuba's scalar variant needs no LLVM and no GPU, and traces about 10,000 rays per second in single precision. Its
meshes are flat facets with interpolated normals, so landings are off by the sag of the curved surface over a facet.
"""

from collections.abc import Sequence
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.media import Media
from lensforge.proof.part_comparison import Expected, compare, drawn, gap_quantiles, share
from lensforge.proof.part_mesh import PartMesh
from lensforge.proof.proof_result import Gaps, MitsubaCast
from lensforge.proof.receiver_screen import nmse, squared_norm
from lensforge.proof.refraction import AtFace, RefractingFace
from lensforge.proof.sequential_cast import CastFate, LandedRays, Passage, absorb, behind_glass
from lensforge.sources.ray_bundle import RayBundle

RAYS = 2**16
VARIANT = "scalar_rgb"  # in every wheel, and the only one that runs on any machine


def installed() -> bool:
    """True where Mitsuba 3 is installed; it is not loaded."""
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
    seconds, found = perf_counter() - start, []
    for each in expected:
        landed, design, screen = LandedRays.of(passage, each.screen), each.take(rows), each.screen
        # The irradiance of the drawn rays is scaled to the flux of all of them.
        flux, design_flux = landed.flux / share(rays, some.flux), design.flux / share(rays, some.flux)
        image = screen.irradiance(landed.landings, flux)
        variance = screen.noise(landed.landings, flux)
        cast = MitsubaCast(
            version=version,
            rays=len(rows),
            nmse_vs_design=nmse(image, each.irradiance),
            noise_floor_nmse=float(variance.sum()) / squared_norm(each.irradiance),
            nmse_same_rays=nmse(image, screen.irradiance(design.landings, design_flux)),
            against_design=compare(some, landed, design),
            seconds=seconds,
        )
        found.append((cast, gap_quantiles(landed, design)))
    return found


def send_through_mitsuba(part: PartMesh, rays: RayBundle, media: Media) -> tuple[str, Passage]:
    """Trace every ray in and out, both hits above z = 0.

    Returns Mitsuba's version, too. A variant that the caller has set is restored. Raises :class:`InputError` where
    Mitsuba does not load.
    """
    try:
        import mitsuba as mi

        before = mi.variant()
        mi.set_variant(VARIANT)
    except ImportError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"mitsuba: does not load ({reason}); reinstall it or remove it") from None
    try:
        scene, flags = _scene(mi, part), mi.RayFlags.All
        passage = Passage.of(rays)
        steps = np.column_stack([1.0 / rays.entry_ratios(media), rays.exit_ratios(media)])
        table = zip(rays.origins.tolist(), rays.directions.tolist(), steps.tolist(), strict=True)
        lengths, met = np.zeros(len(rays)), np.full((len(rays), 2, 2, 3), np.nan)
        for row, (origin, direction, indices) in enumerate(table):
            ray = mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction))
            passage.fates[row], end, lengths[row] = _cast(mi, scene, flags, ray, indices, met[row])
            if end is not None:
                passage.points[row], passage.directions[row] = end
        for k, face in enumerate((RefractingFace.inner(rays, media), RefractingFace.outer(rays, media))):
            passed = np.nonzero(np.isfinite(met[:, k, 0, 0]))[0]
            at = AtFace.of(face.take(passed), met[passed, k, 0], met[passed, k, 1], passage.fields[passed])
            passage.flux[passed] *= at.transmittance
            passage.fields[passed] = at.passed
            if k == 0:
                absorb(passage, np.arange(len(rays)), lengths, rays.absorptions(media))
        return str(mi.__version__), behind_glass(passage, rays, media)
    finally:
        if before is not None:
            mi.set_variant(before)


def _cast(
    mi: Any,
    scene: Any,
    flags: Any,
    ray: Any,
    indices: list[float],
    met: Float[np.ndarray, "2 2 3"],
) -> tuple[CastFate, tuple[list[float], list[float]] | None, float]:
    """Fate of one ray; its exit point (mm) and direction, None if it is lost; its path (mm) from face to face, or 0.

    ``indices``: of the body against what lies before either face. ``met``: its direction before each face and the
    normal there, filled in for those that it passes.
    """
    length = 0.0
    for face, entering in enumerate((True, False)):
        hit = scene.ray_intersect(ray, flags, False, True)
        if not hit.is_valid():
            return CastFate.NO_HIT, None, length
        if hit.p.z <= 0.0:
            return CastFate.OPENING if entering else CastFate.BASE, None, length
        local = hit.sh_frame.to_local(-ray.d)  # Mitsuba's directions of light point away from the surface
        reflectance, cosine, _, ratio = mi.fresnel(local.z, indices[face])
        if (local.z > 0.0) != entering:
            return CastFate.STARTS_INSIDE if entering else CastFate.BACK_INTO_CAVITY, None, length
        if entering and hit.n.x * hit.p.x + hit.n.y * hit.p.y + hit.n.z * hit.p.z > 0.0:  # as ``faces_away``
            return CastFate.STARTS_OUTSIDE, None, length
        length = 0.0 if entering else float(hit.t)
        if reflectance >= 1.0:
            return CastFate.TOTAL_REFLECTION, None, length
        met[face] = list(ray.d), list(hit.sh_frame.n)
        ray = hit.spawn_ray(hit.sh_frame.to_world(mi.refract(local, cosine, ratio)))
    return CastFate.LANDED, (list(ray.o), list(ray.d)), length


def _scene(mi: Any, part: PartMesh) -> Any:
    """The part as a Mitsuba mesh with vertex normals: facet normals would refract to wrong directions."""
    rows = part.corners
    points = np.empty((len(part.fit.normals), 3))
    points[rows.ravel()] = part.mesh.vertices[part.mesh.faces.ravel()]
    mesh = mi.Mesh("lens", len(points), len(rows), has_vertex_normals=True)
    content = mi.traverse(mesh)
    content["vertex_positions"] = points.ravel().astype(np.float32)
    content["vertex_normals"] = part.fit.normals.ravel().astype(np.float32)
    content["faces"] = rows.ravel().astype(np.uint32)
    content.update()
    return mi.load_dict({"type": "scene", "lens": mesh})
