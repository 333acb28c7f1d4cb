"""The results of all stages for one lens, the names of their files in a result folder, and the handover of them."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

from lensforge.addon import addons
from lensforge.cad.part import Part, part_facts
from lensforge.errors import MissingResult
from lensforge.light.evaluation_result import Light
from lensforge.light.light_facts import BoundsByState, light_facts, light_reasons, photometry_facts
from lensforge.light.photometry_result import Photometry
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.made.yield_facts import sensitivity_facts, yield_facts
from lensforge.proof.proof_facts import proof_facts, stray_facts
from lensforge.proof.proof_result import Proof, StrayLight
from lensforge.public import public
from lensforge.results import Conditions, Fact, Group, SimulatedResult, StageResult
from lensforge.results.arguments import count_of, require, with_known_names
from lensforge.results.criteria import missed
from lensforge.results.stage_result import OF_FOLDERS, ResultByLed
from lensforge.results.verdict import Reason, Verdict
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Design, design_facts
from lensforge.shop.check_facts import check_facts, cutting_reasons
from lensforge.shop.check_result import Check
from lensforge.shop.point_tables import GridRequest
from lensforge.spec import DrawingSection, Spec
from lensforge.spec.part_section import read_drawing
from lensforge.spec.processes import Process

if TYPE_CHECKING:
    from lensforge.shop.handover import Handover

REPORT_FILE = "report.html"
# Results of a whole run, each after those that it is made from.
STAGES: tuple[type[StageResult], ...] = (Design, Light, Part, Check, Proof, Photometry)

MOST_MODEL_RAYS = 10_000  # a viewer turns as many lines smoothly
_Result = TypeVar("_Result", bound=StageResult)


@public
@dataclass(frozen=True, eq=False)
class Results:
    """A lens and the results of its stages.

    Fields:
        lens (Lens): The lens.
        found (mapping of str to StageResult): Results by the stem of their files.
        outdated (mapping of str): The reason for each stage whose files belong to another lens, part or version;
            such a stage counts as not run.
        others (mapping of str to SimulatedResult): Results under other conditions than the nominal, by the stem
            of their files; neither verdict nor any stage uses them.
        seconds (float or None, s): Of the whole command that has made them, where one has, up to its report.
    """

    lens: Lens
    found: Mapping[str, StageResult] = field(default_factory=dict)
    outdated: Mapping[str, str] = field(default_factory=dict)
    others: Mapping[str, SimulatedResult] = field(default_factory=dict)
    seconds: float | None = None

    @property
    def spec(self) -> Spec:
        """Spec of the lens."""
        return self.lens.spec

    def find(self, kind: type[_Result], stem: str | None = None) -> _Result | None:
        """Find the result of class ``kind``; None if that stage has not run."""
        result = self.found.get(stem or kind.stage)
        return result if isinstance(result, kind) else None

    def take(self, kind: type[_Result]) -> _Result:
        """Take the result of class ``kind``. Raises :class:`MissingResult` where that stage has not run."""
        result = self.find(kind)
        if result is None:
            why = self.outdated.get(kind.stage, f"there is no result of this stage; run `lensforge {kind.stage}`")
            raise MissingResult(f"{self.spec.name}: {kind.stage}: {why}")
        return result

    @property
    def design(self) -> Design:
        """Result of the search. Raises :class:`MissingResult` where it has not run, as do the properties below."""
        return self.take(Design)

    @property
    def light(self) -> Light:
        """Light on the receiver."""
        return self.take(Light)

    @property
    def part(self) -> Part:
        """Part and its files."""
        return self.take(Part)

    @property
    def check(self) -> Check:
        """Manufacturing check."""
        return self.take(Check)

    @property
    def proof(self) -> Proof:
        """Rays cast through the exported part."""
        return self.take(Proof)

    @property
    def photometry(self) -> Photometry:
        """Far field, and the files that hold it."""
        return self.take(Photometry)

    @property
    def states(self) -> dict[str, "Results"]:
        """Lens and results in each state alone, by its name; empty for a lens that has one condition."""
        return {
            name: Results(lens, {stem: _in_state(result, name) for stem, result in self.found.items()}, self.outdated)
            for name, lens in self.lens.by_state.items()
            if name
        }

    @property
    def part_or_lens(self) -> Part | Lens:
        """Part, or before an export the lens."""
        return self.find(Part) or self.lens

    def of_faces(self, kind: type[_Result]) -> dict[str, _Result]:
        """Results of class ``kind``, which is one of a face, by the name of the face."""
        results = ((face, self.find(kind, kind.stems([face])[0])) for face in self.lens.surfaces)
        return {face: result for face, result in results if result is not None}

    @property
    def verdict(self) -> Verdict:
        """Verdict on light, files and cutting; a stage that has not run leaves its part undecided."""
        light = self.find(Light)
        check = self.find(Check)
        unseen: list[Reason] = [("undecided", "the light has not been evaluated")]
        unchecked: list[Reason] = [("undecided", "the part has not been checked")]
        return Verdict.of(
            light=list(light_reasons(light, self.lens)) if light else unseen,
            files=list(self._files_reasons()),
            cutting=list(cutting_reasons(check)) if check else unchecked,
        )

    def _files_reasons(self) -> Iterator[Reason]:
        part = self.find(Part)
        proof = self.find(Proof)
        for result in (self.find(Design), part, self.find(Check), proof):
            if result is not None:
                yield from missed(result.deciding_criteria())
        if part is None:
            yield "undecided", "no files have been exported"
            return
        for name in unjudged_files(part, proof):
            again = "`lensforge verify` judges it as it is, `lensforge export` writes it again"
            yield "fail", f"{name} is not the file that was exported: {again}"
        if proof is None:
            yield "undecided", "the exported part has not been verified"
        elif unseen := set(part.exported) - {form.name for form in proof.forms}:
            yield "undecided", f"the form of {', '.join(sorted(unseen))} has not been verified; verify again"
        elif proof.altered_files and not part.altered:
            names = ", ".join(proof.altered_files)
            yield "undecided", f"the files that were verified are not those of the export: {names}; verify again"

    def facts(self, result: StageResult, possible: BoundsByState | None = None) -> list[Group]:
        """Facts of one of the results; ``possible``: the most light that physics allows at the limits of the spec."""
        match result:
            case Design():
                return design_facts(result)
            case Light():
                return light_facts(result, self.lens, possible)
            case Part():
                return part_facts(result)
            case Check():
                return check_facts(result)
            case Proof():
                lamps = self.spec.all_lamps.whole if result.on_plate else self.lens.own_lamps_words
                return proof_facts(result, self.lens.lamp_words, lamps)
            case StrayLight():
                return stray_facts(result, self.lens.own_lamps_words)
            case Photometry():
                return photometry_facts(result, self.spec)
            case Sensitivity():
                return sensitivity_facts(result)
            case Yield():
                return yield_facts(result)
            case _:
                load_records()
                return facts_of(result)

    @property
    def yield_facts(self) -> list[Group]:
        """Facts of the yield; empty if it has not been computed."""
        study = self.find(Yield)
        return [] if study is None else self.facts(study)

    @property
    def missing(self) -> list[str]:
        """Stages of a whole run that have not run."""
        return [kind.stage for kind in STAGES if kind.stage not in self.found]

    def criteria(self) -> Iterator[tuple[str, Fact]]:
        """Pairs (stem, criterion) of all results."""
        for stem, result in self.found.items():
            yield from ((stem, criterion) for criterion in result.all_criteria())

    def __eq__(self, other: object) -> bool:
        """True where lens and results are the same, bit for bit."""
        if not isinstance(other, Results):
            return NotImplemented
        same = self.lens == other.lens and dict(self.found) == dict(other.found)
        return same and dict(self.others) == dict(other.others)

    __hash__ = None  # type: ignore[assignment]  # results hold arrays


def _in_state(result: StageResult, name: str) -> StageResult:
    """``result`` in the state ``name``; itself where it is of the lens in all states."""
    return result.by_led.get(name, result) if isinstance(result, ResultByLed) else result


def unjudged_files(part: Part, proof: Proof | None) -> tuple[str, ...]:
    """Files that are not as exported, and whose geometry and light no verification has judged as they are now."""
    return () if proof is not None and proof.altered_files == part.altered else part.altered


@singledispatch
def facts_of(result: StageResult) -> list[Group]:
    """Facts of a result by itself; an add-on registers the function for its own class."""
    return []


def load_records() -> None:
    """Load the records of add-ons, with the facts of each."""
    for addon in addons():
        addon.records()


def kinds_of_results() -> tuple[type[StageResult], ...]:
    """Classes of all results that a folder may have: those of a whole run, then others, which are made from these."""
    load_records()
    others = (kind for _, kind in sorted(OF_FOLDERS.items()) if kind not in STAGES)
    return (*STAGES, *others)


def own_stems(faces: Iterable[str]) -> dict[str, type[StageResult]]:
    """The class of each result under the own conditions of a lens with these ``faces``, by the stem of its file."""
    names = tuple(faces)
    return {stem: kind for kind in kinds_of_results() for stem in kind.stems(names)}


def stem_of(result: StageResult) -> str:
    """Name of the JSON file of ``result`` in a result folder, without its suffix: its stage, and other conditions."""
    conditions = conditions_of(result)
    return result.stem if conditions is None else f"{result.stem}_{conditions.name}"


def conditions_of(result: StageResult) -> Conditions | None:
    """Conditions of ``result`` that are not the lens's own; None for the lens's own record."""
    return result.conditions if isinstance(result, SimulatedResult) else None


@public
@with_known_names
def handover(
    run: Results,
    *,
    spacing_mm: float | None = None,
    error_nm: float = 10.0,
    interpolation: Literal["bicubic", "linear"] = "bicubic",
    drawing: DrawingSection | Path | str | None = None,
    process: Process | None = None,
    rays: int = 0,
) -> "Handover":
    """Make the documents for the shop: drawing, verdicts, tables of points, hashes.

    Args:
        run: the results of a lens, with its part and its check.
        spacing_mm: of the dense tables, in mm; None: as wide as ``error_nm`` allows.
        error_nm: largest error of an ``interpolation`` of them along the normal, in nm.
        interpolation: by which the shop's program fills them.
        drawing: words of title block and notes, or a TOML file that has them; None: the spec's.
        process: by which this part is made, such as a turned prototype of a moulded lens; None: that of the spec.
        rays: number of rays of the LED in ``lens_rays.glb``, 0 to 10,000; 0: no such file.
    Returns: The bytes of all files.
    Raises: :class:`InputError` for too many points or rays, or a process by which no such part is made.
        :class:`MissingResult`: the run has no part or no check.
    Example:
        >>> handover = lf.handover(lf.load("cad_out/quickstart"), spacing_mm=0.5)
        >>> handover.save("shop")
        >>> print(sorted(handover.files))
    """
    from lensforge.shop.check import check_made_by
    from lensforge.shop.shop_files import made_by, make_handover

    require(run, Results, "handover")
    section = read_drawing(Path(drawing)) if isinstance(drawing, Path | str) else drawing
    request = GridRequest(spacing_mm, error_nm, interpolation)
    run.lens.spec.lens.require_stage("handover")
    part = run.part
    check = run.check
    if process is not None and process != part.lens.spec.manufacture.process:
        part, check = made_by(part, process), check_made_by(part.lens, process)
    drawn = count_of("rays", rays, 0, most=MOST_MODEL_RAYS)
    return make_handover(part, check, run.yield_facts, request, section, drawn or 0)
