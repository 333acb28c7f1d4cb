"""The verdict on an exported part: does it send every ray where the design does?

The same rays go through the design and through the part, so what is compared is the part and not the dice: landing by
landing, flux by flux, pixel by pixel. A lens that is scaled by one per cent, or whose surfaces lie 20 um off each
other, makes as good a picture to the eye; its rays land elsewhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.gates import Gate, at_most
from lensforge.records import Extent
from lensforge.sources.bundle import RayBundle
from lensforge.verification.brep import RAYS, brep_gates, judge_brep
from lensforge.verification.casting import Grid
from lensforge.verification.comparison import Expected, compare, flux_account, gap_quantiles, share
from lensforge.verification.mitsuba_cast import judge_mitsuba, mitsuba_gates
from lensforge.verification.part import Part, read_part
from lensforge.verification.passage import Passage, send_through
from lensforge.verification.picture import Receiver, nmse, noise_limit, squared_norm, within
from lensforge.verification.proof import Agreement, BrepCast, Deviation, Gaps, MitsubaCast, PlainCast, Proof
from lensforge.verification.referee import judge

# Rays may land 0.1 mm off for each metre to the receiver, rms. A lens a few mm wide that is 1 % too large or has a
# surface 20 um off its place is at several times that; 200,000 triangles of the roughest lens take up a fifth of it.
DEVIATION_PER_DISTANCE = 1e-4
# Shares of flux: rays that graze the rim or the limit of total reflection may end either way.
FLUX_SHARE = FATE_SHARE = 1e-3
# With the same rays the picture may change by a tenth of what other rays would change, or by 1 % rms of itself.
SAME_RAYS_FLOORS, SAME_RAYS_ALLOWANCE = 0.1, 1e-4


@dataclass(frozen=True)
class Case:
    """What is verified: rays (mm, W) into a part of ``refractive_index``, a receiver at z = ``distance_mm``, a design.

    Raises :class:`InputError` if the design's arrays do not belong to the rays and the receiver.
    """

    rays: RayBundle
    refractive_index: float
    distance_mm: float
    receiver: Receiver
    window_mm: float
    expected: Expected

    def __post_init__(self) -> None:
        count, pixels = len(self.rays), self.receiver.pixels
        for name, array, shape in (
            ("design_irradiance", self.expected.irradiance, (pixels, pixels)),
            ("design_hits", self.expected.hits, (count, 2)),
            ("design_weights", self.expected.weights, (count,)),
        ):
            if array.shape != shape:
                raise InputError(f"{name}: shape {array.shape}, must be {shape}; trace the design with the same rays")
        flux = float(self.rays.weights.sum())
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
    design_weights: Float[np.ndarray, " weights"],
    filter_variance: float = 1.0,
    referee_rays: int = 200,
    step: bytes | None = None,
    step_rays: int = RAYS,
    mitsuba_rays: int = 0,
    threads: int = 1,
    inputs: Mapping[str, str] | None = None,
) -> Proof:
    """Cast ``rays`` into the part that the bytes of an STL file (mm) hold, and compare with the design.

    ``design_irradiance`` (W/m^2, [y, x]) is the design's picture under the same 3 x 3 filter of ``filter_variance``
    (0: none); ``design_hits`` (mm) and ``design_weights`` (W) are where the design lands the same rays. Efficiency
    counts the centred square of ``window_mm``. ``step``: the bytes of the same part's STEP file, through which the
    CAD kernel casts ``step_rays`` of the rays; without it ``brep`` is None. Mitsuba casts ``mitsuba_rays`` of the rays
    through the mesh; with 0 it is not loaded, and ``mitsuba`` is None. The result does not depend on ``threads``.
    ``inputs``: hashes of what is verified, by name. Raises :class:`InputError` for bytes that hold no mesh or no
    solid and for arrays that do not fit; a part that is wrong fails its gates instead.
    """
    started = perf_counter()
    expected = Expected(design_irradiance, design_hits, design_weights)
    receiver = Receiver(receiver_mm, pixels, filter_variance)
    case = Case(rays, refractive_index, distance_mm, receiver, window_mm, expected)
    part = read_part(stl)
    grid = Grid(part.mesh)
    casting = perf_counter()
    passage = send_through(part, grid, rays, refractive_index, distance_mm, threads)
    cast_seconds = perf_counter() - casting
    others = _Others(judge(part, grid, rays, refractive_index, referee_rays))
    if step is not None:
        asked = judge_brep(step, rays, refractive_index, distance_mm, receiver_mm, expected, passage, step_rays)
        others = replace(others, brep=asked)
    if mitsuba_rays:
        answer = judge_mitsuba(part, rays, refractive_index, distance_mm, receiver, expected, mitsuba_rays)
        others = replace(others, mitsuba=answer)
    return _proof(case, part, passage, others, dict(inputs or {}), (started, cast_seconds))


@dataclass(frozen=True)
class _Others:
    """The other referees' results, with quantiles of their landing gaps (mm); None: not asked."""

    plain: PlainCast
    brep: tuple[BrepCast, Gaps] | None = None
    mitsuba: tuple[MitsubaCast, Gaps] | None = None

    def gates(self, distance_mm: float) -> list[Gate]:
        """The gates of what they found; ``distance_mm``: to the receiver."""
        report = "do not trust this verification, its casting is broken: please report it"
        gates = [at_most("referee_disagreements", self.plain.disagreements, 0.0, "casts", report)]
        gates += brep_gates(self.brep[0], distance_mm) if self.brep else []
        return gates + (mitsuba_gates(self.mitsuba[0], distance_mm) if self.mitsuba else [])


@dataclass(frozen=True)
class _Picture:
    """The part's picture (W/m^2), its NMSE against the design's, what noise makes of it, and that by the same rays."""

    irradiance: Float[np.ndarray, "pixels pixels"]
    nmse_vs_design: float
    noise_floor_nmse: float
    nmse_same_rays: float


def _picture(case: Case, passage: Passage) -> _Picture:
    expected, receiver = case.expected, case.receiver
    image = receiver.irradiance(passage.landings, passage.flux)
    variance = receiver.noise(passage.landings, passage.flux)
    return _Picture(
        irradiance=image,
        nmse_vs_design=nmse(image, expected.irradiance),
        noise_floor_nmse=float(variance.sum()) / squared_norm(expected.irradiance),
        nmse_same_rays=nmse(image, receiver.irradiance(expected.hits, expected.weights)),
    )


def _proof(
    case: Case, part: Part, passage: Passage, others: _Others, inputs: dict[str, str], clock: tuple[float, float]
) -> Proof:
    """All figures and gates; ``clock``: when the verification started, and the seconds that casting took."""
    picture, heights = _picture(case, passage), np.abs(passage.facets_um)
    agreement = compare(case.rays, passage, case.expected, case.receiver.side_mm)
    flux, missed = flux_account(case.rays, passage, case.window_mm)
    in_window = within(case.expected.hits, case.window_mm)
    gates = _gates(case, part.open_edges, agreement, picture) + others.gates(case.distance_mm)
    return Proof(
        inputs=inputs,
        rays=len(case.rays),
        cast_seconds=clock[1],
        triangles=len(part.mesh.faces),
        open_edges=part.open_edges,
        volume_mm3=float(part.mesh.volume),
        facet_height_um=Extent(rms=float(np.sqrt(np.mean(heights**2))), max=float(heights.max())),
        nmse_vs_design=picture.nmse_vs_design,
        noise_floor_nmse=picture.noise_floor_nmse,
        nmse_same_rays=picture.nmse_same_rays,
        efficiency=flux.detected,
        efficiency_design_same_rays=share(case.rays, case.expected.weights[in_window]),
        deviation_mm=Deviation(rms=agreement.rms, max=agreement.max, p99=agreement.p99),
        deviation_limit_mm=DEVIATION_PER_DISTANCE * case.distance_mm,
        rays_compared=agreement.compared,
        flux_deviation=agreement.flux,
        fate_disagreements=agreement.fates,
        fate_disagreement_flux=agreement.fates_flux,
        flux=flux,
        missed_by_cause=missed,
        referee=others.plain,
        brep=others.brep[0] if others.brep else None,
        mitsuba=others.mitsuba[0] if others.mitsuba else None,
        gates=tuple(gates),
        irradiance=picture.irradiance,
        design_irradiance=case.expected.irradiance,
        gaps_mesh_mm=gap_quantiles(passage, case.expected, case.receiver.side_mm),
        gaps_step_mm=others.brep[1] if others.brep else None,
        gaps_mitsuba_mm=others.mitsuba[1] if others.mitsuba else None,
        seconds=perf_counter() - clock[0],
    )


def _gates(case: Case, open_edges: int, agreement: Agreement, picture: _Picture) -> list[Gate]:
    floor, farthest = picture.noise_floor_nmse, DEVIATION_PER_DISTANCE * case.distance_mm
    again = "export with a finer mesh; if it stays, the file is not the lens of lens.json"
    evaluate = "evaluate the design with more rays and the same filter, or verify with more rays"
    limits: list[tuple[str, float, float, str, str]] = [
        ("open_edges", open_edges, 0.0, "edges", "export again: the mesh is not closed"),
        ("deviation_rms", agreement.rms, farthest, "mm", again),
        ("flux_deviation", agreement.flux, FLUX_SHARE, "of the flux", again),
        ("fate_disagreement_flux", agreement.fates_flux, FATE_SHARE, "of the flux", again),
        ("nmse_same_rays", picture.nmse_same_rays, SAME_RAYS_FLOORS * floor + SAME_RAYS_ALLOWANCE, "", again),
        ("nmse_vs_design", picture.nmse_vs_design, noise_limit(floor), "", evaluate),
    ]
    return [at_most(*limit) for limit in limits]
