"""Acceptance of an exported part by its ray casts: the limits, and the criteria on the results of each cast.

The criteria follow from the results alone, so that the criteria in a file can be held against what the file's own
numbers say.
"""

from collections.abc import Iterator

from lensforge.criteria import Criterion, at_most
from lensforge.verification.advice import FINER, Evidence, form_of_mesh
from lensforge.verification.allowances import FLUX_SHARE, NOISE_ALLOWANCE
from lensforge.verification.own_rays_criteria import emission_criterion, own_rays_criteria
from lensforge.verification.proof import Agreement, BrepCast, MitsubaCast, PlainCast, Proof, ReceiverProof
from lensforge.verification.size_criteria import other_body, size_criteria
from lensforge.verification.stray_result import StrayFlux, StrayLight

# Rays may land as far off as if the lens turned them by so much, rms: 0.1 mm for each metre that the light goes, more
# where it arrives at a slope (Screen.reach_mm). A lens a few mm wide that is 1 % too large or has a
# surface displaced by 20 um is at several times that; 200,000 triangles of the roughest lens use a fifth of it.
DEVIATION_RAD = 1e-4
FATE_SHARE = FLUX_SHARE  # of rays that end otherwise
# With the same rays the irradiance may change by a tenth of what other rays would change, or by 1 % rms of itself.
SAME_RAYS_FLOORS, SAME_RAYS_ALLOWANCE = 0.1, 1e-4
# The difference from the design's irradiance may be noise only: that of both, if the design has no fewer rays.
NOISE_FLOORS = 2.5
FINE_FACETS_UM = 1.0  # rms height of the faces over their facets, 0.34 as exported: such facets land rays right

BREP_RAYS = 1024  # through the STEP file: the CAD kernel casts a few hundred in a second
# Half of the mesh's limit. The B-rep itself lands rays within 0.1 um at 150 mm of the exact surfaces; the
# deviation from the design is that of the design's own table: 4 um at draft accuracy, 2 um at standard.
BREP_DEVIATION_RAD = 5e-5
BREP_FLUX_SHARE = 1e-4
BREP_FATE_RAYS = 2  # of 1024: rays that graze an edge or the limit of total reflection may end either way

# 1 mrad, rms: flat facets of a mesh of 200,000 triangles use 0.2 to 0.4 of it. Smaller
# errors are found by the casts through the curved surface.
MITSUBA_DEVIATION_RAD = 1e-3
MITSUBA_FLUX_SHARE = MITSUBA_FATE_SHARE = 2e-3

BALANCE = 1e-9  # shares of flux add up to 1: nothing is drawn at random
LEAK_SHARE = 1e-3  # light that passes through the mesh at an edge
DIM_SHARE = 1e-2  # rays below the flux cut-off: the most that they could still change


def noise_limit(floor: float) -> float:
    """Largest NMSE against the design's irradiance that noise explains; ``floor``: that of the part's rays alone."""
    return NOISE_FLOORS * floor + NOISE_ALLOWANCE


def agreement_of(proof: ReceiverProof) -> Agreement:
    """Agreement of the exported mesh with the design on one receiver, from the fields of its record."""
    gap = proof.deviation_mm
    return Agreement(
        compared=proof.rays_compared,
        rms=gap.rms,
        p99=gap.p99,
        max=gap.max,
        flux=proof.flux_deviation,
        fates=proof.fate_disagreements,
        fates_flux=proof.fate_disagreement_flux,
        pairs=proof.fate_pairs,
    )


def proof_criteria(proof: Proof) -> tuple[Criterion, ...]:
    """Acceptance criteria of all casts of a part; those of further receivers carry the receiver's name."""
    found = [
        at_most("open_edges", proof.open_edges, 0.0, "edges", "export again: the mesh is not closed"),
        plain_criterion(proof.plain_cast),
        *size_criteria(proof.sizes, proof.faults),
        *([] if proof.emission_apart is None else [emission_criterion(proof.emission_apart)]),
    ]
    for number, receiver in enumerate(proof.receivers):
        own = _receiver_criteria(proof, receiver)
        found += own if number == 0 else [_named(each, receiver.name) for each in own]
    return tuple(found)


def _named(criterion: Criterion, receiver: str) -> Criterion:
    return criterion.model_copy(update={"name": f"{receiver}: {criterion.name}"})


def _receiver_criteria(proof: Proof, receiver: ReceiverProof) -> list[Criterion]:
    """Criteria of the casts on one receiver; the reach of its light follows from the limit of the deviation."""
    brep, mitsuba, reach_mm = receiver.brep, receiver.mitsuba, receiver.deviation_limit_mm / DEVIATION_RAD
    step_alike = None if brep is None else brep_evidence(brep, reach_mm).lands_alike
    fault, other = proof.faults.mesh, other_body(proof.sizes, "lens.stl")
    fine = proof.facet_height_um.rms <= FINE_FACETS_UM
    evidence = mesh_evidence(receiver, form_of_mesh(proof.open_edges, step_alike, other, fine=fine), fault, fine=fine)
    return [
        *_mesh_criteria(receiver, evidence),
        *([] if brep is None else brep_criteria(brep, reach_mm, _step_fault(proof))),
        *([] if mitsuba is None else mitsuba_criteria(mitsuba, reach_mm, fault or other, fine=fine)),
        *([] if receiver.own_rays is None else own_rays_criteria(receiver.own_rays)),
    ]


def mesh_evidence(receiver: ReceiverProof, form: str = "", fault: str = "", *, fine: bool = False) -> Evidence:
    """Agreement of the mesh with the design on one receiver, and its limits; ``form``, ``fault``: its remedies.

    ``fine``: its facets are not the cause of what differs.
    """
    limit = receiver.deviation_limit_mm
    return Evidence(agreement_of(receiver), limit, FLUX_SHARE, FATE_SHARE, form, fault, fine)


def _step_fault(proof: Proof) -> str:
    return proof.faults.step or other_body(proof.sizes, "lens.step")


def _mesh_criteria(proof: ReceiverProof, found: Evidence) -> Iterator[Criterion]:
    agreement, floor = found.agreement, proof.noise_floor_nmse
    same_rays = SAME_RAYS_FLOORS * floor + SAME_RAYS_ALLOWANCE
    noise = "evaluate the design with more rays and the same filter, or verify with more rays"
    light = noise if proof.nmse_same_rays <= same_rays else found.of_pixels()
    limits: tuple[tuple[str, float, float, str, str], ...] = (
        ("deviation_rms", agreement.rms, found.deviation_mm, "mm", found.of_deviation()),
        ("flux_deviation", agreement.flux, FLUX_SHARE, "of the flux", found.of_flux()),
        ("fate_disagreement_flux", agreement.fates_flux, FATE_SHARE, "of the flux", found.of_fates()),
        ("nmse_same_rays", proof.nmse_same_rays, same_rays, "", found.of_pixels()),
        ("nmse_vs_design", proof.nmse_vs_design, noise_limit(floor), "", light),
    )
    yield from (at_most(*limit) for limit in limits)


def plain_criterion(plain: PlainCast) -> Criterion:
    """Acceptance criterion of the grid's first hits against trimesh's own."""
    remedy = "do not trust this verification, its casting is broken: please report it"
    return at_most("plain_cast_disagreements", plain.disagreements, 0.0, "casts", remedy)


def brep_criteria(cast: BrepCast, reach_mm: float, fault: str = "") -> list[Criterion]:
    """Acceptance criteria of a STEP file; ``reach_mm``: of the receiver's light, ``fault``: recognised in the file."""
    design, seen = cast.against_design, brep_evidence(cast, reach_mm, fault)
    allowed = BREP_FATE_RAYS * max(1.0, cast.rays / BREP_RAYS)
    return [
        at_most("brep_deviation_rms", design.rms, seen.deviation_mm, "mm", seen.of_deviation()),
        at_most("brep_flux_deviation", design.flux, BREP_FLUX_SHARE, "of the flux", seen.of_flux()),
        at_most("brep_fate_disagreements", design.fates, allowed, "rays", seen.of_fates()),
    ]


def brep_evidence(cast: BrepCast, reach_mm: float, fault: str = "") -> Evidence:
    """Agreement of the STEP file with the design, and its limits; ``reach_mm``: of the receiver's light."""
    form = "export again; if it stays, lens.step is not the lens of lens.json"
    limit, fates = BREP_DEVIATION_RAD * reach_mm, BREP_FATE_RAYS / BREP_RAYS
    return Evidence(cast.against_design, limit, BREP_FLUX_SHARE, fates, form, fault, fine=True)


def mitsuba_criteria(cast: MitsubaCast, reach_mm: float, fault: str = "", *, fine: bool = False) -> list[Criterion]:
    """Acceptance criteria of the exported mesh by Mitsuba; ``reach_mm``: of the receiver's light.

    ``fault``: of the mesh; ``fine``: its facets are not the cause of what differs.
    """
    design, floor = cast.against_design, noise_limit(cast.noise_floor_nmse)
    limit, form = MITSUBA_DEVIATION_RAD * reach_mm, form_of_mesh(0, None, fine=fine)
    seen = Evidence(design, limit, MITSUBA_FLUX_SHARE, MITSUBA_FATE_SHARE, form, fault, fine)
    fates = design.fates_flux
    return [
        at_most("mitsuba_nmse_vs_design", cast.nmse_vs_design, floor, "", seen.of_pixels()),
        at_most("mitsuba_deviation_rms", design.rms, seen.deviation_mm, "mm", seen.of_deviation()),
        at_most("mitsuba_flux_deviation", design.flux, MITSUBA_FLUX_SHARE, "of the flux", seen.of_flux()),
        at_most("mitsuba_fate_disagreement_flux", fates, MITSUBA_FATE_SHARE, "of the flux", seen.of_fates()),
    ]


def balance_error(flux: StrayFlux) -> float:
    """Distance of the sum of all shares of flux from 1."""
    return float(abs(sum(flux.model_dump().values()) - 1.0))


def stray_criteria(stray: StrayLight) -> tuple[Criterion, ...]:
    """Acceptance criteria of the flux budget with reflections; it closes on every receiver."""
    finer = FINER
    report = "do not trust this flux budget, it does not close: please report it"
    held = (
        "light goes round in the part until it is too dim to follow: state lens.absorption_per_mm of the material, or "
        "blacken the base (verify --stray --base black)"
    )
    balance = max(receiver.balance_error for receiver in stray.receivers)
    return (
        at_most("stray_balance", balance, BALANCE, "of the flux", report),
        at_most("stray_leaked", stray.flux.leaked, LEAK_SHARE, "of the flux", finer),
        at_most("stray_too_dim", stray.flux.too_dim, DIM_SHARE, "of the flux", held),
    )
