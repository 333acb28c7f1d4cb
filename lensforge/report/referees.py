"""Who was asked whether the part does what the design says, and what each of them answered."""

from collections.abc import Iterator
from dataclasses import dataclass

from lensforge.report.numerals import number
from lensforge.report.records import AgreementRecord, BrepRecord, MitsubaRecord, VerifyRecord
from lensforge.report.results import Results


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
    record = results.verify
    return [] if record is None else list(_rows(record))


def _rows(record: VerifyRecord) -> Iterator[RefereeRow]:
    gap = record.deviation_mm
    rms, p99, largest = (number(value, 2) for value in (gap.rms, gap.p99, gap.max))
    floor = f"NMSE {number(record.nmse_vs_design, 2)}, noise makes {number(record.noise_floor_nmse, 2)}"
    yield RefereeRow(
        "Grid of trimesh\u2019s triangles, normals fitted to the vertices",
        "lens.stl",
        number(record.rays),
        rms,
        p99,
        largest,
        floor,
        _state(record, "deviation_rms", "nmse_same_rays", "nmse_vs_design", "flux_deviation"),
    )
    if record.referee is not None:
        plain = record.referee
        says = f"{number(plain.disagreements)} of {number(plain.casts)} first hits differ from the grid\u2019s"
        state = _state(record, "referee_disagreements")
        yield RefereeRow("trimesh\u2019s own plain cast", "lens.stl", number(plain.rays), "", "", "", says, state)
    if record.brep is not None:
        yield _brep(record, record.brep)
    if record.mitsuba is not None:
        yield _mitsuba(record, record.mitsuba)


def _brep(record: VerifyRecord, brep: BrepRecord) -> RefereeRow:
    says = f"{number(brep.against_mesh.rms, 2)} mm rms from the mesh; {_fates(brep.against_design)}"
    state = _state(record, "brep_deviation_rms", "brep_flux_deviation", "brep_fate_disagreements")
    return RefereeRow(
        "CAD kernel, face by face", "lens.step", number(brep.rays), *_gaps(brep.against_design), says, state
    )


def _mitsuba(record: VerifyRecord, mitsuba: MitsubaRecord) -> RefereeRow:
    noise = "within" if mitsuba.nmse_vs_design <= mitsuba.noise_floor_nmse else "above"
    says = (
        f"NMSE {number(mitsuba.nmse_vs_design, 2)}, {noise} the {number(mitsuba.noise_floor_nmse, 2)} that noise makes"
    )
    names = ("nmse_vs_design", "deviation_rms", "flux_deviation", "fate_disagreement_flux")
    state = _state(record, *(f"mitsuba_{name}" for name in names))
    name = f"Mitsuba {mitsuba.version}, flat facets"
    return RefereeRow(name, "lens.stl", number(mitsuba.rays), *_gaps(mitsuba.against_design), says, state)


def _gaps(agreement: AgreementRecord) -> tuple[str, str, str]:
    return number(agreement.rms, 2), number(agreement.p99, 2), number(agreement.max, 2)


def _fates(agreement: AgreementRecord) -> str:
    return "every ray ends alike" if agreement.fates == 0 else f"{number(agreement.fates)} rays end otherwise"


def _state(record: VerifyRecord, *names: str) -> str:
    """What the gates called ``names`` say together; ``""`` where none of them was judged."""
    judged = [gate.passed for gate in record.gates if gate.name in names]
    return ("pass" if all(judged) else "fail") if judged else ""
