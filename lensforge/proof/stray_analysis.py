"""Stray light, which the sequential design leaves out: reflections and the base; its flux, and where it lands.

The non-sequential trace of the part is compared with the sequential trace of the same rays through the same mesh. The
board and the chip under the lens are not modelled: they absorb all light that comes back to them.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import get_args

import numpy as np
from jaxtyping import Float, Int

from lensforge.optics.media import Media
from lensforge.proof.acceptance import stray_criteria
from lensforge.proof.facet_casting import Grid
from lensforge.proof.nonsequential_trace import Base, Cause, FluxBudget, Limits, PartBody, SplitRays, follow
from lensforge.proof.optical_faces import USUAL_LENS, OpticalFaces, PlateOfLenses
from lensforge.proof.part_comparison import ONE_LAMP, LampStands
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_result import ReceiverStray, StrayByCause, StrayFlux, StrayLight
from lensforge.proof.receiver_screen import Screen, nmse
from lensforge.proof.sequential_cast import CastFate, Passage, behind_lens, send_through
from lensforge.results.arguments import require_choice
from lensforge.sources.ray_bundle import RayBundle


def trace_stray(
    stl: bytes,
    *,
    rays: RayBundle,
    media: Media,
    screens: Sequence[Screen],
    names: Sequence[str] = ("light",),
    base: Base = "polished",
    optical: OpticalFaces = USUAL_LENS,
    lamps: LampStands = ONE_LAMP,
    limits: Limits | None = None,
    threads: int = 1,
    inputs: Mapping[str, str] | None = None,
) -> StrayLight:
    """Follow ``rays`` through the part in the bytes of an STL file (mm) until all light has left it.

    Shares are of the emitted flux; "detected" is what lands in the window of each of ``screens``, of ``names``.
    ``optical``: the faces of the part, and the events of its light; ``lamps``: where those stand that send it, all of
    which light each screen: shares are means over them. The result does not depend on ``threads``.
    ``inputs``: hashes of the inputs, by name. Raises :class:`InputError` for bytes that hold no mesh, and for an
    unknown ``base``.
    """
    require_choice("base", base, get_args(Base))
    start = perf_counter()
    limits = limits or Limits()
    part = read_part_mesh(stl, optical)
    grid = Grid(part.mesh)
    budget = follow(PartBody(part, grid, media, base), rays, limits, threads)
    escaped, emitted = budget.escaped(), float(rays.flux.sum())
    split, passage = _escaped(escaped, media, optical.plate), send_through(part, grid, rays, media, threads)
    light = _Light(lamps, emitted, budget, split, escaped.causes, passage)
    result = StrayLight(
        inputs=dict(inputs or {}),
        receivers=tuple(light.on(name, screen) for name, screen in zip(names, screens, strict=True)),
        rays=len(rays),
        base=base,
        lenses=1 if optical.plate is None else len(optical.plate.places),
        neighbours=budget.neighbours / emitted,
        absorption_per_mm=media.body.absorption_per_mm,
        cut_off=limits.cut_off,
        depth=limits.depth,
        criteria=(),
        seconds=perf_counter() - start,
    )
    return result.changed(criteria=stray_criteria(result))


def _escaped(light: SplitRays, media: Media, plate: PlateOfLenses | None) -> Passage:
    """Light that has left the part, behind the further bodies and the cover glass."""
    rays = RayBundle(light.points, light.directions, light.flux).with_wavelengths(light.wavelengths_nm)
    ends = {"points": light.points, "directions": light.directions, "fields": light.fields}
    left = replace(Passage.of(rays, 0), fates=np.full(len(rays), CastFate.LANDED), **ends)
    return behind_lens(left, rays, media, plate)


@dataclass(frozen=True)
class _Light:
    """Light of one lamp that emits so much (W): split at the faces, by ``causes``, and a ``passage`` that is not.

    ``lamps``: where those stand that have it. ``lost``: what has not left the part (W).
    """

    lamps: LampStands
    emitted_w: float
    lost: FluxBudget
    split: Passage
    causes: Int[np.ndarray, " n"]
    passage: Passage

    def of_lamp(self, number: int, screen: Screen, images: Float[np.ndarray, "3 h w"]) -> dict[str, float]:
        """Flux (W) by its end of the lamp of a number on a receiver; and the stray by its cause.

        ``images``: of what is not split, of the rest as designed, and stray, to which its own are added.
        """
        split, plain = (self.lamps.stood(each, number).landed(screen) for each in (self.split, self.passage))
        reached, stray = split.fates == CastFate.LANDED, self.causes != Cause.SEQUENTIAL
        inside, direct = screen.in_window(split.landings), ~stray
        images[0] += screen.irradiance(plain.landings, plain.flux)
        for image, some in zip(images[1:], (direct, stray), strict=True):
            image += screen.irradiance(split.landings[some], split.flux[some])
        by_cause = {f"by {cause.name.lower()}": inside & (self.causes == cause) for cause in Cause}
        ends = {
            "detected_direct": inside & direct,
            "detected_stray": inside & stray,
            "outside_direct": reached & ~inside & direct,
            "outside_stray": reached & ~inside & stray,
            "backward": ~reached,
        }
        return {name: float(split.flux[some].sum()) for name, some in (ends | by_cause).items()} | {
            "sequential": float(plain.flux[screen.in_window(plain.landings)].sum()),
            "absorbed": self.lost.absorbed,
            "cover_glass": float(split.in_glass.sum()),
            "bodies": float(split.in_bodies.sum()),
            "base": self.lost.base,
            "too_dim": self.lost.cut_off,
            "leaked": self.lost.leaked,
        }

    def on(self, name: str, screen: Screen) -> ReceiverStray:
        """Stray light of all lamps on one receiver; shares are of the flux of all."""
        sums, images, count = Counter[str](), np.zeros((3, screen.rows, screen.columns)), len(self.lamps.places)
        for number in range(count):
            sums.update(self.of_lamp(number, screen, images))
        shares, (reference, direct, stray) = (
            {end: watts / (count * self.emitted_w) for end, watts in sums.items()},
            images,
        )
        flux, whole = StrayFlux(**{end: shares[end] for end in StrayFlux.model_fields}), direct + stray
        misplaced_w = float(np.abs(whole - reference).sum()) * screen.pixel_measure
        return ReceiverStray(
            name=name,
            width=screen.width,
            height=screen.height,
            far_field=screen.is_far,
            flux=flux,
            balance_error=abs(sum(flux.model_dump().values()) - 1.0),
            detected_stray_by_cause=StrayByCause(**{each: shares[f"by {each}"] for each in StrayByCause.model_fields}),
            misplaced_flux=misplaced_w / (count * self.emitted_w),
            nmse_vs_sequential=nmse(whole, reference) if reference.any() else None,
            peak_of_mean=float(stray.max() / reference.mean()) if reference.any() else None,
            efficiency=flux.detected_direct + flux.detected_stray,
            efficiency_sequential=shares["sequential"],
            sequential=reference,
            direct=direct,
            stray=stray,
        )
