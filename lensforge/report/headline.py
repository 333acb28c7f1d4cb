"""The top of a page or a notebook: the verdict, warnings, criteria, and the facts that a reader looks for first."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.light.light_facts import BoundsByState
from lensforge.light.photometry_result import Photometry
from lensforge.optics.face_roles import CAVITY, bounding
from lensforge.proof.proof_result import Proof
from lensforge.report.results import REPORT_FILE, Results, kinds_of_results
from lensforge.results import Fact, Group, State
from lensforge.results.criteria import shown
from lensforge.results.numerals import quantity
from lensforge.results.verdict import TITLES, state_label
from lensforge.search.design_result import Design
from lensforge.shop.check_facts import shape_facts
from lensforge.shop.check_result import Check
from lensforge.spec import ReceiverSection, Spec
from lensforge.spec.lens_section import LensShape
from lensforge.spec.trades import TRADES

Shown = Literal["pass", "fail", "open"]  # the style of a verdict on the page

SHOWN: dict[State, Shown] = {"pass": "pass", "fail": "fail", "undecided": "open", "none": "open"}
# For one subject, and for several.
_VERBS: dict[State, tuple[str, str]] = {
    "fail": ("fails", "fail"),
    "undecided": ("is undecided", "are undecided"),
    "none": ("is not judged", "are not judged"),
    "pass": ("passes", "pass"),
}
_TIMED: dict[type[Design | Light | Part | Check | Proof | Photometry], str] = {
    Design: "search",
    Light: "simulated light",
    Part: "CAD and files",
    Check: "check for the shop",
    Proof: "verification",
    Photometry: "photometry",
}

_COLOUR = ("cct", "duv", "rms_delta_uv", "worst_delta_uv")
_LIGHT = ("nmse", "share_in_target", "efficiency", "uniformity", "rsd", "inner", "peak", *_COLOUR, "leak")
_SHAPE = ("kept_start", "radius", "height", "cavity", "keep_out", "thinnest")
_PROOF = ("nmse_vs_design", "fitted_nmse", "file_nmse", "file_efficiency", "table_nmse", "detected_stray")
_FURTHER = ("classes", "form_error", "volume", "mass", "plate_mass", *_PROOF)

_REMARKS = {
    "design": "There is no design.json, so the search is not documented; run lensforge design.",
    "evaluate": "There is no evaluate.json: the finished lens has not been simulated; run lensforge evaluate.",
    "export": "There is no export.json: no file for a shop has been written; run lensforge export.",
    "check": "There is no check.json: the lens has not been checked for manufacture; run lensforge check.",
    "verify": "There is no verify.json: the exported part has not been verified; run lensforge verify.",
    "photometry": "There is no photometry.json: the far field has not been computed; run lensforge photometry.",
}


@dataclass(frozen=True)
class VerdictBadge:
    """The verdict on photometry, files or manufacture: its name, the word for its state, its style, and its reasons."""

    name: str
    word: str
    shown: Shown
    reasons: tuple[str, ...]

    @property
    def sentences(self) -> list[str]:
        """The reasons, each as a sentence."""
        return [f"{reason[:1].upper()}{reason[1:]}." for reason in self.reasons]


@dataclass(frozen=True)
class Headline:
    """The top of a page: the three verdicts, all of them in one ``sentence`` with its style, and the ``criteria``."""

    parts: tuple[VerdictBadge, ...]
    shown: Shown
    sentence: str
    criteria: str


def headline(results: Results) -> Headline:
    """The verdicts with their reasons, and the state of the criteria: all met, or some missed."""
    verdict = results.verdict
    states = verdict.states
    parts = tuple(
        VerdictBadge(TITLES[name], state_label(state), SHOWN[state], verdict.reasons_of(name))
        for name, state in states.items()
    )
    sentence = f"{_in_words(states, results)}{_waiting(results)}"
    return Headline(parts, _whole(states, results), sentence, _on_criteria(results))


def _whole(states: Mapping[str, State], results: Results) -> Shown:
    """The style of the whole: a failure where one of the parts that count fails."""
    counted = ["light", "files", *(["cutting"] if results.spec.manufacture.required else [])]
    if any(states[name] == "fail" for name in counted):
        return "fail"
    return "pass" if set(states.values()) <= {"pass", "none"} and not results.missing else "open"


def _in_words(states: Mapping[str, State], results: Results) -> str:
    """Verdicts as sentences, the worst first: "Photometry fails. CAD files and manufacture pass."""
    sentences = []
    for state, (singular, plural) in _VERBS.items():
        names = [name for name, judged in states.items() if judged == state]
        allowed = names == ["cutting"] and state == "fail" and not results.spec.manufacture.required
        if names:
            verb = singular if names in (["light"], ["cutting"]) else plural
            subject = _listed([TITLES[name] for name in names]).replace(" Manu", " manu")
            sentences.append(f"{subject} {verb}{' (not required)' if allowed else ''}.")
    return " ".join(sentences)


def _on_criteria(results: Results) -> str:
    """The criteria, which judge light and files, in one sentence: all met, or the names of those that are not."""
    criteria = [criterion for _, criterion in results.criteria()]
    failed = [criterion for criterion in criteria if not criterion.holds]
    of = "on simulation and files"
    if failed:
        names = ", ".join(criterion.note for criterion in failed)
        noun = "criterion" if len(criteria) == 1 else "criteria"
        verb = "is" if len(failed) == 1 else "are"
        proof = results.find(Proof)
        facets = () if proof is None else proof.facet_misses
        of_mesh = all(criterion in facets for criterion in failed)
        alone = " (of the mesh alone, the STEP file decides)" if of_mesh else ""
        return f"{len(failed)} of {len(criteria)} {noun} {of} {verb} not met: {names}{alone}."
    if not criteria:
        return "No criterion has been evaluated."
    if len(criteria) == 1:
        return f"The only criterion {of} is met."
    missed = "; the required light is not" if results.verdict.light == "fail" else ""
    return f"All {len(criteria)} criteria {of} are met{missed}."


def _waiting(results: Results) -> str:
    """Stages of a whole run that have yet to run, or to run again, as a sentence."""
    never = [stage for stage in results.missing if stage not in results.outdated]
    again = [stage_name(stem) for stem in results.outdated]
    return "".join(
        f" {state}: {', '.join(names)}." for state, names in (("Not run yet", never), ("Out of date", again)) if names
    )


def outdated(results: Results) -> list[str]:
    """A sentence for each file that belongs to another lens, part or version: its name, and the reason."""
    return [
        f"{stem}.json is out of date and ignored: {why.rpartition(f'{stem}.json: ')[2]}."
        for stem, why in results.outdated.items()
    ]


def missing(results: Results) -> dict[str, str]:
    """A sentence for each stage of a whole run that has not run, by its name."""
    never = (stage for stage in results.missing if stage not in results.outdated)
    return {stage: _REMARKS[stage] for stage in never}


def stage_name(stem: str) -> str:
    """Name on the page of the result in ``stem``.json."""
    first, _, face = stem.partition("_")
    for kind in kinds_of_results():
        if stem == kind.stage or (face and first == kind.of_face):
            return kind.on_page.title.format(face) or stem
    return stem


@dataclass(frozen=True)
class KindLink:
    """A kind of lens: its name, number of its lamps, a link to the page on it, and if it is the kind ``here``."""

    name: str
    lamps: int
    page: str | None
    here: bool


def kinds(results: Results, linked: bool) -> list[KindLink]:
    """The kinds of lens of the lamps, the first of which has its page above those of the others; none for one."""
    first_kind = results.lens.kind
    every = results.spec.all_lamps.kinds
    up = "" if not every or first_kind == every[0].name else "../"
    pages = [f"{up}{REPORT_FILE}" if kind is every[0] else f"{up}{kind.name}/{REPORT_FILE}" for kind in every]
    return [
        KindLink(
            kind.name, len(kind.numbers), page if linked and kind.name != first_kind else None, kind.name == first_kind
        )
        for kind, page in zip(every, pages, strict=True)
    ]


def criterion_groups(results: Results, *, missed: bool = False) -> list[Group]:
    """The criteria of every stage that has run; ``missed``: only those that are not met."""
    by_stem: dict[str, list[Fact]] = {}
    for stem, criterion in results.criteria():
        if not (missed and criterion.holds):
            by_stem.setdefault(stem, []).append(shown(criterion))
    return [Group(stem, stage_name(stem), tuple(facts)) for stem, facts in by_stem.items()]


def trade_facts(results: Results) -> list[Fact]:
    """Figures of the application of the spec, by light and photometry; none without an application."""
    trade = results.spec.trade
    if trade is None:
        return []
    groups = [group for result in results.found.values() for group in results.facts(result)]
    stated = [fact for group in groups if group.key == "trade" for fact in group.facts]
    return [*stated, *_selected(groups, TRADES[trade].photometry)]


def required_facts(results: Results, possible: BoundsByState | None = None) -> list[Fact]:
    """Facts that are required: limits, light on each receiver, size, wall, and the ball mill."""
    groups = [group for result in results.found.values() for group in results.facts(result, possible)]
    limits = [fact for group in groups if group.key == "limits" for fact in group.facts]
    lit = [group for group in groups if group.key == "light"]
    light = [
        replace(fact, label=f"{fact.label}, {group.title}") if len(lit) > 1 else fact
        for group in lit
        for fact in group.select(*_LIGHT).facts
    ]
    check = results.find(Check)
    shape = [*_selected(groups, _SHAPE), *([] if check is None else shape_facts(check, groups))]
    drafts = (
        [] if check is not None and check.mould is not None else [f"{name}_draft" for name in results.lens.surfaces]
    )
    if_limited = _selected(groups, ("thickest", *drafts))
    moulded = [fact for group in groups if group.key == "mould" for fact in group.facts if fact.notice]
    return [
        *trade_facts(results),
        *limits,
        *light,
        *shape,
        *(fact for fact in if_limited if fact.limit is not None),
        *moulded,
    ]


def further_facts(results: Results) -> list[Fact]:
    """Main figures beside those that are required."""
    groups = [group for result in results.found.values() for group in results.facts(result)]
    level = next((group for group in groups if group.key == "light"), None)
    rest = [group for group in groups if group.key not in ("light", "findings")]
    keys = dict.fromkeys((*_FURTHER, *(key for result in results.found.values() for key in result.on_page.further)))
    return [*([] if level is None else level.select("level").facts), *_selected(rest, tuple(keys))]


def _selected(groups: list[Group], keys: tuple[str, ...]) -> list[Fact]:
    return [fact for key in keys for group in groups for fact in group.select(key).facts]


def times(results: Results) -> str | None:
    """Sentence on the seconds of each stage and of the whole command, where they ran; None without any."""
    timed = [(stage, result.seconds) for kind, stage in _TIMED.items() if (result := results.find(kind)) is not None]
    parts = [f"{stage} {quantity(seconds, 's', digits=3)}" for stage, seconds in timed]
    if not parts or results.seconds is None:
        return f"Time: {', '.join(parts)}." if parts else None
    beside = " (stages can run side by side)" if sum(seconds for _, seconds in timed) > results.seconds else ""
    whole = quantity(results.seconds, "s", digits=3)
    return f"Time: {', '.join(parts)}; the whole command, up to this page, {whole}{beside}."


_MOST_NAMED = 3  # targets of one receiver; of more only the number is given


def task(spec: Spec) -> str:
    """Source, lens, and the targets of each receiver with its place, and how many lamps light it."""
    lens = spec.lens
    index = "" if lens.is_opaque else f", n = {lens.refractive_index:g}"
    body = f"{lens.title}, {lens.material}{index}{_fixed(lens)}{_surroundings(lens)}"
    if spec.states:
        lit = "; ".join(f"{name}: {_wanted_light(state)}" for name, state in spec.by_state.items())
    else:
        lit = _wanted_light(spec)
    leds = " or ".join(dict.fromkeys(source.title for source in spec.each_source))
    return f"{leds} · {body} · {lit}{spec.all_lamps.phrase}"


def _fixed(lens: LensShape) -> str:
    fixed = {name: face.fixed for name, face in lens.faces.items()}
    return "".join(f", {name} face fixed ({face.title})" for name, face in fixed.items() if face is not None)


def _surroundings(lens: LensShape) -> str:
    """Indices in the cavity and around the lens, where these are not air; coated faces."""
    around = (("the cavity", lens.cavity_index), ("the surroundings", lens.outside_index))
    indices = "".join(f", n = {index:g} in {where}" for where, index in around if index != 1.0)
    coated = [_place(lens, name) for name, face in lens.faces.items() if face.coating is not None]
    return f"{indices}, coated {_listed(coated)}" if coated else indices


def _place(lens: LensShape, name: str) -> str:
    before = lens.role(name).before
    if len(bounding(lens.body_roles, before)) > 1:
        return f"on the {name} face"
    return "inside" if before == CAVITY else "outside"


def _wanted_light(spec: Spec) -> str:
    """The targets of each receiver, and the temperature of the lens where it is not that of reference."""
    celsius = spec.lens.at_work_c
    warm = () if celsius is None else (f"lens at {celsius:g} °C",)
    return "; ".join((*warm, *map(_on_receiver, spec.all_receivers)))


def _on_receiver(receiver: ReceiverSection) -> str:
    names = [target.description for target in receiver.targets]
    return f"{_listed(names) if len(names) <= _MOST_NAMED else f'{len(names)} targets'} {receiver.place}"


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
