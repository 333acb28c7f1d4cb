"""Agreement of ray casts with their own pictures and distances, and with the light that they were compared to."""

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from lensforge.agreement.comparing import beyond, differing, judged, unlike
from lensforge.evaluation.light import Light
from lensforge.evaluation.metrics import relative_square
from lensforge.geometry.part import Part
from lensforge.verification.acceptance import (
    DEVIATION_RAD,
    agreement_of,
    balance_error,
    proof_criteria,
    stray_criteria,
)
from lensforge.verification.light_result import OwnRays
from lensforge.verification.own_rays_criteria import LEAST_RAYS
from lensforge.verification.proof import Agreement, Proof, ReceiverProof
from lensforge.verification.stray_result import StrayLight

if TYPE_CHECKING:
    from lensforge.verification.screen import Screen

_QUANTILES, _P99 = 500, 495  # intervals of the gaps' distribution, and the index of its 99 %
_LIGHT = "evaluate.json has"
_ENOUGH = 2 * _QUANTILES  # rays for a root mean square by quantiles


def proof_contradictions(
    proof: Proof, screens: "Sequence[Screen]", light: Light | None, part: Part | None = None
) -> Iterator[str]:
    """Contradictions of the record of a verification; ``screens``: the spec's receivers."""
    yield from judged("criteria", proof.criteria, proof_criteria(proof))
    yield from _sizes(proof, part)
    if len(proof.receivers) != len(screens):
        yield f"receivers: {len(proof.receivers)}, the spec has {len(screens)}"
        return
    for receiver, screen in zip(proof.receivers, screens, strict=True):
        lit = None if light is None else next((each for each in light.receivers if each.name == receiver.name), None)
        if light is not None and lit is None:
            yield f"receivers: {receiver.name}: not in evaluate.json"
        yield from _on_receiver(receiver, screen, None if lit is None else lit.map)
        if receiver.own_rays is None:
            yield f"receivers: {receiver.name}: own_rays is missing"
        elif lit is not None:
            yield from unlike("own_rays.efficiency_design", receiver.own_rays.efficiency_design, lit.efficiency, _LIGHT)
            known = lit.nmse_of_noise is not None and receiver.own_rays.rays >= LEAST_RAYS
            yield from unlike("own_rays.nmse_less_noise", receiver.own_rays.nmse_less_noise is not None, known, _LIGHT)


def _sizes(proof: Proof, part: Part | None) -> Iterator[str]:
    """The sizes against those of the export, and the files that are judged against the files that are there."""
    if proof.sizes is None or proof.emission_apart is None:
        yield f"{'sizes' if proof.sizes is None else 'emission_apart'}: missing"
        return
    yield from differing("volume_mm3", proof.volume_mm3, proof.sizes.mesh.size.volume_mm3, "its sizes")
    if part is None:
        return
    yield from unlike("sizes.exported", proof.sizes.exported, part.size, "export.json has")
    chord_mm = 1e-3 * part.triangulation.chord_error_um
    yield from differing("sizes.chord_mm", proof.sizes.chord_mm, chord_mm, "the facets in export.json")
    yield from unlike("altered_files", proof.altered_files, part.altered, "the files in the folder are")


def _on_receiver(proof: ReceiverProof, screen: "Screen", design: Float[np.ndarray, "h w"] | None) -> Iterator[str]:
    flux, limit = proof.flux, DEVIATION_RAD * screen.reach_mm(proof.design_irradiance)
    yield from differing("deviation_limit_mm", proof.deviation_limit_mm, limit, "where its light goes")
    yield from differing("flux", sum(flux.model_dump().values()), 1.0, "the laws of conservation")
    yield from differing("flux.missed", flux.missed, sum(proof.missed_by_cause.model_dump().values()), "its causes")
    yield from differing("efficiency", proof.efficiency, flux.detected, "its shares of flux")
    seen = relative_square(np.stack([proof.irradiance, proof.design_irradiance]))
    yield from differing("nmse_vs_design", proof.nmse_vs_design, seen, "its pictures")
    if design is not None and not np.array_equal(proof.design_irradiance, design):
        yield "design_irradiance: not the picture in evaluate.npz"
    yield from _gaps("deviation_mm", agreement_of(proof), proof.gaps_mesh_mm)
    if proof.brep is not None and proof.gaps_step_mm is not None:
        yield from _gaps("brep.against_design", proof.brep.against_design, proof.gaps_step_mm)
    if proof.mitsuba is not None and proof.gaps_mitsuba_mm is not None:
        yield from _gaps("mitsuba.against_design", proof.mitsuba.against_design, proof.gaps_mitsuba_mm)
    if proof.own_rays is not None:
        yield from _own_rays(proof.own_rays)
    for name, cast, gaps in (
        ("brep", proof.brep, proof.gaps_step_mm),
        ("mitsuba", proof.mitsuba, proof.gaps_mitsuba_mm),
    ):
        if (cast is None) != (gaps is None):
            yield f"{name}: {'missing' if cast is None else 'given'}, but its distances are not so"


def _own_rays(own: OwnRays) -> Iterator[str]:
    flux, source = own.flux, "its shares of flux"
    yield from differing("own_rays.flux", sum(flux.model_dump().values()), 1.0, "the laws of conservation")
    yield from differing(
        "own_rays.flux.missed", flux.missed, sum(own.missed_by_cause.model_dump().values()), "its causes"
    )
    yield from differing("own_rays.efficiency", own.efficiency.value, flux.detected, source)


def _gaps(name: str, stated: Agreement, gaps_mm: Float[np.ndarray, " q"]) -> Iterator[str]:
    """Largest, 99 % and root mean square of the distances, by their quantiles.

    Between two quantiles lie a 500th of the n rays, to one ray: so much is known of their mean square.
    """
    if len(gaps_mm) != _QUANTILES + 1 or (np.diff(gaps_mm) < 0.0).any():
        yield f"{name}: its distances are no distribution"
        return
    source = "the distances of its rays"
    yield from differing(f"{name}.max", stated.max, float(gaps_mm[-1]), source)
    yield from differing(f"{name}.p99", stated.p99, float(gaps_mm[_P99]), source)
    if stated.compared > _ENOUGH:
        squares, one = gaps_mm**2, (_QUANTILES + 1) / stated.compared
        least = sqrt(float(squares[:-1].mean()) * (1.0 - one))
        most = sqrt(float(squares[1:].mean()) * (1.0 + one))
        yield from beyond(f"{name}.rms", stated.rms, least, most, source)
    yield from beyond(
        f"{name}.fates_flux", stated.fates_flux, 0.0, 1.0 if stated.fates else 0.0, "the rays lost by one"
    )


def stray_contradictions(stray: StrayLight) -> Iterator[str]:
    """Contradictions of the record of the stray light."""
    yield from judged("criteria", stray.criteria, stray_criteria(stray))
    for receiver in stray.receivers:
        flux = receiver.flux
        yield from differing("balance_error", receiver.balance_error, balance_error(flux), "its shares of flux")
        detected = flux.detected_direct + flux.detected_stray
        yield from differing("efficiency", receiver.efficiency, detected, "its shares of flux")
        by_cause = sum(receiver.detected_stray_by_cause.model_dump().values())
        yield from differing("flux.detected_stray", flux.detected_stray, by_cause, "its causes")
