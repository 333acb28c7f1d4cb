"""The part against the design, ray by ray, and the flux budget of the part."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from lensforge.sources.bundle import RayBundle
from lensforge.verification.image_plane import within
from lensforge.verification.passage import CastFate, Passage
from lensforge.verification.proof import Agreement, FatePair, PartFlux, PartMissed


@dataclass(frozen=True)
class Expected:
    """The design's results for n rays: landings (mm, NaN if lost) and flux there (W); and its irradiance (W/m^2).

    ``fates``: name of the fate of each ray; None: those that do not land are "lost".
    """

    irradiance: Float[np.ndarray, "pixels pixels"]
    landings: Float[np.ndarray, "k 2"]
    flux: Float[np.ndarray, " n"]
    fates: Shaped[np.ndarray, " n"] | None = None

    @property
    def fate_names(self) -> Shaped[np.ndarray, " n"]:
        """Name of the fate of each ray; "landed" for all that reach the receiver's plane."""
        lost = np.full(len(self.flux), "lost") if self.fates is None else self.fates
        return np.where(np.isnan(self.landings[:, 0]), lost, "landed")

    def take(self, rows: Int[np.ndarray, " k"]) -> "Expected":
        """Results for some of the rays; the irradiance remains that of all rays."""
        fates = None if self.fates is None else self.fates[rows]
        return Expected(self.irradiance, self.landings[rows], self.flux[rows], fates)


def drawn(count: int, of: int) -> Int[np.ndarray, " k"]:
    """Rows of at most ``count`` out of ``of`` rays, drawn at random without replacement, always the same.

    Not at regular intervals: every sixteenth point of a Sobol sequence lies in one sixteenth of the chip.
    """
    return np.sort(np.random.default_rng(0).permutation(of)[:count])


def compare(rays: RayBundle, passage: Passage, expected: Expected, receiver_mm: float) -> Agreement:
    """Compare landing and flux of every ray; rays that both land outside the receiver do not count."""
    here, there, apart = landing_gaps(passage, expected, receiver_mm)
    lost_here, lost_there = np.isnan(passage.landings[:, 0]), np.isnan(expected.landings[:, 0])
    differs = (here & lost_there) | (there & lost_here)
    both = here & there
    change = 1.0
    if both.any():
        change = float(np.abs(passage.flux[both] - expected.flux[both]).sum() / expected.flux[both].sum())
    return Agreement(
        compared=int(both.sum()),
        rms=float(np.sqrt(np.mean(apart**2))),
        p99=float(np.quantile(apart, 0.99)),
        max=float(apart.max()),
        flux=change,
        fates=int(differs.sum()),
        fates_flux=share(rays, rays.flux[differs]),
        pairs=_fate_pairs(rays, passage, expected, differs),
    )


def _fate_pairs(
    rays: RayBundle, passage: Passage, expected: Expected, differs: Bool[np.ndarray, " n"]
) -> tuple[FatePair, ...]:
    """Rays of ``differs`` by their fates in design and part, the largest share of flux first."""
    design, part = expected.fate_names, passage.fate_names
    found = []
    for first, second in sorted(set(zip(design[differs].tolist(), part[differs].tolist(), strict=True))):
        rows = differs & (design == first) & (part == second)
        found.append(FatePair(design=first, part=second, rays=int(rows.sum()), flux=share(rays, rays.flux[rows])))
    return tuple(sorted(found, key=lambda pair: -pair.flux))


def landing_gaps(
    passage: Passage, expected: Expected, receiver_mm: float
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"], Float[np.ndarray, " k"]]:
    """Masks of the rays that part and design land on the receiver, and the gaps (mm) of those that both do.

    Where no ray lands in both, one gap as long as the receiver's diagonal.
    """
    here, there = within(passage.landings, receiver_mm), within(expected.landings, receiver_mm)
    both = here & there
    if not both.any():
        return here, there, np.array([np.sqrt(2.0) * receiver_mm])
    return here, there, np.linalg.norm(passage.landings[both] - expected.landings[both], axis=1)


def gap_quantiles(passage: Passage, expected: Expected, receiver_mm: float) -> Float[np.ndarray, " q"]:
    """Quantiles of the landing gaps (mm) at 0, 0.2 ... 100 % of the rays: enough to draw their distribution."""
    gaps: Float[np.ndarray, " q"] = np.quantile(
        landing_gaps(passage, expected, receiver_mm)[2], np.linspace(0.0, 1.0, 501)
    )
    return gaps


def flux_budget(rays: RayBundle, passage: Passage, window_mm: float) -> tuple[PartFlux, PartMissed]:
    """Shares of the emitted flux by fate, which add up to 1; and the missed flux by cause.

    ``reflected`` is what rays lose by reflection at the surfaces; the rest of a ray's flux counts by its fate.
    Rays that reach the receiver's plane outside the window are ``outside``.
    """
    landed = passage.fates == CastFate.LANDED
    inside = landed & within(passage.landings, window_mm)
    by_fate = {fate: share(rays, passage.flux[passage.fates == fate]) for fate in CastFate}
    missed = PartMissed(
        no_hit=by_fate[CastFate.NO_HIT],
        starts_inside=by_fate[CastFate.STARTS_INSIDE],
        starts_outside=by_fate[CastFate.STARTS_OUTSIDE],
        base=by_fate[CastFate.BASE] + by_fate[CastFate.OPENING],
        back_into_cavity=by_fate[CastFate.BACK_INTO_CAVITY],
        missed_receiver=by_fate[CastFate.MISSED_RECEIVER],
    )
    flux = PartFlux(
        detected=share(rays, passage.flux[inside]),
        outside=share(rays, passage.flux[landed & ~inside]),
        missed=sum(missed.model_dump().values()),
        total_reflection=by_fate[CastFate.TOTAL_REFLECTION],
        reflected=share(rays, rays.flux - passage.flux),
    )
    return flux, missed


def share(rays: RayBundle, flux: Float[np.ndarray, " k"]) -> float:
    """``flux`` (W) of some rays as a share of all that ``rays`` carry."""
    return float(flux.sum() / rays.flux.sum())
