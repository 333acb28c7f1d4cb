"""The verdict on a lens: is its light as specified, are its files sound, can it be cut.

Without limits of the spec's own, light fails where its pattern is far from the target or too little of it lands there.
Both bounds are calibrated on the shipped specs at standard accuracy: the worst of them has an NMSE of 0.02 and puts
0.93 of what two faces transmit into its target, while lenses that are of no use (a 6 mm source in an 8 mm lens, a word
finer than the image of its source) have an NMSE of 0.15 to 0.46, or a tenth of the light where it is wanted.
"""

from collections.abc import Iterable, Iterator, Sequence

from lensforge.criteria import Criterion
from lensforge.errors import CriterionMissed
from lensforge.evaluation.light import Light
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check, Finding
from lensforge.optics.materials import normal_transmittance
from lensforge.optimisation.design import Design
from lensforge.records import Record, State, Text
from lensforge.spec import Spec
from lensforge.verification.proof import Proof

LARGEST_NMSE = 0.10
LEAST_SHARE = 0.7  # of the flux that two faces transmit at normal incidence must lie in the target
_DRAFT_TOLERANCE_DEG = 0.02  # the check samples the face, the search watched other points of it
_CERTAIN = 2.0  # standard errors from a bound: nearer than that nothing is decided

_Reason = tuple[State, str]


class Reasons(Record):
    """Reasons for what does not pass; empty where it does."""

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
        """Raise :class:`CriterionMissed` where light or files fail, or the cutting where ``spec`` requires it.

        ``parts``: those of the three that count; by default all.
        """
        counted = ["light", "files", *(["cutting"] if spec.manufacture.required else [])]
        failed = [name for name in parts or counted if getattr(self, name) == "fail"]
        if failed:
            reasons = "; ".join(reason for name in failed for reason in self.reasons_of(name))
            raise CriterionMissed(f"{', '.join(failed)}: {reasons}")


def verdict_on(
    lens: Lens, design: Design | None, light: Light | None, part: Part | None, check: Check | None, proof: Proof | None
) -> Verdict:
    """The verdict by the stages that have run; one that has not (None) leaves its part undecided."""
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
    nmse, share = light.nmse.value - (light.nmse_of_noise or 0.0), light.share_in_target.value
    words = f"{nmse:.3g}, at most {LARGEST_NMSE:g}: a larger lens, a smaller source or a coarser pattern"
    yield from _against("NMSE less its noise", nmse - LARGEST_NMSE, light.nmse.standard_error, words)
    possible = normal_transmittance(lens.refractive_index) ** 2
    words = (
        f"{share:.3g}, at least {LEAST_SHARE:g} of the {possible:.3g} that two faces transmit: a larger lens, a "
        "smaller source or a wider target"
    )
    missing, error = LEAST_SHARE * possible - share, light.share_in_target.standard_error
    yield from _against("share of the light in the target", missing, error, words)


def _against(name: str, excess: float, error: float | None, words: str) -> Iterator[_Reason]:
    """A reason where a figure exceeds its bound by ``excess``, or might within two standard errors."""
    if error is None and excess > 0.0:
        yield "undecided", f"{name} has no standard error, as the rays are one sample: {words}"
    elif abs(excess) <= _CERTAIN * (error or 0.0):
        yield "undecided", f"{name} is within two standard errors of its bound: {words}"
    elif excess > 0.0:
        yield "fail", f"{name} = {words}"


def _files(design: Design | None, part: Part | None, check: Check | None, proof: Proof | None) -> Iterator[_Reason]:
    for result in (design, part, check, proof):
        if result is not None:
            yield from _failed(result.criteria)
    if part is None:
        yield "undecided", "no files have been exported"
    elif proof is None:
        yield "undecided", "the exported part has not been verified"


def _cutting(lens: Lens, check: Check) -> Iterator[_Reason]:
    mould = lens.spec.manufacture.make == "insert"
    for verdict in check.verdicts:
        counts = verdict.name in ("cutter", "relief", "tilt") or (verdict.name == "wall" and not mould)
        if counts and not verdict.holds:
            yield "fail", verdict.reason
    yield from _draft(lens, check, mould)
    yield from _no_tool([verdict for verdict in check.verdicts if verdict.name == "tool"])


def _draft(lens: Lens, check: Check, mould: bool) -> Iterator[_Reason]:
    """Draft counts where the spec sets a limit, which then decides, or where the lens comes from a mould."""
    limits = lens.spec.constraints
    for surface, face, limit in (
        ("inner", check.inner, limits.inner_draft_deg),
        ("outer", check.outer, limits.outer_draft_deg),
    ):
        if limit is not None and face.draft_deg.min < limit - _DRAFT_TOLERANCE_DEG:
            yield "fail", f"the {surface} face has a draft of {face.draft_deg.min:.2f} deg, the spec wants {limit:g}"
        elif limit is None and mould:
            reasons = (each.reason for each in check.verdicts if each.name == "draft" and each.surface == surface)
            if any(not each.holds for each in check.verdicts if each.name == "draft" and each.surface == surface):
                yield "fail", "; ".join(reasons)


def _no_tool(tools: Sequence[Finding]) -> Iterator[_Reason]:
    """A face fails where none of the shop's tools cuts all of it."""
    for surface in ("inner", "outer"):
        of_face = [verdict for verdict in tools if verdict.surface == surface]
        if of_face and not any(verdict.holds for verdict in of_face):
            yield "fail", "; ".join(verdict.reason for verdict in of_face)
