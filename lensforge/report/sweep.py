"""The record of a sweep: a design for each value of a field of the spec, or for each LED."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, ClassVar, get_args

from pydantic import Field, model_validator

from lensforge.light.evaluation_result import LightMetrics, MetricName
from lensforge.light.receiver_light import METRICS
from lensforge.public import public
from lensforge.report.results import Results
from lensforge.report.variation import ONE_FOR_ALL, AnyVariation, Variant
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
from lensforge.results.criteria import Criteria, under
from lensforge.results.numerals import unit_in, without_unit
from lensforge.results.plots import Axes, new_axes
from lensforge.results.verdict import TITLES, state_label
from lensforge.search.design_result import Margins
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.spec_files import section_sha256

# A name of a spec, and so never the way out of the sweep's own folder.
FolderName = Annotated[str, Field(strict=True, pattern=r"^[A-Za-z0-9_-]{1,64}$")]


class SweepRow(Record):
    """One design by its ``value``. ``folder``: its name, beside ``sweep.json``. ``cutting``: the verdict on it.

    ``by_led``: the light with each LED, of a lens for several; then each metric is that of the LED which has it worst.
    """

    value: Number | Text
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
    criteria: Criteria
    cutting: State = "undecided"
    by_led: dict[Text, LightMetrics] = Field(default_factory=dict)


@public
class Sweep(StageResult):
    """Designs by the value of a field, smallest first, or by the LED, in their order.

    ``inputs``: SHA-256 of the lenses, by folder. ``spec``: the one that was varied. ``spec_sha256``: its hash, in which
    every file that it names counts by its content. ``vary``: dotted name of the field, or "source". ``scale``: fields
    that keep their ratio to it. ``accuracy``: preset of every search. ``seed``: of every search. ``designs``: figures
    of each design. ``failed``: values without a design, each with the reason.
    """

    stage: ClassVar[str] = "sweep"
    made_from: ClassVar[tuple[str, ...]] = ()

    spec: Spec
    spec_sha256: Sha256
    vary: Text
    scale: tuple[Text, ...]
    accuracy: AnyAccuracy
    seed: Count
    designs: tuple[SweepRow, ...]
    failed: dict[Text, Text] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _every_design_has_its_lens(self) -> "Sweep":
        folders = [row.folder for row in self.designs]
        if sorted(self.inputs) != sorted(folders):
            raise ValueError(f"inputs: must be the lenses of {', '.join(folders)}, one for each of the designs")
        numbers = [value for value in self.values if not isinstance(value, str)]
        if any(low >= high for low, high in pairwise(numbers)):
            raise ValueError("designs: must have rising values")
        return self

    @property
    def values(self) -> tuple[float | str, ...]:
        """Values of the varied field, numbers smallest first, or names of LEDs."""
        return tuple(row.value for row in self.designs)

    @property
    def label(self) -> str:
        """The varied field in words, with its unit: ``roads.0: pole spacing (m)``."""
        section, _, field = self.vary.rpartition(".")
        unit = unit_in(field)
        title = without_unit(field).replace("_", " ")
        return f"{section}: " * bool(section) + title + f" ({unit})" * bool(unit)

    @property
    def criteria(self) -> Criteria:
        """Criteria of all designs, each named by its design too."""
        return tuple(under(row.folder, criterion) for row in self.designs for criterion in row.criteria)

    @property
    def facts(self) -> list[Group]:
        """A row for each design, and one for each value without; and of a lens for several LEDs the loss of each."""
        return [*map(self._row, self.designs), *self._losses(), *map(_without_design, self.failed.items())]

    def _losses(self) -> Iterator[Group]:
        rows = {row.value: row for row in self.designs}
        common = rows.get(ONE_FOR_ALL)
        for name, with_all in ({} if common is None else common.by_led).items():
            if name not in rows:
                continue
            row = rows[name]
            lost = 1.0 - with_all.efficiency.value / row.efficiency.value
            more = with_all.nmse.value / row.nmse.value
            facts = (
                Fact.share("own_efficiency", "Efficiency, own lens", row.efficiency),
                Fact.share("efficiency", "With one for all", with_all.efficiency),
                Fact("lost", "Lost", 100.0 * lost, "%", digits=2),
                Fact.measured("own_nmse", "NMSE, own lens", row.nmse, is_square=True),
                Fact.measured("nmse", "NMSE with one for all", with_all.nmse, is_square=True),
                Fact("more", "Ratio", more, digits=3),
            )
            yield Group("loss", f"{name} in one lens for all", facts)

    def _row(self, row: SweepRow) -> Group:
        missed = [criterion.key for criterion in row.criteria if not criterion.holds]
        names = [name for name in _METRICS if any(getattr(design, name) is not None for design in self.designs)]
        facts = (
            *(Fact(field, field, value) for field, value in row.changes.items()),
            *(_metric(name, getattr(row, name)) for name in names),
            Fact("radius", "Largest radius", row.max_radius_mm, "mm"),
            Fact("height", "Height", row.height_mm, "mm"),
            Fact("steps", "Steps", row.steps),
            Fact("criteria", "Criteria", f"missed: {', '.join(missed)}" if missed else "all met"),
            Fact("cutting", TITLES["cutting"], state_label(row.cutting)),
        )
        worst = f", worst of {len(row.by_led)} LEDs" if row.by_led else ""
        return Group("design", f"{row.folder}{worst}", facts)

    def rows(self) -> list[dict[str, float | int | bool | str | None]]:
        """Table rows, one for each design."""
        return [row.row() for row in self.designs]

    def joined(self, other: "Sweep") -> "Sweep":
        """This sweep with the designs of ``other``, else the same sweep; at equal values the designs of this one."""
        by_value = {row.value: row for row in self.designs}
        rows = by_value | {row.value: row for row in other.designs if row.value not in by_value}
        content = {name: getattr(self, name) for name in type(self).model_fields}
        designs = tuple(_in_order(rows))
        lenses = other.inputs | self.inputs
        content |= {"inputs": {row.folder: lenses[row.folder] for row in designs}, "designs": designs}
        return type(self).model_validate(content)

    def products(self) -> dict[str, bytes]:
        """The designs as CSV, and what has failed."""
        failed: list[Mapping[str, object]] = [{"value": value, "failed": why} for value, why in self.failed.items()]
        rows: list[Mapping[str, object]] = [*self.rows(), *failed]
        buffer = io.StringIO()
        columns = dict.fromkeys(name for row in rows for name in row)
        writer = csv.DictWriter(buffer, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return {".csv": buffer.getvalue().encode()}

    def curve(self, metric: MetricName) -> tuple[list[float | str], list[float], list[float]]:
        """Values of the varied field, ``metric``, and its standard error or 0, of the designs that have it."""
        points = [(row.value, measured) for row in self.designs if (measured := getattr(row, metric)) is not None]
        errors = [measured.standard_error or 0.0 for _, measured in points]
        return [value for value, _ in points], [measured.value for _, measured in points], errors

    def plot(self, axes: "Axes | None" = None, *, metric: MetricName = "nmse") -> "Axes":
        """Plot ``metric``, with standard errors. Raises :class:`InputError` for an unknown one."""
        require_choice("metric", metric, get_args(MetricName))
        axes = new_axes(axes)
        axes.errorbar(*self.curve(metric), marker="o")
        axes.set(xlabel=self.label, ylabel=metric)
        return axes


def _in_order(rows: Mapping[float | str, SweepRow]) -> Iterator[SweepRow]:
    """Numbers smallest first; names as they come."""
    numbers = sorted(value for value in rows if not isinstance(value, str))
    yield from (rows[value] for value in numbers)
    yield from (row for value, row in rows.items() if isinstance(value, str))


def _without_design(failed: tuple[str, str]) -> Group:
    value, why = failed
    return Group("failed", value, (Fact("failed", "No design", why, state="fail"),))


_METRICS = ("nmse", "efficiency", "share_in_target", "uniformity", "rsd")


def _metric(name: str, metric: Metric | None) -> Fact:
    declared = METRICS[name]
    fact = Fact.share if declared.unit == "%" else Fact.measured
    return fact(name, str(declared.label), metric, is_square=declared.is_square)


def sweep_of(spec: Spec, variation: AnyVariation, finished: Sequence[tuple[Variant, Sequence[Results]]]) -> Sweep:
    """The sweep of finished designs: variants of ``spec`` with the results of each of their kinds of lens, at least
    one of them.
    """
    lens = finished[0][1][0].lens
    if variation.is_numeric:
        finished = sorted(finished, key=lambda pair: pair[0].value)
    return Sweep(
        inputs={variant.spec.name: kinds[0].lens.sha256 for variant, kinds in finished},
        spec=spec,
        spec_sha256=section_sha256(spec),
        vary=variation.field,
        scale=variation.scaled,
        accuracy=lens.accuracy,
        seed=lens.seed,
        designs=tuple(_row(variant, kinds) for variant, kinds in finished),
    )


def _row(variant: Variant, kinds: Sequence[Results]) -> SweepRow:
    first, *further = kinds
    light = first.light
    design = first.design
    criteria = [criterion for _, criterion in first.criteria()]
    others_own = [under(merit.lens.kind, criterion) for merit in further for _, criterion in merit.criteria()]
    return SweepRow(
        value=variant.value,
        folder=variant.spec.name,
        changes=variant.changes,
        **{name: getattr(light.with_worst(name), name) for name in get_args(MetricName)},
        max_radius_mm=design.max_radius_mm,
        height_mm=design.height_mm,
        steps=design.steps,
        seconds=design.seconds,
        constraints=design.constraints,
        criteria=(*criteria, *others_own),
        cutting=first.verdict.with_parts({design.lens.kind: design.verdict for design in further}).cutting,
        by_led=LightMetrics.of_leds(light),
    )
