"""What a reader wants first: does it hold, and the handful of numbers that say how good it is."""

from collections.abc import Iterator
from dataclasses import dataclass

from lensforge.report.numerals import number, percent
from lensforge.report.records import FaceRecord, GateRecord
from lensforge.report.results import Results


@dataclass(frozen=True)
class Card:
    """One large number, its unit, and a line that puts it into place."""

    label: str
    value: str
    unit: str
    note: str


@dataclass(frozen=True)
class GateRow:
    """One line of the table of gates."""

    stage: str
    name: str
    value: str
    limit: str
    unit: str
    passed: bool
    remedy: str


@dataclass(frozen=True)
class Verdict:
    """The sentence at the top; ``state`` is "pass", "fail" or "open"."""

    state: str
    sentence: str


def verdict(results: Results) -> Verdict:
    """All gates hold, some fail, or there is more to be run first."""
    gates = [gate for _, gate in results.gates()]
    failed = [gate for gate in gates if not gate.passed]
    missing = f" Not run yet: {', '.join(results.missing)}." if results.missing else ""
    if failed:
        names = ", ".join(gate.name.replace("_", " ") for gate in failed)
        return Verdict("fail", f"{len(failed)} of {len(gates)} gates fail: {names}.{missing}")
    if not gates:
        return Verdict("open", f"Nothing has been judged.{missing}")
    return Verdict("open" if missing else "pass", f"All {len(gates)} gates hold.{missing}")


def gate_rows(results: Results) -> list[GateRow]:
    """Every gate of every stage that has run."""
    return [_gate_row(stage, gate) for stage, gate in results.gates()]


def _gate_row(stage: str, gate: GateRecord) -> GateRow:
    sense = {"<=": "≤", ">=": "≥"}[gate.sense]
    return GateRow(
        stage=stage,
        name=gate.name.replace("_", " "),
        value=number(gate.value, 4),
        limit=f"{sense} {number(gate.limit, 4)}",
        unit=gate.unit,
        passed=gate.passed,
        remedy=gate.remedy,
    )


def cards(results: Results) -> list[Card]:
    """The headline numbers of the stages that have run."""
    return [
        *_light_cards(results),
        *_size_cards(results),
        *_file_cards(results),
        *_mill_cards(results),
        *_proof_cards(results),
    ]


def _light_cards(results: Results) -> Iterator[Card]:
    record = results.evaluate
    if record is None:
        return
    yield Card(
        "NMSE", number(record.nmse, 3), "", f"{_error(record.nmse_standard_error)}error of the pattern, 0 is perfect"
    )
    window = f"of the emitted flux within {record.window_mm:g} × {record.window_mm:g} mm"
    error = record.efficiency_standard_error
    yield Card("Efficiency", percent(record.efficiency), "", f"{f'± {percent(error, 3)}; ' if error else ''}{window}")
    if record.uniformity is not None:
        note = f"{_error(record.uniformity_standard_error)}least over mean irradiance in the mask"
        yield Card("Uniformity", number(record.uniformity, 3), "", note)
    if record.rsd is not None:
        note = f"{_error(record.rsd_standard_error)}standard deviation over mean in the mask"
        yield Card("RSD", number(record.rsd, 3), "", note)


def _error(standard_error: float | None) -> str:
    return f"± {number(standard_error, 2)}; " if standard_error else ""


def _size_cards(results: Results) -> Iterator[Card]:
    if results.design is not None:
        largest = results.design.max_radius_mm
        limit = f"largest radius; at most {results.lens.spec.constraints.max_radius_mm:g} mm allowed"
        yield Card("Lens radius", number(largest, 4), "mm", limit)
        yield Card("Lens height", number(results.design.height_mm, 4), "mm", "above the source plane, without the base")


def _file_cards(results: Results) -> Iterator[Card]:
    record = results.export
    if record is not None:
        note = f"largest, of the STEP file as read back; normals within {number(record.normal_error_mrad.max, 2)} mrad"
        yield Card("Form error", number(record.form_error_nm.max, 3), "nm", note)


def _mill_cards(results: Results) -> Iterator[Card]:
    record = results.check
    if record is None:
        return
    tightest = min((record.inner, record.outer), key=_largest_mill)
    largest = tightest.cutter.largest_radius_mm
    asked = f"largest radius that reaches all of both faces; the shop has {tightest.cutter.radius_mm:g} mm"
    yield Card("Ball mill", "any" if largest is None else number(largest, 3), "mm" if largest else "", asked)
    yield Card("Thinnest wall", number(record.min_wall_mm, 4), "mm", "along the normal of the cavity")


def _largest_mill(face: FaceRecord) -> float:
    largest = face.cutter.largest_radius_mm
    return float("inf") if largest is None else largest


def _proof_cards(results: Results) -> Iterator[Card]:
    record = results.verify
    if record is not None:
        floor = number(record.noise_floor_nmse, 2)
        note = f"NMSE of {number(record.rays)} rays through the exported part; noise alone makes {floor}"
        yield Card("Part against design", number(record.nmse_vs_design, 3), "", note)
