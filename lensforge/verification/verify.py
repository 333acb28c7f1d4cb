"""The verdict on an exported part: does it send every ray where the design does?

The same rays go through the design and through the part, so what is compared is the part and not the dice: landing by
landing, flux by flux, pixel by pixel. A lens that is scaled by one per cent, or whose surfaces lie 20 um off each
other, makes as good a picture to the eye; its rays land elsewhere.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.files import replacing, write_json
from lensforge.gates import Gate
from lensforge.sources.bundle import RayBundle
from lensforge.verification.brep import RAYS, judge_brep
from lensforge.verification.casting import Grid
from lensforge.verification.comparison import Expected, compare, flux_account, gap_quantiles, share
from lensforge.verification.mitsuba_cast import judge_mitsuba
from lensforge.verification.part import Part, load_part
from lensforge.verification.passage import Passage, send_through
from lensforge.verification.picture import Receiver, nmse, noise_limit, squared_norm, within
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
    stl: Path,
    directory: Path,
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
    step: Path | None = None,
    step_rays: int = RAYS,
    mitsuba_rays: int = 0,
    threads: int = 1,
) -> dict[str, Any]:
    """Cast ``rays`` into the part in ``stl`` (mm), compare with the design, write verify.json and verify.npz.

    ``design_irradiance`` (W/m^2, [y, x]) is the design's picture under the same 3 x 3 filter of ``filter_variance``
    (0: none); ``design_hits`` (mm) and ``design_weights`` (W) are where the design lands the same rays. Efficiency
    counts the centred square of ``window_mm``. ``step`` is the same part as a STEP file, through which the CAD kernel
    casts ``step_rays`` of the rays; without it the key ``brep`` is None. Mitsuba casts ``mitsuba_rays`` of the rays
    through the mesh; with 0 it is not loaded, and the key ``mitsuba`` is None. The result does not depend on
    ``threads``. Raises :class:`InputError` for a file that is no mesh or no solid and for arrays that do not fit; a
    part that is wrong fails its gates instead.
    """
    start = perf_counter()
    expected = Expected(design_irradiance, design_hits, design_weights)
    receiver = Receiver(receiver_mm, pixels, filter_variance)
    case = Case(rays, refractive_index, distance_mm, receiver, window_mm, expected)
    part = load_part(stl)
    grid = Grid(part.mesh)
    casting = perf_counter()
    passage = send_through(part, grid, rays, refractive_index, distance_mm, threads)
    cast_seconds = perf_counter() - casting
    image = receiver.irradiance(passage.landings, passage.flux)
    figures = _part_figures(part, passage) | _picture_figures(case, passage, image) | _ray_figures(case, passage)
    figures["referee"] = asdict(judge(part, grid, rays, refractive_index, referee_rays))
    gates, gaps = _gates(figures), {"mesh": gap_quantiles(passage, expected, receiver_mm)}
    figures["brep"] = None
    if step is not None:
        verdict = judge_brep(step, case.rays, refractive_index, distance_mm, receiver_mm, expected, passage, step_rays)
        figures["brep"], gaps["step"] = verdict.to_json(), verdict.gaps_mm
        gates += verdict.gates(distance_mm)
    figures["mitsuba"] = None
    if mitsuba_rays:
        asked = judge_mitsuba(part, rays, refractive_index, distance_mm, receiver, expected, mitsuba_rays)
        figures["mitsuba"], gaps["mitsuba"] = asked.to_json(), asked.gaps_mm
        gates += asked.gates(distance_mm)
    seconds = {"seconds": perf_counter() - start, "cast_seconds": cast_seconds}
    result = {"rays": len(rays), **seconds, **figures, "gates": [gate.to_json() for gate in gates]}
    with replacing(Path(directory) / "verify.npz") as temporary:
        images = {"irradiance": image, "design_irradiance": design_irradiance}
        quantiles = {f"gaps_{name}_mm": values for name, values in gaps.items()}
        np.savez_compressed(temporary, allow_pickle=False, **images, **quantiles)
    write_json(Path(directory) / "verify.json", result)
    return result


def _part_figures(part: Part, passage: Passage) -> dict[str, Any]:
    heights = np.abs(passage.facets_um)
    return {
        "triangles": len(part.mesh.faces),
        "open_edges": part.open_edges,
        "volume_mm3": float(part.mesh.volume),
        "facet_height_um": {"rms": float(np.sqrt(np.mean(heights**2))), "max": float(heights.max())},
    }


def _picture_figures(case: Case, passage: Passage, image: Float[np.ndarray, "pixels pixels"]) -> dict[str, Any]:
    expected, receiver = case.expected, case.receiver
    variance = receiver.noise(passage.landings, passage.flux)
    return {
        "nmse_vs_design": nmse(image, expected.irradiance),
        "noise_floor_nmse": float(variance.sum()) / squared_norm(expected.irradiance),
        "nmse_same_rays": nmse(image, receiver.irradiance(expected.hits, expected.weights)),
    }


def _ray_figures(case: Case, passage: Passage) -> dict[str, Any]:
    agreement = compare(case.rays, passage, case.expected, case.receiver.side_mm)
    flux, missed = flux_account(case.rays, passage, case.window_mm)
    in_window = within(case.expected.hits, case.window_mm)
    return {
        "efficiency": flux["detected"],
        "efficiency_design_same_rays": share(case.rays, case.expected.weights[in_window]),
        "deviation_mm": {"rms": agreement.rms, "max": agreement.max, "p99": agreement.p99},
        "deviation_limit_mm": DEVIATION_PER_DISTANCE * case.distance_mm,
        "rays_compared": agreement.compared,
        "flux_deviation": agreement.flux,
        "fate_disagreements": agreement.fates,
        "fate_disagreement_flux": agreement.fates_flux,
        "flux": flux,
        "missed_by_cause": missed,
    }


def _gates(figures: dict[str, Any]) -> list[Gate]:
    floor = figures["noise_floor_nmse"]
    again = "export with a finer mesh; if it stays, the file is not the lens of lens.json"
    evaluate = "evaluate the design with more rays and the same filter, or verify with more rays"
    report = "do not trust this verification, its casting is broken: please report it"
    limits: list[tuple[str, float, float, str, str]] = [
        ("open_edges", figures["open_edges"], 0.0, "edges", "export again: the mesh is not closed"),
        ("deviation_rms", figures["deviation_mm"]["rms"], figures["deviation_limit_mm"], "mm", again),
        ("flux_deviation", figures["flux_deviation"], FLUX_SHARE, "of the flux", again),
        ("fate_disagreement_flux", figures["fate_disagreement_flux"], FATE_SHARE, "of the flux", again),
        ("nmse_same_rays", figures["nmse_same_rays"], SAME_RAYS_FLOORS * floor + SAME_RAYS_ALLOWANCE, "", again),
        ("nmse_vs_design", figures["nmse_vs_design"], noise_limit(floor), "", evaluate),
        ("referee_disagreements", figures["referee"]["disagreements"], 0.0, "casts", report),
    ]
    return [Gate(name, value, "<=", limit, unit, remedy) for name, value, limit, unit, remedy in limits]
