"""A sweep: values of a field of the spec, a design for each of them, and the record of all."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

from pydantic import Field, model_validator

from lensforge.errors import InputError
from lensforge.light.light_facts import METRICS
from lensforge.report.results import Results
from lensforge.results import (
    Count,
    Fact,
    Group,
    Metric,
    NotNegative,
    Number,
    Positive,
    Record,
    Sha256,
    StageResult,
    State,
    Text,
)
from lensforge.results.arguments import require_choice
from lensforge.results.criteria import Criterion
from lensforge.search.design_result import Margins
from lensforge.spec import Accuracy, Spec
from lensforge.spec.spec_files import section_sha256
from lensforge.spec.spec_section import Section

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_VALUES = 100


@dataclass(frozen=True)
class Variant:
    """One design of a sweep: the varied field's value, every field that was changed, the spec that results."""

    value: float
    changes: dict[str, float]
    spec: Spec


@dataclass(frozen=True)
class Variation:
    """``field`` (dotted path) takes each of ``values``, in order; those of ``scaled`` keep their ratio to it."""

    field: str
    values: tuple[float, ...]
    scaled: tuple[str, ...] = ()

    def variants(self, base: Spec) -> list[Variant]:
        """The designs, smallest value first. Raises :class:`InputError` for values that a spec cannot have."""
        return [self._variant(base, value) for value in self.values]

    def _variant(self, base: Spec, value: float) -> Variant:
        for field in (self.field, *self.scaled):
            _value(base, field)
        changes = {self.field: value}
        if self.scaled:
            before = _number(base, self.field)
            changes |= {field: _number(base, field) * value / before for field in self.scaled}
        return Variant(value, changes, base.replace(changes, name=variant_name(base.name, value)))


def variation_of(field: str, values: Sequence[float], scaled: Sequence[str] = ()) -> Variation:
    """``field`` at each of ``values``, sorted, each kept once. Raises :class:`InputError` for an invalid variation."""
    if not isinstance(field, str) or isinstance(scaled, str) or not all(isinstance(name, str) for name in scaled):
        raise InputError(
            f"sweep: field = {field!r}, scale = {scaled!r}: a field's dotted name, and a list of such names"
        )
    try:
        kept = tuple(sorted({float(value) for value in values}))
    except (TypeError, ValueError):
        raise InputError(f"{field} = {str(values)[:60]}: give 2 to {MOST_VALUES} numbers") from None
    if not (2 <= len(kept) <= MOST_VALUES and all(map(isfinite, kept))):
        raise InputError(f"{field}: {len(kept)} values; give 2 to {MOST_VALUES} finite numbers")
    if field in scaled:
        raise InputError(f"{field}: this is the field that varies; name others to be scaled")
    return Variation(field, kept, tuple(scaled))


def parse_variation(text: str, scaled: Sequence[str] = ()) -> Variation:
    """Parse ``section.field=v1,v2,...``. Raises :class:`InputError` for anything else."""
    field, _, listed = text.partition("=")
    try:
        values = [float(part) for part in listed.split(",")]
    except ValueError:
        raise InputError(f"--vary {text}: give section.field=value,value,... with numbers as values") from None
    return variation_of(field, values, scaled)


def variant_name(name: str, value: float) -> str:
    """Name of a design and of its folder: the spec's name and the value, in characters that a spec's name may have."""
    shown = f"{value:g}".replace(".", "_").replace("+", "")
    return f"{name[: 63 - len(shown)]}-{shown}"


def _value(spec: Spec, field: str) -> object:
    """Value of ``field`` in ``spec``. Raises :class:`InputError` where there is no such field."""
    found: object = spec
    for part in field.split("."):
        if isinstance(found, tuple) and part in map(str, range(len(found))):
            found = found[int(part)]
            continue
        known = type(found).model_fields if isinstance(found, Section) else {}
        if part not in known:
            there = ", ".join(sorted(known)) or "none within it"
            raise InputError(f"{field}: no such field in this spec; there are: {there}")
        found = getattr(found, part)
    return found


def _number(spec: Spec, field: str) -> float:
    value = _value(spec, field)
    if isinstance(value, bool) or not isinstance(value, int | float) or value == 0.0:
        raise InputError(f"{field} = {value!r} in the spec: only a number other than 0 can be scaled")
    return float(value)


# A name of a spec, and so never the way out of the sweep's own folder.
FolderName = Annotated[str, Field(strict=True, pattern=r"^[A-Za-z0-9_-]{1,64}$")]
SweptMetric = Literal["nmse", "uniformity", "rsd", "efficiency", "share_in_target"]


class SweepRow(Record):
    """One design by its ``value``. ``folder``: its name, beside ``sweep.json``. ``cutting``: the verdict on it."""

    value: Number
    folder: FolderName
    changes: dict[Text, Number]
    nmse: Metric
    uniformity: Metric | None
    rsd: Metric | None
    efficiency: Metric
    share_in_target: Metric
    max_radius_mm: Positive
    height_mm: Positive
    steps: Count
    seconds: NotNegative
    constraints: Margins
    criteria: tuple[Criterion, ...]
    cutting: State = "undecided"


class Sweep(StageResult):
    """Designs by the value of the field ``vary``, smallest first; the fields of ``scale`` keep their ratio to it.

    ``spec``: the one that was varied; ``spec_sha256``: its hash, in which every file that it names counts by its
    content. ``inputs``: the lenses, by folder.
    """

    stage: ClassVar[str] = "sweep"
    made_from: ClassVar[tuple[str, ...]] = ()

    spec: Spec
    spec_sha256: Sha256
    vary: Text
    scale: tuple[Text, ...]
    accuracy: Accuracy
    seed: Count
    designs: tuple[SweepRow, ...]

    @model_validator(mode="after")
    def _every_design_has_its_lens(self) -> "Sweep":
        folders = [row.folder for row in self.designs]
        if sorted(self.inputs) != sorted(folders):
            raise ValueError(f"inputs: must be the lenses of {', '.join(folders)}, one for each of the designs")
        if any(low >= high for low, high in zip(self.values, self.values[1:], strict=False)):
            raise ValueError("designs: must have rising values")
        return self

    @property
    def values(self) -> tuple[float, ...]:
        """Values of the varied field, smallest first."""
        return tuple(row.value for row in self.designs)

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        """The criteria of all designs, each named by its design too."""
        return tuple(
            criterion.model_copy(update={"name": f"{row.folder}: {criterion.name}"})
            for row in self.designs
            for criterion in row.criteria
        )

    @property
    def facts(self) -> list[Group]:
        """A row for each design, by the value of the varied field."""
        return [self._row(row) for row in self.designs]

    def _row(self, row: SweepRow) -> Group:
        missed = [criterion.name for criterion in row.criteria if not criterion.passed]
        names = [name for name in METRICS if any(getattr(each, name) is not None for each in self.designs)]
        facts = (
            *(Fact(field, field, value) for field, value in row.changes.items()),
            *(_metric(name, getattr(row, name)) for name in names),
            Fact("radius", "Largest radius", row.max_radius_mm, "mm"),
            Fact("height", "Height", row.height_mm, "mm"),
            Fact("steps", "Steps", row.steps),
            Fact("criteria", "Criteria", f"missed: {', '.join(missed)}" if missed else "all met"),
            Fact("cutting", "Cutting", row.cutting),
        )
        return Group("design", row.folder, facts)

    def rows(self) -> list[dict[str, float | int | bool | str | None]]:
        """Table rows, one for each design."""
        return [row.row() for row in self.designs]

    def joined(self, other: "Sweep") -> "Sweep":
        """This sweep with the designs of ``other``, else the same sweep; at equal values the designs of this one."""
        rows = {row.value: row for row in (*other.designs, *self.designs)}
        content = {name: getattr(self, name) for name in type(self).model_fields}
        designs, lenses = tuple(rows[value] for value in sorted(rows)), other.inputs | self.inputs
        content |= {"inputs": {row.folder: lenses[row.folder] for row in designs}, "designs": designs}
        return type(self).model_validate(content)

    def curve(self, metric: SweptMetric) -> tuple[list[float], list[float], list[float]]:
        """Values of the varied field, ``metric``, and its standard error or 0, of the designs that have it."""
        found = [(row.value, measured) for row in self.designs if (measured := getattr(row, metric)) is not None]
        errors = [measured.standard_error or 0.0 for _, measured in found]
        return [value for value, _ in found], [measured.value for _, measured in found], errors

    def plot(self, axes: "Axes | None" = None, *, metric: SweptMetric = "nmse") -> "Axes":
        """Plot ``metric``, with standard errors. Raises :class:`InputError` for an unknown one."""
        from lensforge.results.plots import new_axes

        require_choice("metric", metric, get_args(SweptMetric))
        axes = new_axes(axes)
        axes.errorbar(*self.curve(metric), marker="o")
        axes.set(xlabel=self.vary, ylabel=metric)
        return axes


def _metric(name: str, metric: Metric | None) -> Fact:
    shares = ("efficiency", "share_in_target")
    return Fact.share(name, METRICS[name], metric) if name in shares else Fact.measured(name, METRICS[name], metric)


def sweep_of(spec: Spec, variation: Variation, found: Sequence[tuple[Variant, Results]]) -> Sweep:
    """The sweep of finished designs: variants of ``spec`` with their results, at least one of them."""
    lens = found[0][1].lens
    found = sorted(found, key=lambda pair: pair[0].value)
    return Sweep(
        inputs={variant.spec.name: results.lens.sha256 for variant, results in found},
        spec=spec,
        spec_sha256=section_sha256(spec),
        vary=variation.field,
        scale=variation.scaled,
        accuracy=lens.accuracy,
        seed=lens.seed,
        designs=tuple(_row(variant, results) for variant, results in found),
    )


def _row(variant: Variant, results: Results) -> SweepRow:
    light, design = results.light, results.design
    return SweepRow(
        value=variant.value,
        folder=variant.spec.name,
        changes=variant.changes,
        **{name: getattr(light, name) for name in get_args(SweptMetric)},
        max_radius_mm=design.max_radius_mm,
        height_mm=design.height_mm,
        steps=design.steps,
        seconds=design.seconds,
        constraints=design.constraints,
        criteria=tuple(criterion for _, criterion in results.criteria()),
        cutting=results.verdict.cutting,
    )
