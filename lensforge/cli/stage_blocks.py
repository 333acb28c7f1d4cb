"""Blocks of the screen for the result of each stage, by its class."""

from collections.abc import Sequence

from lensforge.cad.part import Part
from lensforge.cli.check_blocks import check_blocks
from lensforge.cli.light_blocks import light_rows, photometry_rows, stray_block
from lensforge.cli.part_blocks import proof_rows, solid_rows
from lensforge.cli.screen import Block, Row
from lensforge.cli.study_blocks import sensitivity_block, yield_block
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import PhotoComparison, SurfaceComparison
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.results import SimulatedResult, StageResult
from lensforge.runs.results import stem_of
from lensforge.runs.run_folder import Run
from lensforge.runs.verdict import Verdict, verdict_on
from lensforge.shop.check_result import Check


def blocks_of(result: StageResult, run: Run) -> list[Block]:
    """Blocks for ``result``, one of those in the folder of ``run``, and the file that holds it."""
    blocks = _blocks(result, run)
    conditions = result.conditions if isinstance(result, SimulatedResult) else None
    under = [] if conditions is None else [("Conditions", str(conditions))]
    return [*blocks, Block(f"Written: {run.folder / stem_of(result)}.json", under)]


def _blocks(result: StageResult, run: Run) -> list[Block]:
    match result:
        case Light():
            return [Block(*_judged_light(result, run))]
        case Part():
            return [Block(f"Files: {run.verdict.files}", [*solid_rows(result), *reasons(run.verdict, "files")])]
        case Check():
            return check_blocks(result, run.spec, run.verdict.cutting)
        case Proof():
            return [_judged_proof(result, run)]
        case StrayLight():
            return [stray_block(result)]
        case Photometry():
            return [Block("Photometry", list(photometry_rows(result)))]
        case Sensitivity():
            return [sensitivity_block(result)]
        case Yield():
            return [yield_block(result)]
        case _:
            return _measured(result)


def _judged_light(light: Light, run: Run) -> tuple[str, list[Row]]:
    """Title and lines of a light; one under other conditions than the lens's own is judged by itself."""
    own = light.conditions is None
    verdict = run.verdict if own else verdict_on(run.lens, None, light, None, None, None)
    title = "Light" if own else "Light under other conditions"
    return f"{title}: {verdict.light}", [*light_rows(light), *reasons(verdict, "light")]


def _judged_proof(proof: Proof, run: Run) -> Block:
    """The verdict on the files; rays other than the lens's own judge the files by themselves."""
    own = proof.conditions is None
    verdict = run.verdict if own else verdict_on(run.lens, None, None, run.find(Part), None, proof)
    title = "Files" if own else "Files under other conditions"
    return Block(f"{title}: {verdict.files}", [*_proof(proof, run), *reasons(verdict, "files")])


def reasons(verdict: Verdict, name: str) -> list[Row]:
    """A line for each reason why ``name`` does not pass."""
    return [("Because", reason) for reason in verdict.reasons_of(name)]


def _proof(proof: Proof, run: Run) -> list[Row]:
    from lensforge.report.proof import receiver_facts

    light = run.find(Light)
    designed = {} if light is None else {each.name: each.efficiency.value for each in light.receivers}
    facts: list[Row] = list(proof_rows(proof))
    for receiver in proof.receivers:
        facts += receiver_facts(receiver, designed.get(receiver.name))[1:]
    return facts


def _measured(result: StageResult) -> list[Block]:
    """The machined part, in the words of the report."""
    from lensforge.report.corrected import correction_facts
    from lensforge.report.measured import photo_facts, surface_facts

    match result:
        case PhotoComparison():
            return [Block("Photograph of the light", _lines(photo_facts(result)))]
        case SurfaceComparison():
            return [Block(f"{result.surface.capitalize()} surface, measured", _lines(surface_facts(result)))]
        case Correction():
            title = f"{result.surface.capitalize()} surface, corrected for a second cut"
            return [Block(title, _lines(correction_facts(result)))]
    return []


def _lines(facts: Sequence[tuple[str, str]]) -> list[Row]:
    """Facts of the report, whose labels are long, as lines without labels."""
    return [("", f"{label}: {text}") for label, text in facts]
