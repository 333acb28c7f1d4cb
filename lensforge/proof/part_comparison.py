"""The light of the part against the design's: ray by ray, by its flux budget, by independent rays, and of all lamps.

Most casts take the design's rays: a sampler with a wrong distribution would mislead both sides alike. Independent rays
come from the description of the source; their noise is known, so that they test the design's sampler.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from lensforge.errors import InputError
from lensforge.optics.media import Media
from lensforge.proof.acceptance import BLOCKS, LEAST_RAYS
from lensforge.proof.cast_results import Agreement, FatePair, PartFlux
from lensforge.proof.facet_casting import Grid
from lensforge.proof.optical_faces import OpticalFaces
from lensforge.proof.part_mesh import PartMesh, read_part_mesh
from lensforge.proof.patched_body import PatchedBody
from lensforge.proof.proof_result import IndependentRays, LampsTogether
from lensforge.proof.receiver_screen import Screen, squared_norm
from lensforge.proof.sequential_cast import CastFate, LandedRays, Passage, send_through
from lensforge.results import Metric
from lensforge.results.replicate_pairs import error_over_pairs, mean_over_pairs
from lensforge.sources.ray_bundle import RayBundle


@dataclass(frozen=True)
class Expected:
    """The design's results for n rays on a screen: its light (W/m^2 or W/sr), landings (NaN if lost), and flux (W).

    ``fates``: name of the fate of each ray; None: those that do not land are "lost". ``met``: number of the face that a
    ray meets at each event; beside a crease it may meet the other one in the part, lands far away, and counts as a ray
    of another fate. None if there is one way only.
    """

    screen: Screen
    irradiance: Float[np.ndarray, "rows columns"]
    landings: Float[np.ndarray, "k 2"]
    flux: Float[np.ndarray, " n"]
    fates: Shaped[np.ndarray, " n"] | None = None
    met: Int[np.ndarray, "n events"] | None = None

    @property
    def fate_names(self) -> Shaped[np.ndarray, " n"]:
        """Name of the fate of each ray; "landed" for all that reach the receiver's surface."""
        lost = np.full(len(self.flux), "lost") if self.fates is None else self.fates
        return np.where(np.isnan(self.landings[:, 0]), lost, "landed")

    def require_shapes(self, count: int) -> None:
        """Raise :class:`InputError` unless the arrays belong to ``count`` rays and the screen."""
        for name, array, shape in (
            ("irradiance", self.irradiance, (self.screen.rows, self.screen.columns)),
            ("landings", self.landings, (count, 2)),
            ("flux", self.flux, (count,)),
            ("fates", self.fates, (count,)),
            ("met", None if self.met is None else self.met[:, 0], (count,)),
        ):
            if array is not None and array.shape != shape:
                raise InputError(
                    f"expected {name}: shape {array.shape}, must be {shape}; trace the design with the same rays"
                )

    def take(self, rows: Int[np.ndarray, " k"]) -> "Expected":
        """Select rays by row; the irradiance remains that of all rays."""
        fates, met = (None if values is None else values[rows] for values in (self.fates, self.met))
        return replace(self, landings=self.landings[rows], flux=self.flux[rows], fates=fates, met=met)


def drawn(count: int, of: int) -> Int[np.ndarray, " k"]:
    """Rows of at most ``count`` out of ``of`` rays, drawn at random without replacement, always the same.

    Not at regular intervals: every sixteenth point of a Sobol sequence lies in one sixteenth of the chip.
    """
    return np.sort(np.random.default_rng(0).permutation(of)[:count])


Landed = LandedRays | Expected  # rays through a file, or through another lens by the design's own tracer


def compare(rays: RayBundle, landed: Landed, expected: Expected) -> Agreement:
    """Compare landing and flux of every ray; rays that both land outside the receiver do not count."""
    both, differs, apart = landing_gaps(landed, expected)
    change = 1.0
    if both.any():
        change = float(np.abs(landed.flux[both] - expected.flux[both]).sum() / expected.flux[both].sum())
    return Agreement(
        compared=int(both.sum()),
        rms=float(np.sqrt(np.mean(apart**2))),
        p99=float(np.quantile(apart, 0.99)),
        max=float(apart.max()),
        flux=change,
        fates=int(differs.sum()),
        fates_flux=share(rays, rays.flux[differs]),
        pairs=_fate_pairs(rays, landed, expected, differs),
    )


def _fate_pairs(
    rays: RayBundle, landed: Landed, expected: Expected, differs: Bool[np.ndarray, " n"]
) -> tuple[FatePair, ...]:
    """Rays of ``differs`` by their fates in design and part, the largest share of flux first."""
    design = expected.fate_names
    part = landed.fate_names
    pairs = []
    for first, second in sorted(set(zip(design[differs].tolist(), part[differs].tolist(), strict=True))):
        rows = differs & (design == first) & (part == second)
        pairs.append(FatePair(design=first, part=second, rays=int(rows.sum()), flux=share(rays, rays.flux[rows])))
    return tuple(sorted(pairs, key=lambda pair: -pair.flux))


def landing_gaps(
    landed: Landed, expected: Expected
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"], Float[np.ndarray, " k"]]:
    """Masks of rays that both land on the receiver by the same way, and of rays of differing fates; gaps (mm).

    The gaps are of the former; those of directions are taken at 1 m. Where there is no such ray, one gap as long as the
    receiver's diagonal.
    """
    screen = expected.screen
    part_lands = screen.on_pixels(landed.landings)
    design_lands = screen.on_pixels(expected.landings)
    lost_here = np.isnan(landed.landings[:, 0])
    lost_there = np.isnan(expected.landings[:, 0])
    both = part_lands & design_lands
    differs = (part_lands & lost_there) | (design_lands & lost_here)
    if expected.met is not None:
        other_way = np.any(landed.met != expected.met, axis=1)
        both, differs = both & ~other_way, differs | (both & other_way)
    if not both.any():
        return both, differs, np.array([screen.mm_per_unit * np.hypot(screen.width, screen.height)])
    gaps = np.linalg.norm(landed.landings[both] - expected.landings[both], axis=1)
    return both, differs, screen.mm_per_unit * gaps


def gap_quantiles(landed: LandedRays, expected: Expected) -> Float[np.ndarray, " q"]:
    """Quantiles of the landing gaps (mm) at 0, 0.2 ... 100 % of the rays: enough to draw their distribution."""
    return np.quantile(landing_gaps(landed, expected)[2], np.linspace(0.0, 1.0, 501))


def flux_budget(rays: RayBundle, landed: LandedRays, screen: Screen) -> PartFlux:
    """Shares of the emitted flux by fate, which add up to 1.

    ``reflected`` is what rays lose by reflection at the surfaces, ``absorbed`` in body and mirrors; the rest of a ray's
    flux counts by its fate: rays that reach the receiver's surface outside the window are ``outside``.
    """
    fates = CastFate.LANDED, CastFate.TOTAL_REFLECTION, CastFate.EVENT_LIMIT, CastFate.SECOND_WALL
    reached, total, more, again = (landed.fates == fate for fate in fates)
    inside = reached & screen.in_window(landed.landings)
    taken = landed.absorbed + landed.in_glass + landed.in_bodies + landed.in_housing
    return PartFlux(
        detected=share(rays, landed.flux[inside]),
        outside=share(rays, landed.flux[reached & ~inside]),
        missed=share(rays, landed.flux[~reached & ~total & ~more & ~again]),
        total_reflection=share(rays, landed.flux[total]),
        event_limit=share(rays, landed.flux[more]),
        absorbed=share(rays, landed.absorbed),
        cover_glass=share(rays, landed.in_glass),
        bodies=share(rays, landed.in_bodies),
        housing=share(rays, landed.in_housing),
        second_wall=share(rays, landed.flux[again]),
        reflected=share(rays, rays.flux - landed.flux - taken),
    )


def share(rays: RayBundle, flux: Float[np.ndarray, " k"]) -> float:
    """``flux`` (W) of some rays as a share of all that ``rays`` carry."""
    return float(flux.sum() / rays.flux.sum())


_ROUNDING = 1e-9  # relative, of sums of products
RAYS = 2**14  # as many as the grid casts in the five seconds that this may take on two slow cores


@dataclass(frozen=True)
class IndependentLight:
    """Rays (of equal flux) drawn by verification, and the design's light on each receiver.

    The latter are its efficiency, and the NMSE of its map by noise, None if unknown. ``seed``: for the facets that the
    rays meet. ``bodies``: measured ones of the scene.
    """

    rays: RayBundle
    designs: tuple[tuple[Metric, float | None], ...]
    seed: int
    bodies: tuple[PatchedBody, ...] = ()


def emission_difference(independent: RayBundle, design: RayBundle) -> float:
    """Largest difference of a mean, or of a mean product, of start point and direction, in standard errors.

    Both samples as emitted, weighted by flux. The design's rays are quasi-random: their noise is at most the one
    counted here, that of independent rays.
    """
    rows, columns = np.triu_indices(7)
    means = np.zeros(len(rows))
    squares = np.zeros(len(rows))
    for sign, rays in ((1.0, independent), (-1.0, design)):
        table = np.column_stack([np.ones(len(rays)), rays.origins, rays.directions])
        products = table[:, rows] * table[:, columns]
        weights = rays.flux / rays.flux.sum()
        mean = weights @ products
        means += sign * mean
        squares += weights**2 @ (products - mean) ** 2
    scale = 1.0 + float(np.abs(independent.origins).max())
    return float(np.max(np.abs(means) / (np.sqrt(squares) + _ROUNDING * scale**2)))


def judge_independent_rays(
    rays: RayBundle, passage: Passage, expected: Expected, design: tuple[Metric, float | None]
) -> IndependentRays:
    """Light of ``rays``, all of the same flux, on the screen of ``expected``, against its picture and ``design``."""
    landed = passage.landed(expected.screen)
    screen = expected.screen
    flux = flux_budget(rays, landed, screen)
    detected = np.where(screen.in_window(landed.landings), landed.flux, 0.0) / rays.flux.sum() * len(rays)
    error = float(np.std(detected, ddof=1)) / np.sqrt(len(rays)) if len(rays) > 1 else None
    return IndependentRays(
        rays=len(rays),
        efficiency=Metric(value=flux.detected, standard_error=error),
        efficiency_design=design[0],
        nmse_less_noise=_nmse_less_noise(landed, expected, design[1]),
        flux=flux,
    )


def _nmse_less_noise(landed: LandedRays, expected: Expected, noise: float | None) -> Metric | None:
    """NMSE against the design's picture, whose own NMSE by noise is ``noise``, without ray noise.

    The mean product of the errors of two different blocks of rays is free of their noise (Hoeffding 1948).
    """
    if noise is None or len(landed.flux) < LEAST_RAYS:
        return None
    screen = expected.screen
    count = len(landed.flux)
    pictures = (
        screen.irradiance(landed.landings[rows], landed.flux[rows] * (count / len(rows)))
        for rows in np.array_split(np.arange(count), BLOCKS)
    )
    errors = np.stack([picture - expected.irradiance for picture in pictures]).reshape(BLOCKS, -1)
    products = errors @ errors.T / squared_norm(expected.irradiance)
    return Metric(value=mean_over_pairs(products) - noise, standard_error=error_over_pairs(products))


@dataclass(frozen=True, eq=False)
class LampsOnPlate:
    """The STL of a plate, rays of all its lamps, their faces, and the design's light on each receiver, by its name.

    Each ray goes to one lamp, drawn at random, so that every lamp has its share.
    """

    stl: bytes
    rays: RayBundle
    optical: OpticalFaces
    designed: Sequence[tuple[str, Screen, Float[np.ndarray, "_ _"]]]

    @property
    def count(self) -> int:
        """Number of the lamps."""
        return 1 if self.optical.plate is None else len(self.optical.plate.places)

    @cached_property
    def part(self) -> PartMesh:
        """The mesh of the plate."""
        return read_part_mesh(self.stl, self.optical)

    def cast(self, media: Media, threads: int) -> Passage:
        """Cast the rays through the mesh of the plate.

        As in the design's sum, a ray that leaves its lens meets no other one: such light is stray.
        """
        return send_through(self.part, Grid(self.part.mesh), self.rays, media, threads)


@dataclass(frozen=True, eq=False)
class LampStands:
    """Places (mm) of lamps, and their axes as columns."""

    places: Float[np.ndarray, "k 3"]
    axes: Float[np.ndarray, "k 3 3"]

    def stood(self, passage: Passage, numbers: int | Int[np.ndarray, " n"]) -> Passage:
        """A ``passage`` through the part at the origin, moved to one lamp, or each ray to its own lamp by number."""
        turned = self.axes[numbers]
        points, directions = (
            np.einsum("...ij,...j", turned, vectors) for vectors in (passage.points, passage.directions)
        )
        return replace(passage, points=points + self.places[numbers], directions=directions)


ONE_LAMP = LampStands(np.zeros((1, 3)), np.eye(3)[None])


@dataclass(frozen=True, eq=False)
class LampsApart:
    """Lamps with a part each: their places, the lamp of each ray, and the design's light as above."""

    stands: LampStands
    numbers: Int[np.ndarray, " n"]
    designed: Sequence[tuple[str, Screen, Float[np.ndarray, "_ _"]]]

    @property
    def count(self) -> int:
        """Number of the lamps."""
        return len(self.stands.places)


def light_of_lamps(
    lamps: LampsOnPlate | LampsApart, alone: Passage, rays: RayBundle, media: Media, threads: int
) -> tuple[LampsTogether, ...]:
    """Light of all ``lamps`` on each receiver; ``alone``: the passage of ``rays`` through one lamp's part."""
    passage = (
        lamps.cast(media, threads) if isinstance(lamps, LampsOnPlate) else lamps.stands.stood(alone, lamps.numbers)
    )
    together = []
    for name, screen, designed in lamps.designed:
        landed = passage.landed(screen)
        _, off, noise_floor = screen.against(landed.landings, lamps.count * landed.flux, designed)
        together.append(
            LampsTogether(
                name=name,
                lamps=lamps.count,
                rays=len(rays),
                efficiency=share(rays, landed.flux[screen.in_window(landed.landings)]),
                nmse_vs_sum=off,
                noise_floor_nmse=noise_floor,
            )
        )
    return tuple(together)
