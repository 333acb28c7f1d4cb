"""Rays by a radiance fitted to those of a file, in any number; stray light remains that of the file.

Rays that no fit has seen decide how fine the model is, and whether it is nearer to them than the rays of the file are.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from hashlib import sha256
from math import prod
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.seeds import OF_FILE, sobol
from lensforge.sources.light_surface import LightSurface
from lensforge.sources.measured_rays import smoothed
from lensforge.sources.radiance_emitter import RadianceEmitter
from lensforge.sources.radiance_fit import Detail, FittedRadiance
from lensforge.sources.ray_bundle import RayBundle, towards
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.surfaces.mirror_group import NAMES, generators

_FITTED = 2**20  # rays at most; those of a larger file are chosen at random
_CHOOSING = 100_000  # rays at most by which the detail is chosen
_JUDGED_BY = 0.2  # of the rays
_ERRORS = 1.0  # standard errors of the likelihood by which finer detail must be better
_LEAST_EFFECTIVE = 2000.0  # rays
_MOST_STRAY = 0.1  # of the flux
_LEAST_WIDTH_MM = 1e-6  # of the surface
_LEAST_START = 0.01  # of the flux starts lower
_SIDES = 6, 3, 6  # blocks of place and angle
_BLOCKS = _SIDES[0] * prod(_SIDES)
_SIDES_OF_IMAGES = (6, 3, 12), (24, 1, 1)  # with images that are blocks themselves
_DRAWN = 2**18  # rays of a model that is judged
_STEPS_OF_CHOICE = 25
_STEPS_AGAIN = 20
_MOST_FACTORS = 64
_MOST_CELLS = 96
_LEAST_BLUR = 0.5
_MOST_AZIMUTHS = 48


@dataclass(frozen=True, eq=False)
class ModelledRays:
    """Rays drawn by the ``radiance`` fitted to those of ``file``, and of its ``stray`` rays the share they have.

    ``lit``, ``stray``: rays of the file, about its own origin; ``judges`` are others, which no fit has seen.
    ``start_mm``: height at which rays start, or on the surface where that is higher; ``reach_mm``: from the surface at
    most. ``off``: upper bound of its relative rms difference from held-back rays; ``chance``: that of the file's rays.
    """

    file: RaySetEmitter
    radiance: FittedRadiance
    lit: RayBundle
    stray: RayBundle
    judges: RayBundle
    start_mm: float
    reach_mm: float
    symmetry: str = "none"
    ray_count: int | None = None
    off: float = 0.0
    chance: float = 0.0

    @staticmethod
    def of(file: RaySetEmitter, rays: RayBundle, judges: RayBundle, radiance: FittedRadiance) -> "ModelledRays":
        """The model of a ``file`` by the ``radiance`` fitted to some of its rays; ``judges``: the others."""
        surface = radiance.surface
        lit = surface.holds(rays)
        inside = rays.take(lit)
        order = np.argsort(inside.origins[:, 2])
        starts = np.cumsum(inside.flux[order])
        lowest = inside.origins[order[np.searchsorted(starts, _LEAST_START * starts[-1])], 2]
        starts_within = surface.outward(*surface.inward(inside))[0]
        reach = np.linalg.norm(inside.origins - starts_within, axis=1).max()
        return ModelledRays(file, radiance, inside, rays.take(~lit), judges, float(lowest), float(reach))

    @property
    def held_back(self) -> RaySetEmitter:
        """Rays of the file unseen by any fit, and so by any search."""
        return RaySetEmitter(self.judges.placed(self.file.pose), self.flux_w, symmetry=self.file.symmetry)

    @property
    def flux_w(self) -> float:
        """Flux (W) of the file."""
        return self.file.flux_w

    @property
    def summary(self) -> Any:
        """Summary of the file, with a description of the model."""
        return None if self.file.summary is None else self.file.summary.changed(model=self.description)

    @property
    def description(self) -> str:
        """Short description of the model."""
        detail = self.radiance.detail
        (rows, columns) = self.radiance.shape
        surface = self.radiance.surface
        dome = f" in a dome of {surface.dome.radius:.3g} mm, n = {surface.dome.index:.3g}," if surface.dome else ","
        images = "" if surface.mirrors == "none" else f" and its images under {surface.mirrors},"
        factors = "1 factor" if detail.factors == 1 else f"{detail.factors} factors"
        cells_and_angles = f"{columns} x {rows} cells{images} and {detail.rings} x {detail.azimuths} angles{dome}"
        stray = f"{100.0 * self.stray_share:.2g} % of the flux are rays of the file"
        accuracy = f"at most {self.off:.2g} off rays held back, the file's own rays {self.chance:.2g} by chance"
        return f"radiance of {factors} on {cells_and_angles} fitted to {len(self.lit):,} rays; {accuracy}; {stray}"

    @cached_property
    def stray_share(self) -> float:
        """Share of the flux that is stray, not from the surface."""
        stray = float(self.stray.flux.sum())
        return stray / (stray + float(self.lit.flux.sum()))

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline (mm) of the file's rays."""
        return self.file.outline()

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays of equal flux by quasi-Monte-Carlo points: four numbers for each, one for its colour."""
        rays, _ = self._drawn(count, seed)
        return rays.placed(self.file.pose)

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of a sample, each turned to its target (mm); their flux is W/sr there.

        Stray rays are turned as those of a file are, and so are all from a dome.
        """
        rays, places = self._drawn(len(targets), seed)
        local_targets = self.file.pose.to_local_points(targets)
        lit = np.isfinite(places[:, 0]) & (self.radiance.surface.dome is None)
        away = local_targets - places
        along = np.where(lit[:, None], away / np.linalg.norm(away, axis=1, keepdims=True), rays.directions)
        share = np.where(lit, self._emitter.table.intensity(np.where(lit[:, None], places, 0.0), along), 0.0)
        aimed = replace(
            rays, origins=np.where(lit[:, None], places, rays.origins), directions=along, flux=rays.flux * share
        )
        if not lit.all():
            turned = smoothed(RaySetEmitter(rays.take(~lit), float(rays.flux[~lit].sum())))
            far = towards(turned, local_targets[~lit], seed)
            for name in ("origins", "directions", "flux"):
                getattr(aimed, name)[~lit] = getattr(far, name)
        return aimed.placed(self.file.pose)

    def refitted(self, seed: int) -> "ModelledRays":
        """A model of rays redrawn from the file with replacement: it shows the uncertainty that the file leaves."""
        random = np.random.default_rng(seed)
        lit, stray = (
            replace(rays, flux=rays.flux * random.poisson(1.0, len(rays))) if len(rays) else rays
            for rays in (self.lit, self.stray)
        )
        return replace(self, radiance=self.radiance.fitted(lit, _STEPS_AGAIN), lit=lit, stray=stray)

    @cached_property
    def _emitter(self) -> RadianceEmitter:
        return RadianceEmitter(self.radiance.table(), 1.0)

    def _drawn(self, count: int, seed: int) -> tuple[RayBundle, Float[np.ndarray, "n 3"]]:
        """Rays about the file's origin, and the point (mm) of the surface from which each comes; NaN of stray ones."""
        if count < 1:
            raise InputError(f"{count} rays: at least 1")
        coloured = self.lit.waves is not None or self.lit.tristimulus is not None
        share = self.stray_share
        points = sobol(count, 5 if coloured else 4, seed)
        stray = np.flatnonzero(points[:, 0] < share)
        flux = np.cumsum(self.stray.flux)
        chosen = np.searchsorted(flux, points[stray, 0] / share * flux[-1], side="right") if len(stray) else stray
        chosen = np.minimum(chosen, len(flux) - 1)
        points[:, 0] = np.clip((points[:, 0] - share) / (1.0 - share), 0.0, np.nextafter(1.0, 0.0))
        inner, within = self._emitter.emit(points[:, :4])
        places, directions = self.radiance.surface.outward(inner, within)
        along = np.maximum(self.start_mm - places[:, 2], 0.0) / np.maximum(directions[:, 2], 1e-9)
        origins = places + np.minimum(along, self.reach_mm)[:, None] * directions
        origins[stray] = self.stray.origins[chosen]
        directions[stray] = self.stray.directions[chosen]
        places[stray] = np.nan
        rays = RayBundle(origins, directions, np.full(count, self.flux_w / count))
        if not coloured:
            return rays, places
        rows = self._alike(self.radiance.surface.blocks(inner, within, _SIDES), points[:, 4])
        rows[stray] = len(self.lit) + chosen
        like = RayBundle.joined([self.lit, self.stray]).take(rows)
        return replace(like, origins=origins, directions=directions, flux=rays.flux), places

    def _alike(self, blocks: Int[np.ndarray, " n"], numbers: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Numbers of file rays, drawn by flux, near the place and angle of each ray: they give its colour."""
        cumulative, order, ends = self._by_block
        first = np.where(blocks > 0, ends[blocks - 1], 0.0)
        chosen = np.searchsorted(cumulative, first + numbers * (ends[blocks] - first), side="right")
        return order[np.minimum(chosen, len(order) - 1)]

    @cached_property
    def _by_block(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Flux up to each ray in the order of the blocks, that order, and the flux up to the end of each block."""
        blocks = _blocks(self.radiance.surface, self.lit)
        order = np.argsort(blocks, kind="stable")
        by_block = np.bincount(blocks, self.lit.flux, _BLOCKS)
        return np.cumsum(self.lit.flux[order]), order, np.cumsum(by_block)


def _some(file: RaySetEmitter, most: int) -> RayBundle:
    """Rays of the file about its local origin, in random order."""
    order = np.random.default_rng(OF_FILE).permutation(len(file))[:most]
    return file.rays.take(order).seen_from(file.pose)


def _blocks(surface: LightSurface, rays: RayBundle) -> Int[np.ndarray, " n"]:
    return surface.blocks(*surface.inward(rays), _SIDES)


@dataclass(frozen=True)
class _Content:
    """A file's rays as a cache key: the stages of a design load them again and again."""

    file: RaySetEmitter = field(compare=False)
    digest: str

    @staticmethod
    def of(file: RaySetEmitter) -> "_Content":
        """The file, with a digest of a million of its rays and of their pose."""
        rays = _some(file, _FITTED)
        digest = sha256(f"{len(file)} {file.flux_w} {file.pose}".encode())
        for column in (rays.origins, rays.directions, rays.flux, rays.wavelengths_nm, rays.tristimulus):
            digest.update(b"none" if column is None else np.ascontiguousarray(column).tobytes())
        return _Content(file, digest.hexdigest())


def modelled(file: RaySetEmitter, wanted: str) -> RaySetEmitter | ModelledRays:
    """``file`` as ``wanted``: "rays" unchanged, "radiance" its model, "auto" the one nearer to held-back rays.

    Raises :class:`InputError` if a model is wanted of rays that have none.
    """
    if wanted == "rays":
        return file
    model = _best(_Content.of(file))
    if isinstance(model, ModelledRays):
        return replace(model, file=file)
    if wanted == "radiance":
        raise InputError(f'source.model = "radiance": {model}; set source.model = "rays", or "auto"')
    summary = file.summary
    return file if summary is None else replace(file, summary=summary.changed(model=f"rays: {model}"))


@lru_cache(maxsize=4)
def _best(content: _Content) -> ModelledRays | str:
    """The model of the rays; the reason why there is none, if the rays themselves are as good."""
    file = content.file
    rays = _some(file, round(_FITTED / (1.0 - _JUDGED_BY)))
    effective = float(rays.flux.sum() ** 2 / np.sum(rays.flux**2))
    if effective < _LEAST_EFFECTIVE:
        return f"{effective:.0f} effective rays are too few for a model: at least {_LEAST_EFFECTIVE:.0f}"
    surfaces = _surfaces(rays)
    if isinstance(surfaces, str):
        return surfaces
    judges = round(_JUDGED_BY * len(rays))
    judging = rays.take(slice(0, judges))
    fitting = rays.take(slice(judges, len(rays)))
    few = judging.take(slice(0, round(_JUDGED_BY * _CHOOSING))), fitting.take(slice(0, _CHOOSING))
    chosen = _chosen(*few, _with_images(_likeliest(*few, surfaces), rays))
    surface = chosen.surface
    model = FittedRadiance.of(fitting.take(surface.holds(fitting)), surface, chosen.detail)
    noise = _BLOCKS / (effective * len(file) / len(rays))
    apart = _apart(model, judging.take(surface.holds(judging)))
    error = np.sqrt(2.0 * _BLOCKS) / judges
    chance = noise**0.5
    if apart > noise + 3.0 * error:
        return f"the model is {np.sqrt(apart):.2g} off rays held back, those of the file {chance:.2g} by chance"
    off = float(np.sqrt(max(apart, 0.0) + 2.0 * error))
    return replace(ModelledRays.of(file, fitting, judging, model), off=off, chance=chance)


def _surfaces(rays: RayBundle) -> list[LightSurface] | str:
    """Candidate emitting surfaces, or the reason for rejecting all."""
    if np.ptp(rays.directions[:, :2], axis=0).max() < 0.1:
        return "parallel rays do not tell where they come from"
    surfaces = []
    for curved in (False, True):
        surface = LightSurface.of(rays, curved=curved)
        stray = 1.0 - float(rays.flux[surface.holds(rays)].sum() / rays.flux.sum())
        if stray <= _MOST_STRAY and (surface.high - surface.low).min() > _LEAST_WIDTH_MM:
            surfaces.append(surface)
    dome = LightSurface.in_dome(rays.take(surfaces[0].holds(rays)), surfaces[0]) if surfaces else None
    if surfaces:
        return surfaces if dome is None else [*surfaces, dome]
    if (surface.high - surface.low).min() <= _LEAST_WIDTH_MM:
        return "its rays come from a point or a line, which has no radiance"
    return f"{100.0 * stray:.2g} % of the flux comes from no common surface: at most {100.0 * _MOST_STRAY:.0f} %"


def _better(judging: RayBundle, new: FittedRadiance, old: FittedRadiance) -> bool:
    gain = (new.logarithms(judging) - old.logarithms(judging)) * (judging.flux / judging.flux.mean())
    return float(gain.mean()) > _ERRORS * float(gain.std()) / len(gain) ** 0.5


def _likeliest(judging: RayBundle, fitting: RayBundle, surfaces: list[LightSurface]) -> LightSurface:
    """The surface with the largest likelihood of the ``judging`` rays, with a single factor on each."""
    held = [np.all([surface.holds(rays) for surface in surfaces], axis=0) for rays in (judging, fitting)]
    judging = judging.take(held[0])
    fitting = fitting.take(held[1])
    best, *further = (FittedRadiance.of(fitting, surface, Detail(), _STEPS_OF_CHOICE) for surface in surfaces)
    for candidate in further:
        best = candidate if _better(judging, candidate, best) else best
    return best.surface


def _with_images(surface: LightSurface, rays: RayBundle) -> LightSurface:
    """``surface`` with the largest mirror group whose images of ``rays`` differ from them only by chance."""
    rays = rays.take(surface.holds(rays))
    wide = surface.mirrored(rays, "square")
    weights = rays.flux / rays.flux.sum()
    (points, along) = wide.inward(rays)
    middle = np.append(0.5 * (wide.low + wide.high), 0.0)

    def unchanged(mirror: Float[np.ndarray, "3 3"]) -> bool:
        images = middle + (points - middle) @ mirror
        for sides in _SIDES_OF_IMAGES:
            rows = wide.blocks(points, along, sides), wide.blocks(images, along @ mirror, sides)
            sums = [[np.bincount(row, weights**power, sides[0] * prod(sides)) for power in (1, 2)] for row in rows]
            (counts, noise), (image, image_noise) = sums
            lit = noise + image_noise > 0.0  # each difference is there twice, so that its sum has twice the variance
            deviationof_group = float(((counts - image)[lit] ** 2 / (noise + image_noise)[lit]).sum())
            if deviationof_group > lit.sum() + 6.0 * np.sqrt(lit.sum()):
                return False
        return True

    same = [mirror for mirror in generators("square") if unchanged(mirror)]
    names = (
        name
        for name in reversed(NAMES)
        if all(
            any(np.array_equal(generator, known_generator) for known_generator in same)
            for generator in generators(name)
        )
    )
    name_of_group = next(names)
    return surface if name_of_group == "none" else surface.mirrored(rays, name_of_group)


def _chosen(judging: RayBundle, fitting: RayBundle, surface: LightSurface) -> FittedRadiance:
    """The model of ``fitting`` with the largest likelihood of the ``judging`` rays."""
    judging = judging.take(surface.holds(judging))
    fitting = fitting.take(surface.holds(fitting))
    best = FittedRadiance.of(fitting, surface, Detail(), _STEPS_OF_CHOICE)
    tried = {best.detail}
    while (
        detail := next((detail_tried for detail_tried in _finer(best.detail) if detail_tried not in tried), None)
    ) is not None:
        tried.add(detail)
        new = FittedRadiance.of(fitting, surface, detail, _STEPS_OF_CHOICE)
        best = new if _better(judging, new, best) else best
    return best


def _finer(detail: Detail) -> Iterator[Detail]:
    """Details that may improve on ``detail``, the most promising first."""
    if detail.factors < _MOST_FACTORS:
        yield replace(detail, factors=2 * detail.factors)
    if detail.cells < _MOST_CELLS:
        yield replace(detail, cells=round(1.4 * detail.cells), blur=round(1.4 * detail.blur, 2))
    if detail.factors > 1 and detail.blur > _LEAST_BLUR:
        yield replace(detail, blur=round(0.6 * detail.blur, 2))
    if detail.azimuths < _MOST_AZIMUTHS:
        yield replace(detail, rings=round(1.5 * detail.rings), azimuths=2 * detail.azimuths)


def _apart(model: FittedRadiance, judging: RayBundle) -> float:
    """Mean square relative difference of ``model`` from ``judging`` over blocks, weighted by flux, without their noise.

    The noise of rays of equal flux is the number of blocks over the number of rays.
    """
    places, directions = RadianceEmitter(model.table(), 1.0).emit(sobol(_DRAWN, 4, OF_FILE))
    weights = judging.flux / judging.flux.sum()
    numbers = _blocks(model.surface, judging)
    blocks = _BLOCKS
    seen = np.bincount(numbers, weights, blocks)
    square = np.bincount(numbers, weights**2, blocks)
    drawn = np.bincount(model.surface.blocks(places, directions, _SIDES), minlength=blocks) / _DRAWN
    scale = np.maximum(0.5 * (seen + drawn), 1e-3 / blocks)
    return float((((drawn - seen) ** 2 - square) / scale).sum())
