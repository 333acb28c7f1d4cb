"""Verification of an exported part: does it send every ray where the design does?

The same rays go through the design and through the part, so the comparison is free of ray noise: landing by landing,
flux by flux, pixel by pixel. A lens that is scaled by one per cent, or whose surfaces are displaced by 20 um, makes a
picture that looks the same; its rays land elsewhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from jaxtyping import Float, Shaped

from lensforge.errors import InputError
from lensforge.records import Extent
from lensforge.sources.bundle import RayBundle
from lensforge.verification.acceptance import BREP_RAYS, DEVIATION_PER_DISTANCE, proof_criteria
from lensforge.verification.brep_cast import StepBody, cast_brep
from lensforge.verification.casting import Grid
from lensforge.verification.comparison import Expected, compare, flux_budget, gap_quantiles, share
from lensforge.verification.image_plane import ImagePlane, nmse, squared_norm, within
from lensforge.verification.mitsuba_cast import cast_mitsuba
from lensforge.verification.part_mesh import PartMesh, read_part_mesh
from lensforge.verification.passage import Passage, send_through
from lensforge.verification.plain_cast import cast_plain
from lensforge.verification.proof import BrepCast, Gaps, LandingDeviation, MitsubaCast, PlainCast, Proof


@dataclass(frozen=True)
class Case:
    """Rays (mm, W) into a part of ``refractive_index``, a receiver at z = ``distance_mm``, and the design's results.

    Raises :class:`InputError` if the design's arrays do not belong to the rays and the receiver.
    """

    rays: RayBundle
    refractive_index: float
    distance_mm: float
    receiver: ImagePlane
    window_mm: float
    expected: Expected

    def __post_init__(self) -> None:
        count, pixels = len(self.rays), self.receiver.pixels
        for name, array, shape in (
            ("design_irradiance", self.expected.irradiance, (pixels, pixels)),
            ("design_hits", self.expected.landings, (count, 2)),
            ("design_flux", self.expected.flux, (count,)),
            ("design_fates", self.expected.fates, (count,)),
        ):
            if array is not None and array.shape != shape:
                raise InputError(f"{name}: shape {array.shape}, must be {shape}; trace the design with the same rays")
        flux = float(self.rays.flux.sum())
        if not flux > 0.0:
            raise InputError(f"rays: {count} rays carry {flux:g} W, must be above 0; is the source empty?")


def verify_part(
    stl: bytes,
    *,
    rays: RayBundle,
    refractive_index: float,
    distance_mm: float,
    receiver_mm: float,
    window_mm: float,
    pixels: int,
    design_irradiance: Float[np.ndarray, "pixels pixels"],
    design_hits: Float[np.ndarray, "hits 2"],
    design_flux: Float[np.ndarray, " k"],
    design_fates: Shaped[np.ndarray, " f"] | None = None,
    filter_variance: float = 1.0,
    plain_rays: int = 200,
    step: bytes | None = None,
    step_rays: int = BREP_RAYS,
    mitsuba_rays: int = 0,
    threads: int = 1,
    inputs: Mapping[str, str] | None = None,
) -> Proof:
    """Cast ``rays`` into the part in the bytes of an STL file (mm), and compare with the design.

    ``design_irradiance`` (W/m^2, [y, x]) is the design's, under the same 3 x 3 filter of ``filter_variance``
    (0: none); ``design_hits`` (mm) and ``design_flux`` (W) are where it lands the same rays, and ``design_fates`` the
    names of their fates, by which rays are named that only one of both loses. Efficiency counts the
    centred square of ``window_mm``. trimesh's own ray cast traces ``plain_rays`` of the rays, to verify the grid.
    ``step``: the bytes of the same part's STEP file, through which the CAD kernel casts ``step_rays`` of the rays;
    without it ``brep`` is None. Mitsuba casts ``mitsuba_rays`` of the rays through the mesh; with 0 it is not loaded,
    and ``mitsuba`` is None. The result does not depend on ``threads``. ``inputs``: hashes of the inputs, by name.

    Raises :class:`InputError` for bytes that hold no mesh or no solid and for arrays that do not fit; a wrong part
    misses its criteria instead.
    """
    started = perf_counter()
    expected = Expected(design_irradiance, design_hits, design_flux, design_fates)
    receiver = ImagePlane(receiver_mm, pixels, filter_variance)
    case = Case(rays, refractive_index, distance_mm, receiver, window_mm, expected)
    body = None if step is None else StepBody(step)  # before the casts: a file that is refused costs no more than that
    part = read_part_mesh(stl)
    grid = Grid(part.mesh)
    casting = perf_counter()
    passage = send_through(part, grid, rays, refractive_index, distance_mm, threads)
    cast_seconds = perf_counter() - casting
    others = _OtherCasts(cast_plain(part, grid, rays, refractive_index, plain_rays))
    if body is not None:
        by_step = cast_brep(body, rays, refractive_index, distance_mm, receiver_mm, expected, passage, step_rays)
        others = replace(others, brep=by_step)
    if mitsuba_rays:
        by_mitsuba = cast_mitsuba(part, rays, refractive_index, distance_mm, receiver, expected, mitsuba_rays)
        others = replace(others, mitsuba=by_mitsuba)
    return _proof(case, part, passage, others, dict(inputs or {}), (started, cast_seconds))


@dataclass(frozen=True)
class _OtherCasts:
    """Results of the casts other than the grid's, with quantiles of their landing gaps (mm); None: not done."""

    plain: PlainCast
    brep: tuple[BrepCast, Gaps] | None = None
    mitsuba: tuple[MitsubaCast, Gaps] | None = None


@dataclass(frozen=True)
class _Irradiance:
    """The part's irradiance (W/m^2), its NMSE against the design's, its ray noise, and the NMSE with the same rays."""

    irradiance: Float[np.ndarray, "pixels pixels"]
    nmse_vs_design: float
    noise_floor_nmse: float
    nmse_same_rays: float


def _irradiance(case: Case, passage: Passage) -> _Irradiance:
    expected, receiver = case.expected, case.receiver
    image = receiver.irradiance(passage.landings, passage.flux)
    variance = receiver.noise(passage.landings, passage.flux)
    return _Irradiance(
        irradiance=image,
        nmse_vs_design=nmse(image, expected.irradiance),
        noise_floor_nmse=float(variance.sum()) / squared_norm(expected.irradiance),
        nmse_same_rays=nmse(image, receiver.irradiance(expected.landings, expected.flux)),
    )


def _proof(
    case: Case,
    part: PartMesh,
    passage: Passage,
    others: _OtherCasts,
    inputs: dict[str, str],
    clock: tuple[float, float],
) -> Proof:
    """Assemble all results and criteria; ``clock``: start of the verification, and seconds of the casting."""
    seen, heights = _irradiance(case, passage), np.abs(passage.facets_um)
    agreement = compare(case.rays, passage, case.expected, case.receiver.side_mm)
    flux, missed = flux_budget(case.rays, passage, case.window_mm)
    in_window = within(case.expected.landings, case.window_mm)
    proof = Proof(
        inputs=inputs,
        rays=len(case.rays),
        cast_seconds=clock[1],
        triangles=len(part.mesh.faces),
        open_edges=part.open_edges,
        volume_mm3=float(part.mesh.volume),
        facet_height_um=Extent(rms=float(np.sqrt(np.mean(heights**2))), max=float(heights.max())),
        nmse_vs_design=seen.nmse_vs_design,
        noise_floor_nmse=seen.noise_floor_nmse,
        nmse_same_rays=seen.nmse_same_rays,
        efficiency=flux.detected,
        efficiency_design_same_rays=share(case.rays, case.expected.flux[in_window]),
        deviation_mm=LandingDeviation(rms=agreement.rms, max=agreement.max, p99=agreement.p99),
        deviation_limit_mm=DEVIATION_PER_DISTANCE * case.distance_mm,
        rays_compared=agreement.compared,
        flux_deviation=agreement.flux,
        fate_disagreements=agreement.fates,
        fate_disagreement_flux=agreement.fates_flux,
        fate_pairs=agreement.pairs,
        flux=flux,
        missed_by_cause=missed,
        plain_cast=others.plain,
        brep=others.brep[0] if others.brep else None,
        mitsuba=others.mitsuba[0] if others.mitsuba else None,
        criteria=(),
        irradiance=seen.irradiance,
        design_irradiance=case.expected.irradiance,
        gaps_mesh_mm=gap_quantiles(passage, case.expected, case.receiver.side_mm),
        gaps_step_mm=others.brep[1] if others.brep else None,
        gaps_mitsuba_mm=others.mitsuba[1] if others.mitsuba else None,
        seconds=perf_counter() - clock[0],
    )
    return proof.model_copy(update={"criteria": proof_criteria(proof, case.distance_mm)})
