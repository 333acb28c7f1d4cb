"""Stray light, which the sequential design leaves out: reflections and the base; its flux, and where it lands.

The non-sequential trace of the part is compared with the sequential trace of the same rays through the same mesh. The
board and the chip under the lens are not modelled: they absorb all light that comes back to them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TypeVar, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.media import Media
from lensforge.proof.acceptance import stray_criteria
from lensforge.proof.body_cast import behind_optics
from lensforge.proof.facet_casting import Grid
from lensforge.proof.nonsequential_trace import Base, Cause, FluxBudget, Limits, PartBody, follow
from lensforge.proof.optical_faces import USUAL_LENS, OpticalFaces, PlateOfLenses
from lensforge.proof.part_comparison import ONE_LAMP, LampStands
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_result import ReceiverStray, StrayByCause, StrayFlux, StrayLight
from lensforge.proof.receiver_screen import Screen, nmse
from lensforge.proof.sequential_cast import Passage, send_through
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
    emitted, split = float(rays.flux.sum()), _SplitLight.of(budget, media, optical.plate)
    light = _Light(lamps, emitted, budget, split, send_through(part, grid, rays, media, threads))
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


@dataclass(frozen=True)
class _SplitLight:
    """Light that has left one part and all behind it: where, flux (W) and causes; and what that took of it (W)."""

    points: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]
    bodies_w: float
    glass_w: float

    @staticmethod
    def of(budget: FluxBudget, media: Media, plate: PlateOfLenses | None) -> "_SplitLight":
        """Take the light that has left the part through the further bodies and the cover glass."""
        escaped = budget.escaped()
        ends = escaped.points, escaped.directions
        behind = behind_optics(*ends, media, escaped.wavelengths_nm, escaped.fields, plate)
        out_of_bodies = escaped.flux * behind.through_bodies
        left = out_of_bodies * behind.through_glass
        return _SplitLight(
            behind.points,
            behind.directions,
            left,
            escaped.causes,
            bodies_w=float((escaped.flux - out_of_bodies).sum()),
            glass_w=float((out_of_bodies - left).sum()),
        )


@dataclass(frozen=True)
class _LampLight:
    """Shares of the light of one lamp on a receiver; ``sequential``: of what is not split in the window."""

    flux: StrayFlux
    causes: StrayByCause
    sequential: float


@dataclass(frozen=True)
class _Light:
    """Light of one lamp that emits so much (W), behind the part: ``split`` at its faces, and a ``passage`` that is not.

    ``lamps``: where those stand that have it.
    """

    lamps: LampStands
    emitted_w: float
    budget: FluxBudget
    split: _SplitLight
    passage: Passage

    def of_lamp(self, number: int, screen: Screen, images: Float[np.ndarray, "3 h w"]) -> _LampLight:
        """Light of the lamp of a number on a receiver.

        ``images``: of what is not split, of the rest as designed, and stray, to which its own are added.
        """
        split, landed = self.split, self.lamps.stood(self.passage, number).landed(screen)
        places = screen.land(*self.lamps.moved(split.points, split.directions, number))
        reached, stray = ~np.isnan(places[:, 0]), split.causes != Cause.SEQUENTIAL
        inside, rows = screen.in_window(places), [reached & ~stray, reached & stray]
        images[0] += screen.irradiance(landed.landings, landed.flux)
        images[1:] += [screen.irradiance(places[some], split.flux[some]) for some in rows]

        def share(some: Bool[np.ndarray, " n"]) -> float:
            return float(split.flux[some].sum()) / self.emitted_w

        flux = StrayFlux(
            detected_direct=share(inside & ~stray),
            detected_stray=share(inside & stray),
            outside_direct=share(reached & ~inside & ~stray),
            outside_stray=share(reached & ~inside & stray),
            backward=share(~reached),
            absorbed=self.budget.absorbed / self.emitted_w,
            cover_glass=split.glass_w / self.emitted_w,
            bodies=split.bodies_w / self.emitted_w,
            base=self.budget.base / self.emitted_w,
            too_dim=self.budget.cut_off / self.emitted_w,
            leaked=self.budget.leaked / self.emitted_w,
        )
        causes = {each.name.lower(): share(inside & (split.causes == each)) for each in Cause}
        del causes[Cause.SEQUENTIAL.name.lower()]
        sequential = float(landed.flux[screen.in_window(landed.landings)].sum()) / self.emitted_w
        return _LampLight(flux, StrayByCause(**causes), sequential)

    def on(self, name: str, screen: Screen) -> ReceiverStray:
        """Stray light of all lamps on one receiver; shares are of the flux of all."""
        images = np.zeros((3, screen.rows, screen.columns))
        lit = [self.of_lamp(number, screen, images) for number in range(len(self.lamps.places))]
        reference, direct, stray = images
        flux, whole = _mean([each.flux for each in lit]), direct + stray
        misplaced_w = float(np.abs(whole - reference).sum()) * screen.pixel_measure
        return ReceiverStray(
            name=name,
            width=screen.width,
            height=screen.height,
            far_field=screen.is_far,
            flux=flux,
            balance_error=abs(sum(flux.model_dump().values()) - 1.0),
            detected_stray_by_cause=_mean([each.causes for each in lit]),
            misplaced_flux=misplaced_w / (len(lit) * self.emitted_w),
            nmse_vs_sequential=nmse(whole, reference) if reference.any() else None,
            peak_of_mean=float(stray.max() / reference.mean()) if reference.any() else None,
            efficiency=flux.detected_direct + flux.detected_stray,
            efficiency_sequential=float(np.mean([each.sequential for each in lit])),
            sequential=reference,
            direct=direct,
            stray=stray,
        )


_Shares = TypeVar("_Shares", StrayFlux, StrayByCause)


def _mean(shares: Sequence[_Shares]) -> _Shares:
    """Mean of the shares of lamps."""
    dumped = [each.model_dump() for each in shares]
    return type(shares[0])(**{name: float(np.mean([each[name] for each in dumped])) for name in dumped[0]})
