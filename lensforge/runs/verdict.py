"""The verdict on a lens: light (as specified), files (correct), cutting (possible).

Light is judged by the limits of the spec. Where it sets none, it fails if the pattern is far from the target or too
little of the light lands there.
``evaluation.light_bounds`` holds both bounds.
"""

from collections.abc import Iterable, Iterator, Sequence

from lensforge.cad.part import Part
from lensforge.errors import CriterionMissed
from lensforge.light.evaluation_result import Light
from lensforge.light.receiver_light import LARGEST_NMSE, LEAST_SHARE, ReceiverLight, possible_share
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.proof.proof_result import JUDGED_FILES, Proof
from lensforge.results import Record, State, Text
from lensforge.results.criteria import Criterion, beyond_doubt
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check, Finding
from lensforge.spec import Spec

_DRAFT_TOLERANCE_DEG = 0.02  # the check samples the face at other points than the search

_Reason = tuple[State, str]


class Reasons(Record):
    """Reasons why light, files or cutting do not pass; empty where they do."""

    light: tuple[Text, ...]
    files: tuple[Text, ...]
    cutting: tuple[Text, ...]


class Verdict(Record):
    """``light``, ``files`` and ``cutting``: each "pass", "fail" or "undecided", and the reasons."""

    light: State
    files: State
    cutting: State
    reasons: Reasons

    def reasons_of(self, name: str) -> tuple[str, ...]:
        """Reasons why ``name``, one of the three, does not pass."""
        return {"light": self.reasons.light, "files": self.reasons.files, "cutting": self.reasons.cutting}[name]

    def require(self, spec: Spec, parts: Sequence[str] = ()) -> None:
        """Raise :class:`CriterionMissed` where light or files fail, or cutting where ``spec`` requires it.

        ``parts``: only these of the three, by default all.
        """
        counted = ["light", "files", *(["cutting"] if spec.manufacture.required else [])]
        failed = [name for name in counted if name in (parts or counted) and getattr(self, name) == "fail"]
        if failed:
            reasons = "; ".join(reason for name in failed for reason in self.reasons_of(name))
            raise CriterionMissed(f"{', '.join(failed)}: {reasons}")


def verdict_on(
    lens: Lens, design: Design | None, light: Light | None, part: Part | None, check: Check | None, proof: Proof | None
) -> Verdict:
    """The verdict from the results of the stages; None, a stage that has not run, leaves its part undecided."""
    unseen: list[_Reason] = [("undecided", "the light has not been evaluated")]
    unchecked: list[_Reason] = [("undecided", "the part has not been checked")]
    of_light = list(_light(lens, light)) if light else unseen
    of_files = list(_files(design, part, check, proof))
    of_cutting = list(_cutting(lens, check)) if check else unchecked
    light_words, files_words, cutting_words = (
        tuple(words for _, words in reasons) for reasons in (of_light, of_files, of_cutting)
    )
    return Verdict(
        light=_worst(of_light),
        files=_worst(of_files),
        cutting=_worst(of_cutting),
        reasons=Reasons(light=light_words, files=files_words, cutting=cutting_words),
    )


def _worst(reasons: Sequence[_Reason]) -> State:
    states = {state for state, _ in reasons}
    return "fail" if "fail" in states else "undecided" if "undecided" in states else "pass"


def _failed(criteria: Iterable[Criterion]) -> Iterator[_Reason]:
    for criterion in criteria:
        if not criterion.passed:
            yield "fail", str(criterion)


def _light(lens: Lens, light: Light) -> Iterator[_Reason]:
    yield from _failed(light.criteria)
    if lens.spec.limits:
        yield from _limits(light)
        return
    transmittance = transmittance_of(lens.media)
    for receiver in light.receivers:
        yield from _on_receiver(receiver, transmittance, f" on {receiver.name}" if len(light.receivers) > 1 else "")


def _limits(light: Light) -> Iterator[_Reason]:
    """Reasons by the limits of the spec, which are what its light must keep: no others count."""
    if not light.limits:
        yield "undecided", "the limits of the spec have not been judged in this light"
    for limit in light.limits:
        yield from _above_bound(
            f"{limit.name}: {limit.quantity}", limit.excess, limit.value.standard_error, limit.words
        )


def _on_receiver(light: ReceiverLight, transmittance: float, where: str) -> Iterator[_Reason]:
    """Reasons against the light on one receiver; ``where``: which, where there are several."""
    nmse, share = light.nmse, light.share_in_target  # shown with their errors, which decide beside a bound
    words = f"{nmse}, at most {LARGEST_NMSE:g}: a larger lens, a smaller source or a coarser pattern"
    yield from _above_bound(f"NMSE{where}", nmse.value - LARGEST_NMSE, nmse.standard_error, words)
    possible, what = possible_share(light, transmittance)
    words = (
        f"{share}, at least {LEAST_SHARE:g} of the {possible:.3g} that {what}: a larger lens, a smaller source or "
        "a wider target"
    )
    missing, error = LEAST_SHARE * possible - share.value, share.standard_error
    yield from _above_bound(f"share of the light in the target{where}", missing, error, words)


def _above_bound(name: str, excess: float, error: float | None, words: str) -> Iterator[_Reason]:
    """A reason where a value is above its bound (``excess`` > 0), or is within two standard errors of it."""
    if error is None:
        yield "undecided", f"{name} has no standard error, because the rays are a single sample: {words}"
        return
    above = beyond_doubt(excess, error)
    if above is None:
        yield "undecided", f"{name} is within two standard errors of its bound: {words}"
    elif above:
        yield "fail", f"{name} = {words}"


def _files(design: Design | None, part: Part | None, check: Check | None, proof: Proof | None) -> Iterator[_Reason]:
    for result in (design, part, check, proof):
        if result is not None:
            yield from _failed(result.criteria)
    if part is None:
        yield "undecided", "no files have been exported"
        return
    for name in unjudged_files(part, proof):
        verify = "`lensforge verify` judges it as it is, " if name in JUDGED_FILES else ""
        yield "fail", f"{name} is not the file that was exported: {verify}`lensforge export` writes it again"
    if proof is None:
        yield "undecided", "the exported part has not been verified"
    elif proof.altered_files and not part.altered:
        names = ", ".join(proof.altered_files)
        yield "undecided", f"the files that were verified are not those of the export: {names}; verify again"


def unjudged_files(part: Part, proof: Proof | None) -> tuple[str, ...]:
    """Files that are not as exported, and whose geometry and light no verification has judged as they are now."""
    judged = JUDGED_FILES if proof is not None and proof.altered_files == part.altered else ()
    return tuple(name for name in part.altered if name not in judged)


def _cutting(lens: Lens, check: Check) -> Iterator[_Reason]:
    mould = lens.spec.manufacture.make == "insert"
    for verdict in check.verdicts:
        counts = verdict.name in ("cutter", "relief", "tilt") or (verdict.name == "wall" and not mould)
        if counts and not verdict.holds:
            yield "fail", verdict.reason
    yield from _draft(lens, check, mould)
    yield from _no_tool([verdict for verdict in check.verdicts if verdict.name == "tool"])


def _draft(lens: Lens, check: Check, mould: bool) -> Iterator[_Reason]:
    """Reasons against the draft: below the spec's limit or, without one, too little for a mould."""
    limits = lens.spec.constraints
    for surface, face, limit in (
        ("inner", check.inner, limits.inner_draft_deg),
        ("outer", check.outer, limits.outer_draft_deg),
    ):
        if limit is not None and face.draft_deg.min < limit - _DRAFT_TOLERANCE_DEG:
            yield "fail", f"the {surface} face has a draft of {face.draft_deg.min:.2f} deg, the spec requires {limit:g}"
        elif limit is None and mould:
            reasons = (each.reason for each in check.verdicts if each.name == "draft" and each.surface == surface)
            if any(not each.holds for each in check.verdicts if each.name == "draft" and each.surface == surface):
                yield "fail", "; ".join(reasons)


def _no_tool(tools: Sequence[Finding]) -> Iterator[_Reason]:
    """Reasons against each face of which no tool of the shop cuts all."""
    for surface in ("inner", "outer"):
        of_face = [verdict for verdict in tools if verdict.surface == surface]
        if of_face and not any(verdict.holds for verdict in of_face):
            yield "fail", "; ".join(verdict.reason for verdict in of_face)
