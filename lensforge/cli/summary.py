"""The screen at the end of a whole run: verdict, light, lens, files, cutting, and the folder, in 30 lines at most."""

from collections.abc import Iterator

from lensforge.cad.part import Part
from lensforge.cli.light_blocks import light_rows, photometry_rows
from lensforge.cli.part_blocks import cutting_rows, lens_rows, proof_rows, solid_rows, start_rows
from lensforge.cli.rounded import count
from lensforge.cli.screen import Block, Row
from lensforge.cli.stage_blocks import reasons
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import IES_FILE, LDT_FILE, TM25_FILE, TM33_FILE, Photometry
from lensforge.proof.proof_result import Proof
from lensforge.report.headline import headline
from lensforge.runs.results import REPORT_FILE
from lensforge.runs.run_folder import Run
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check

_STEM = "lens"  # of the files
_MOST_REASONS = 1  # of light and of files; all are in run.json, and in the message of a command that fails


def summary(run: Run) -> list[Block]:
    """Blocks of a whole run."""
    found = headline(run)
    verdict = run.verdict
    return [
        Block(f"{run.spec.name}: {found.sentence} {found.criteria}"),
        Block(f"Light: {verdict.light}", [*_light(run), *_why(run)]),
        Block(_search(run), list(_lens(run))),
        Block(f"Files: {verdict.files}", [*_files(run), *reasons(verdict, "files")[:_MOST_REASONS]]),
        Block(f"Cutting: {verdict.cutting}", list(_cutting(run))),
        Block(f"Written: {run.folder / REPORT_FILE}", [("Beside it", _written(run))]),
    ]


def _light(run: Run) -> Iterator[Row]:
    light, photometry = run.find(Light), run.find(Photometry)
    if light is not None:
        yield from light_rows(light)
    if photometry is not None:
        yield from photometry_rows(photometry)


def _why(run: Run) -> list[Row]:
    """The reason why the light does not pass; limits of the spec are lines of their own already."""
    found = [] if run.spec.limits else reasons(run.verdict, "light")[:_MOST_REASONS]
    return [(label, reason.rpartition(": ")[0] or reason) for label, reason in found]  # the remedy is in the message


def _search(run: Run) -> str:
    design = run.find(Design)
    return "Lens" if design is None else f"Lens: {count(design.steps)} steps in {len(design.history)} levels"


def _lens(run: Run) -> Iterator[Row]:
    design = run.find(Design)
    if design is not None:
        yield from lens_rows(design, run.spec)
        yield from start_rows(design)


def _files(run: Run) -> Iterator[Row]:
    part, proof = run.find(Part), run.find(Proof)
    if part is not None:
        yield from solid_rows(part)
    if proof is not None:
        yield from proof_rows(proof)


def _cutting(run: Run) -> Iterator[Row]:
    check = run.find(Check)
    if check is not None:
        yield from cutting_rows(check)
        if run.verdict.cutting != "pass":
            yield "Change", "`lensforge check` on this folder says what, in the spec"


def _written(run: Run) -> str:
    """The files that go to others."""
    part, photometry = run.find(Part), run.find(Photometry)
    names = [] if part is None else list(part.files)
    names += [] if photometry is None else [IES_FILE, LDT_FILE, TM33_FILE, TM25_FILE]
    first = names[:1]  # "lens.step, .stl, .3mf"
    return ", ".join(
        [*first, *(name.removeprefix(_STEM) if name.startswith(f"{_STEM}.") else name for name in names[1:])]
    )
