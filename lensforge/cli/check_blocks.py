"""The manufacturing check in sentences: each face, its tools, how much of it, and what to change in the spec."""

from collections.abc import Iterator

from lensforge.cli.rounded import figure
from lensforge.cli.screen import Block, Row
from lensforge.results import State
from lensforge.shop.check_result import Check, FaceResult, Finding
from lensforge.shop.findings import advice
from lensforge.spec import Spec

_SUBJECTS = {"cutter": "ball", "relief": "base", "tilt": "tilt", "tool": "tool", "draft": "draft", "wall": "wall"}


def check_blocks(check: Check, spec: Spec, state: State) -> list[Block]:
    """A block for each face and one for the wall; ``state``: the verdict on cutting."""
    what = "the part" if check.make == "part" else "the mould insert"
    faces = (("inner", check.inner), ("outer", check.outer))
    return [
        Block(f"Cutting {what}: {state}"),
        *(Block(f"{name.capitalize()} face", [*_rows(name, check, spec), _sphere(face)]) for name, face in faces),
        Block("Wall", [*_rows("body", check, spec), _thickest(check)]),
    ]


def _rows(surface: str, check: Check, spec: Spec) -> Iterator[Row]:
    """A line for each finding on ``surface``, with what to change where it does not hold."""
    for finding in check.verdicts:
        if finding.surface == surface and _counts(finding, check, spec):
            mark = "yes" if finding.holds else "no"
            yield f"{_SUBJECTS[finding.name]}: {mark}", _sentences(finding, spec, check)


def _counts(finding: Finding, check: Check, spec: Spec) -> bool:
    """True but for the draft of a part that is cut, where the spec asks for none."""
    asked = finding.surface == "body" or getattr(spec.constraints, f"{finding.surface}_draft_deg") is not None
    return finding.name != "draft" or check.make == "insert" or asked


def _sentences(finding: Finding, spec: Spec, check: Check) -> str:
    reason = f"{finding.reason[:1].upper()}{finding.reason[1:]}"
    change = advice(finding, spec, check)
    return f"{reason}. Change: {change}." if change else f"{reason}."


def _sphere(face: FaceResult) -> Row:
    sphere = face.best_fit_sphere
    departure = figure(sphere.pv_mm, "mm", 3)
    return "sphere", f"Best fit {figure(sphere.radius_mm, 'mm')} in radius, departure {departure} (peak to valley)."


def _thickest(check: Check) -> Row:
    return "thickest", f"{figure(check.wall.thickest.thickness_mm, 'mm')} along the ray from the source."
