"""Stray light, which the sequential design leaves out: reflections and the base; its flux, and where it lands.

The non-sequential trace of the part is compared with the sequential trace of the same rays through the same mesh. The
board and the chip under the lens are not modelled: they absorb all light that comes back to them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.media import Media
from lensforge.proof.acceptance import stray_criteria
from lensforge.proof.body_cast import behind_optics
from lensforge.proof.facet_casting import Grid
from lensforge.proof.nonsequential_trace import Base, Cause, FluxBudget, Limits, PartBody, follow
from lensforge.proof.optical_faces import USUAL_LENS, OpticalFaces, PlateOfLenses
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
    limits: Limits | None = None,
    threads: int = 1,
    inputs: Mapping[str, str] | None = None,
) -> StrayLight:
    """Follow ``rays`` through the part in the bytes of an STL file (mm) until all light has left it.

    Shares are of the emitted flux; "detected" is what lands in the window of each of ``screens``, of ``names``.
    ``optical``: the faces of the part, and the events of its light. The result does not depend on ``threads``.
    ``inputs``: hashes of the inputs, by name. Raises :class:`InputError` for bytes that hold no mesh, and for an
    unknown ``base``.
    """
    require_choice("base", base, get_args(Base))
    start = perf_counter()
    limits = limits or Limits()
    part = read_part_mesh(stl, optical)
    grid = Grid(part.mesh)
    budget = follow(PartBody(part, grid, media, base), rays, limits, threads)
    passage, emitted = send_through(part, grid, rays, media, threads), float(rays.flux.sum())
    result = StrayLight(
        inputs=dict(inputs or {}),
        receivers=tuple(
            _on_receiver(name, screen, budget, passage, emitted, media, optical.plate)
            for name, screen in zip(names, screens, strict=True)
        ),
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


def _on_receiver(
    name: str,
    screen: Screen,
    budget: FluxBudget,
    passage: Passage,
    emitted: float,
    media: Media,
    plate: PlateOfLenses | None,
) -> ReceiverStray:
    """Stray light on one receiver, of ``emitted`` (W)."""
    sequential, landed = passage.landed(screen), _ReceivedLight.of(budget, screen, media, plate)
    reference, flux = screen.irradiance(sequential.landings, sequential.flux), _flux(budget, landed, emitted)
    direct, stray = (
        screen.irradiance(landed.points[rows], landed.flux[rows]) for rows in (~landed.stray, landed.stray)
    )
    whole = direct + stray
    return ReceiverStray(
        name=name,
        width=screen.width,
        height=screen.height,
        far_field=screen.is_far,
        flux=flux,
        balance_error=abs(sum(flux.model_dump().values()) - 1.0),
        detected_stray_by_cause=_by_cause(landed, emitted),
        misplaced_flux=float(np.abs(whole - reference).sum()) * screen.pixel_measure / emitted,
        nmse_vs_sequential=nmse(whole, reference) if reference.any() else None,
        peak_of_mean=float(stray.max() / reference.mean()) if reference.any() else None,
        efficiency=flux.detected_direct + flux.detected_stray,
        efficiency_sequential=float(sequential.flux[screen.in_window(sequential.landings)].sum()) / emitted,
        sequential=reference,
        direct=direct,
        stray=stray,
    )


@dataclass(frozen=True)
class _ReceivedLight:
    """Light on the receiver's surface: places on its chart, flux (W), causes, in the window; and what missed it (W).

    ``bodies_w`` and ``glass_w``: what the further bodies and the cover glass took of the light that came to them.
    """

    points: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]
    in_window: Bool[np.ndarray, " n"]
    missed_w: float
    bodies_w: float
    glass_w: float

    @staticmethod
    def of(budget: FluxBudget, screen: Screen, media: Media, plate: PlateOfLenses | None) -> "_ReceivedLight":
        """Land the light that has left the part."""
        escaped = budget.escaped()
        ends = escaped.points, escaped.directions
        behind = behind_optics(*ends, media, escaped.wavelengths_nm, escaped.fields, plate)
        places, out_of_bodies = screen.land(behind.points, behind.directions), escaped.flux * behind.through_bodies
        reached, left = ~np.isnan(places[:, 0]), out_of_bodies * behind.through_glass
        return _ReceivedLight(
            places[reached],
            left[reached],
            escaped.causes[reached],
            screen.in_window(places[reached]),
            missed_w=float(left[~reached].sum()),
            bodies_w=float((escaped.flux - out_of_bodies).sum()),
            glass_w=float((out_of_bodies - left).sum()),
        )

    @property
    def stray(self) -> Bool[np.ndarray, " n"]:
        """True for light off the sequential path."""
        stray: Bool[np.ndarray, " n"] = self.causes != Cause.SEQUENTIAL
        return stray


def _flux(budget: FluxBudget, landed: _ReceivedLight, emitted: float) -> StrayFlux:
    flux, inside, stray = landed.flux, landed.in_window, landed.stray
    return StrayFlux(
        detected_direct=float(flux[inside & ~stray].sum()) / emitted,
        detected_stray=float(flux[inside & stray].sum()) / emitted,
        outside_direct=float(flux[~inside & ~stray].sum()) / emitted,
        outside_stray=float(flux[~inside & stray].sum()) / emitted,
        backward=landed.missed_w / emitted,
        absorbed=budget.absorbed / emitted,
        cover_glass=landed.glass_w / emitted,
        bodies=landed.bodies_w / emitted,
        base=budget.base / emitted,
        too_dim=budget.cut_off / emitted,
        leaked=budget.leaked / emitted,
    )


def _by_cause(landed: _ReceivedLight, emitted: float) -> StrayByCause:
    inside = landed.in_window
    stray = [cause for cause in Cause if cause != Cause.SEQUENTIAL]
    return StrayByCause.model_validate(
        {cause.name.lower(): float(landed.flux[inside & (landed.causes == cause)].sum()) / emitted for cause in stray}
    )
