"""Verification of an exported part: does it send every ray where the design does?

The same rays go through the design and through the part, so the comparison is free of ray noise: landing by landing,
flux by flux, pixel by pixel. A lens that is scaled by one per cent, or whose surfaces are displaced by 20 um, makes a
picture that looks the same; its rays land elsewhere.
"""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np

from lensforge.errors import InputError
from lensforge.records import Extent
from lensforge.sources.bundle import RayBundle
from lensforge.verification.acceptance import BREP_RAYS, DEVIATION_PER_DISTANCE, proof_criteria
from lensforge.verification.brep_cast import StepBody, cast_brep
from lensforge.verification.casting import Grid
from lensforge.verification.comparison import Expected, compare, flux_budget, gap_quantiles, share
from lensforge.verification.mitsuba_cast import cast_mitsuba
from lensforge.verification.part_mesh import read_part_mesh
from lensforge.verification.passage import LandedRays, Passage, send_through
from lensforge.verification.plain_cast import cast_plain
from lensforge.verification.proof import BrepCast, Gaps, LandingDeviation, MitsubaCast, Proof, ReceiverProof
from lensforge.verification.screen import nmse, squared_norm


def verify_part(
    stl: bytes,
    *,
    rays: RayBundle,
    refractive_index: float,
    expected: Sequence[Expected],
    names: Sequence[str] = ("light",),
    plain_rays: int = 200,
    step: bytes | None = None,
    step_rays: int = BREP_RAYS,
    mitsuba_rays: int = 0,
    threads: int = 1,
    inputs: Mapping[str, str] | None = None,
) -> Proof:
    """Cast ``rays`` into the part in the bytes of an STL file (mm), and compare with the design.

    ``expected``: the design's light and the landings of the same rays, on each receiver, of ``names``. trimesh's own
    ray cast traces ``plain_rays`` of the rays, to verify the grid. ``step``: the bytes of the same part's STEP file,
    through which the CAD kernel casts ``step_rays`` of the rays; without it ``brep`` is None. Mitsuba casts
    ``mitsuba_rays`` of the rays through the mesh; with 0 it is not loaded, and ``mitsuba`` is None. The result does not
    depend on ``threads``. ``inputs``: hashes of the inputs, by name.

    Raises :class:`InputError` for bytes that hold no mesh or no solid and for arrays that do not fit; a wrong part
    misses its criteria instead.
    """
    started = perf_counter()
    _require_rays(rays, expected)
    body = None if step is None else StepBody(step)  # before the casts: a file that is refused costs no more than that
    part = read_part_mesh(stl)
    grid = Grid(part.mesh)
    casting = perf_counter()
    passage = send_through(part, grid, rays, refractive_index, threads)
    cast_seconds = perf_counter() - casting
    plain = cast_plain(part, grid, rays, refractive_index, plain_rays)
    none: list[Any] = [None] * len(expected)
    by_step = none if body is None else cast_brep(body, rays, refractive_index, expected, passage, step_rays)
    by_mitsuba = cast_mitsuba(part, rays, refractive_index, expected, mitsuba_rays) if mitsuba_rays else none
    received = tuple(
        _on_receiver(name, rays, passage, each, brep, mitsuba)
        for name, each, brep, mitsuba in zip(names, expected, by_step, by_mitsuba, strict=True)
    )
    heights = np.abs(passage.facets_um)
    proof = Proof(
        inputs=dict(inputs or {}),
        receivers=received,
        rays=len(rays),
        cast_seconds=cast_seconds,
        triangles=len(part.mesh.faces),
        open_edges=part.open_edges,
        volume_mm3=float(part.mesh.volume),
        facet_height_um=Extent(rms=float(np.sqrt(np.mean(heights**2))), max=float(heights.max())),
        plain_cast=plain,
        criteria=(),
        seconds=perf_counter() - started,
    )
    return proof.model_copy(update={"criteria": proof_criteria(proof)})


def _require_rays(rays: RayBundle, expected: Sequence[Expected]) -> None:
    """Raise :class:`InputError` for rays without flux, and for arrays that do not belong to them."""
    for each in expected:
        each.require_shapes(len(rays))
    flux = float(rays.flux.sum())
    if not flux > 0.0:
        raise InputError(f"rays: {len(rays)} rays carry {flux:g} W, must be above 0; is the source empty?")


def _on_receiver(
    name: str,
    rays: RayBundle,
    passage: Passage,
    expected: Expected,
    brep: tuple[BrepCast, Gaps] | None,
    mitsuba: tuple[MitsubaCast, Gaps] | None,
) -> ReceiverProof:
    """The rays of ``passage`` on one receiver against the design's."""
    screen, landed = expected.screen, LandedRays.of(passage, expected.screen)
    image, variance = (see(landed.landings, landed.flux) for see in (screen.irradiance, screen.noise))
    agreement = compare(rays, landed, expected)
    flux, missed = flux_budget(rays, landed, screen)
    return ReceiverProof(
        name=name,
        width=screen.width,
        height=screen.height,
        far_field=screen.kind == "far_field",
        nmse_vs_design=nmse(image, expected.irradiance),
        noise_floor_nmse=float(variance.sum()) / squared_norm(expected.irradiance),
        nmse_same_rays=nmse(image, screen.irradiance(expected.landings, expected.flux)),
        efficiency=flux.detected,
        efficiency_design_same_rays=share(rays, expected.flux[screen.in_window(expected.landings)]),
        deviation_mm=LandingDeviation(rms=agreement.rms, max=agreement.max, p99=agreement.p99),
        deviation_limit_mm=DEVIATION_PER_DISTANCE * screen.distance_mm,
        rays_compared=agreement.compared,
        flux_deviation=agreement.flux,
        fate_disagreements=agreement.fates,
        fate_disagreement_flux=agreement.fates_flux,
        fate_pairs=agreement.pairs,
        flux=flux,
        missed_by_cause=missed,
        brep=brep[0] if brep else None,
        mitsuba=mitsuba[0] if mitsuba else None,
        irradiance=image,
        design_irradiance=expected.irradiance,
        gaps_mesh_mm=gap_quantiles(landed, expected),
        gaps_step_mm=brep[1] if brep else None,
        gaps_mitsuba_mm=mitsuba[1] if mitsuba else None,
    )
