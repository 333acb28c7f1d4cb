"""Who was asked whether the part does what the design says, and what each of them answered."""

from collections.abc import Iterator
from dataclasses import dataclass

from lensforge.report.headline import gates_state
from lensforge.report.numerals import number
from lensforge.results import Results
from lensforge.verification.proof import Agreement, BrepCast, MitsubaCast, PlainCast, Proof


@dataclass(frozen=True)
class RefereeRow:
    """One referee: the file and the rays that it got, how far (mm) from the design they land, and what it says."""

    name: str
    file: str
    rays: str
    rms_mm: str
    p99_mm: str
    largest_mm: str
    says: str
    state: str


def referee_rows(results: Results) -> list[RefereeRow]:
    """Every referee that was asked; none where the part has not been verified."""
    proof = results.find(Proof)
    return [] if proof is None else list(_rows(proof))


def _rows(proof: Proof) -> Iterator[RefereeRow]:
    gap = proof.deviation_mm
    rms, p99, largest = (number(value, 2) for value in (gap.rms, gap.p99, gap.max))
    floor = f"NMSE {number(proof.nmse_vs_design, 2)}, noise makes {number(proof.noise_floor_nmse, 2)}"
    yield RefereeRow(
        "Grid of trimesh\u2019s triangles, normals fitted to the vertices",
        "lens.stl",
        number(proof.rays),
        rms,
        p99,
        largest,
        floor,
        gates_state(proof.gates, "deviation_rms", "nmse_same_rays", "nmse_vs_design", "flux_deviation"),
    )
    yield _plain(proof, proof.referee)
    if proof.brep is not None:
        yield _brep(proof, proof.brep)
    if proof.mitsuba is not None:
        yield _mitsuba(proof, proof.mitsuba)


def _plain(proof: Proof, plain: PlainCast) -> RefereeRow:
    says = f"{number(plain.disagreements)} of {number(plain.casts)} first hits differ from the grid\u2019s"
    state = gates_state(proof.gates, "referee_disagreements")
    return RefereeRow("trimesh\u2019s own plain cast", "lens.stl", number(plain.rays), "", "", "", says, state)


def _brep(proof: Proof, brep: BrepCast) -> RefereeRow:
    says = f"{number(brep.against_mesh.rms, 2)} mm rms from the mesh; {_fates(brep.against_design)}"
    state = gates_state(proof.gates, "brep_deviation_rms", "brep_flux_deviation", "brep_fate_disagreements")
    return RefereeRow(
        "CAD kernel, face by face", "lens.step", number(brep.rays), *_gaps(brep.against_design), says, state
    )


def _mitsuba(proof: Proof, mitsuba: MitsubaCast) -> RefereeRow:
    noise = "within" if mitsuba.nmse_vs_design <= mitsuba.noise_floor_nmse else "above"
    says = (
        f"NMSE {number(mitsuba.nmse_vs_design, 2)}, {noise} the {number(mitsuba.noise_floor_nmse, 2)} that noise makes"
    )
    names = ("nmse_vs_design", "deviation_rms", "flux_deviation", "fate_disagreement_flux")
    state = gates_state(proof.gates, *(f"mitsuba_{name}" for name in names))
    name = f"Mitsuba {mitsuba.version}, flat facets"
    return RefereeRow(name, "lens.stl", number(mitsuba.rays), *_gaps(mitsuba.against_design), says, state)


def _gaps(agreement: Agreement) -> tuple[str, str, str]:
    return number(agreement.rms, 2), number(agreement.p99, 2), number(agreement.max, 2)


def _fates(agreement: Agreement) -> str:
    return "every ray ends alike" if agreement.fates == 0 else f"{number(agreement.fates)} rays end otherwise"
