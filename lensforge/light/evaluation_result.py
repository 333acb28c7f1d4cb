"""The result of the evaluation: the light on every receiver, how it was simulated, and the judgement of each limit."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field

from lensforge.light.irradiated_body import IrradiatedBody
from lensforge.light.light_ways import LightWay
from lensforge.light.receiver_light import (
    EFFICIENCY,
    NMSE,
    RSD,
    UNIFORMITY,
    Flux,
    MissedByCause,
    Picture,
    Possible,
    RawMetrics,
    ReceiverLight,
)
from lensforge.light.seen_lens import SeenLens
from lensforge.light.travel_stops import Travel
from lensforge.public import public
from lensforge.results import Count, Fact, Image, Metric, NotNegative, Positive, Record, ResultByLed, Text, stated
from lensforge.results.arguments import require_choice
from lensforge.results.chart import light_unit
from lensforge.results.criteria import Criteria, JudgedLimits, StatedFigures
from lensforge.results.figure import Criterion, Figure, figure
from lensforge.results.numerals import square
from lensforge.results.plots import plot_map
from lensforge.results.record import MOST_PIXELS
from lensforge.scene.lens import Lens
from lensforge.sources.source_place import SourcePlace
from lensforge.spec import Spec
from lensforge.spec.light_limits import bounds_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class TableError(Record):
    """Error of a stage's tables against the exact surfaces, by the same rays: an upper bound.

    ``hit_mm``, ``hit_max_mm``: root mean square and largest shift of the hits, over rays that arrive through both; in
    the far field, which has no width in mm, on its chart of radius 2 sin(gamma / 2).
    """

    table_error_nm: NotNegative
    hit_max_mm: NotNegative
    hit_mm: Metric
    irradiance_nmse: Metric
    efficiency: Metric


class PresetError(Record):
    """Error of the accuracy preset's tables, measured on this scene."""

    rays: Count
    scrambles: Count
    design: TableError
    evaluation: TableError


class FittedLight(Record):
    """Light on the first receiver by ``rays`` of a file: those of the search, optimistic if it fits their noise, or
    those that no model of the file was fitted to.
    """

    rays: Count
    nmse: Metric
    efficiency: Metric


_BY_SEARCH = "by the {fitted.rays} rays of the search, to which the lens is fitted"
_BY_FILE = "by {by_file.rays} rays of the file, which the model of the LED was not fitted to"


def _tables(light: "Light", lens: Lens) -> str:
    return f"NMSE of the tables of --accuracy {lens.accuracy} against the exact surfaces"


def _table_hits(light: "Light", lens: Lens) -> Metric | None:
    """Root mean square shift of the hits, in the unit of the first receiver's chart."""
    if light.preset_error is None:
        return None
    chart = light.first.chart
    return Metric(value=chart.labelled(light.preset_error.evaluation.hit_mm.value), unit=chart.unit)


def _has_tables(light: "Light", lens: Lens) -> bool:
    return light.preset_error is not None


def _has_error(light: "Light", lens: Lens) -> bool:
    return light.nmse.standard_error is not None


MetricName = Literal["nmse", "uniformity", "rsd", "efficiency", "share_in_target"]


@public
class Light(ResultByLed):
    """Light of a lens on its receivers, simulated with independent replicates of rays.

    Metrics, flux and maps are those of the first receiver; of a lens with several states those in the first. Of a ray
    file they are by rays that the search has not used.

    ``receivers``: metrics, flux and maps on each receiver, in the order of the spec. ``limits``: those of the spec,
    each with its value and judgement. ``figures``: those of the spec's application. ``ways``: shares of the emitted
    flux by way, of a lens of more than two faces. ``seen``: the lens as eyes of limits see it. ``on_bodies``: the light
    on measured bodies of the scene. ``place``: of the LED, where it is from a ray file or is moved. ``travel``: the
    light of the LED between its places in the states, where these differ by them alone. ``replicates``: independent
    samples, whose scatter gives the standard errors. ``pixels``: along the longer side of a map as required; lamps
    together may need somewhat more or fewer.
    ``filter``: the filter of the maps, in words. ``lumens_per_watt``: efficacy of the light; None if nothing states it.
    ``table_nodes``: across the tables by which faces are traced. ``table_error_nm``: their largest error, by face.
    ``preset_error``: their effect on the light; None if it was not measured. ``fitted``: figures by the rays of the
    search. ``by_file``: of a model of a file, figures by rays of the file that it was not fitted to.
    """

    stage: ClassVar[str] = "evaluate"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "source")
    omit_if_empty: ClassVar[tuple[str, ...]] = ("figures", "ways", "seen", "on_bodies", "place", "travel")
    judged_in: ClassVar[tuple[str, ...]] = ("criteria", "limits")

    receivers: Annotated[tuple[ReceiverLight, ...], Field(min_length=1)]
    limits: JudgedLimits = ()
    figures: StatedFigures = ()
    ways: tuple[LightWay, ...] = ()
    seen: tuple[SeenLens, ...] = ()
    on_bodies: tuple[IrradiatedBody, ...] = ()
    place: SourcePlace | None = None
    travel: Travel | None = None
    others: "tuple[Light, ...]" = ()
    rays: Annotated[
        Count,
        Field(ge=1),
        Figure("Rays", lambda light, lens: "" if light.fitted is None else "which the search has not used"),
    ]
    replicates: Annotated[Count, Field(ge=1)]
    pixels: Annotated[
        Count,
        Field(ge=1, le=MOST_PIXELS),
        Figure(
            "Pixels",
            lambda light, lens: light.filter.replace("pixel^2", "pixel²"),
            value=lambda light, lens: " × ".join(map(str, light.map.shape[::-1])),
        ),
    ]
    filter: Text
    lumens_per_watt: Positive | None
    table_nodes: Count
    table_error_nm: dict[str, NotNegative]
    fitted: Annotated[
        FittedLight | None,
        Figure("NMSE of fitted rays", _BY_SEARCH, key="fitted_nmse", of="nmse", is_square=True),
        Figure("Efficiency, fitted rays", _BY_SEARCH, key="fitted_efficiency", of="efficiency", unit="%"),
    ] = None
    by_file: Annotated[
        FittedLight | None,
        Figure("NMSE, file’s own rays", _BY_FILE, key="file_nmse", of="nmse", is_square=True),
        Figure("Efficiency, file’s own rays", _BY_FILE, key="file_efficiency", of="efficiency", unit="%"),
    ] = None
    preset_error: Annotated[
        PresetError | None,
        Figure("Simulation error", _tables, key="table_nmse", of="evaluation.irradiance_nmse", is_square=True),
        Figure("Error of hit points", "rms, of the same tables", key="table_hits", value=_table_hits, digits=2),
    ]
    seed: Count
    seconds: NotNegative
    criteria: Criteria = ()

    def judgements_on(self, lens: Any) -> Mapping[str, Iterable[Fact]]:
        """Judge by the bounds that the spec of ``lens`` states now; other facts are kept as stored."""
        return {"limits": self._limits_of(lens.spec)}

    def _limits_of(self, spec: Spec) -> Iterator[Fact]:
        for limit, requirement in zip_longest(self.limits, bounds_of(spec.limits) if self.limits else ()):
            name, sense, bound = requirement or (limit.key, limit.sense, limit.limit)
            yield replace(limit or Fact(name, name, None), key=name, sense=sense, limit=bound)

    @property
    def first(self) -> ReceiverLight:
        """Light on the first receiver."""
        return self.receivers[0]

    @stated
    def nmse(self) -> Metric:
        """NMSE on the first receiver."""
        return self.first.nmse

    @stated
    def efficiency(self) -> Metric:
        """Share of the emitted flux in the first receiver's window."""
        return self.first.efficiency

    @stated
    def share_in_target(self) -> Metric:
        """Share of the emitted flux in the first receiver's target."""
        return self.first.share_in_target

    @stated
    def uniformity(self) -> Metric | None:
        """Least over mean in the first receiver's mask."""
        return self.first.uniformity

    @stated
    def rsd(self) -> Metric | None:
        """Standard deviation over mean in the first receiver's mask."""
        return self.first.rsd

    @stated
    def possible(self) -> Possible:
        """Bounds that physics sets on the first receiver."""
        return self.first.possible

    @stated
    def flux(self) -> Flux:
        """Flux budget of the first receiver."""
        return self.first.flux

    @property
    @figure(
        Criterion(
            "<=",
            0.0,
            "flux of rays that did not converge",
            "take a higher accuracy; please report the lens.json",
            name="flux not converged",
            unit="of the source",
        )
    )
    def not_converged(self) -> float:
        """Share of the flux for which the search for a crossing gave up; must be 0."""
        return self.first.flux.not_converged

    def with_worst(self, metric: MetricName) -> "Light":
        """Light in the state with the worst value of ``metric``; in the first state if no state defines it."""
        lights = [light for light in (self, *self.others) if getattr(light, metric) is not None]
        worst = max if metric in ("nmse", "rsd") else min
        return worst(lights, key=lambda light: getattr(light, metric).value, default=self)

    @property
    def missed_by_cause(self) -> MissedByCause:
        """Flux that missed the first receiver, by cause."""
        return self.first.missed_by_cause

    @property
    @figure(Figure("NMSE with ray noise", "before the noise is subtracted", key="raw_nmse", of="nmse", when=_has_error))
    def raw(self) -> RawMetrics:
        """Metrics of the first receiver's picture, with ray noise."""
        return self.first.raw

    @property
    @figure(Figure("NMSE of the ray noise", key="noise_nmse", digits=2, when=_has_tables))
    def nmse_of_noise(self) -> float | None:
        """NMSE of the noise in the first receiver's map."""
        return self.first.nmse_of_noise

    @property
    def map(self) -> Image:
        """Light on the first receiver (W/m^2 or W/sr), [row y, column x]."""
        return self.first.map

    @property
    def raw_map(self) -> Image:
        """Light on the first receiver before the filter (W/m^2 or W/sr), [row y, column x]."""
        return self.first.raw_map

    @property
    def target_map(self) -> Image:
        """Its target, scaled to the flux that arrives."""
        return self.first.target_map

    def __str__(self) -> str:
        several = len(self.receivers) > 1
        figures = "; ".join(
            f"{receiver.name}: {_figures(receiver)}" if several else _figures(receiver) for receiver in self.receivers
        )
        figures += "".join(f"; with {other.led}: {_figures(other.receivers[0])}" for other in self.others)
        where = "" if self.conditions is None else f" under other conditions ({self.conditions})"
        rows, columns = self.map.shape
        return f"light{where}: {figures} ({self.rays} rays, {columns} x {rows} pixels, {self.filter})"

    def plot(self, axes: "Axes | None" = None, *, which: Picture = "map", receiver: str | None = None) -> "Axes":
        """Draw the light on a receiver, by default the first, in false colour, in lux or candela if lumens are known.

        The line is that of the target at half of its peak.

        Raises :class:`InputError` for an unknown map or receiver.
        """
        require_choice("which", which, get_args(Picture))
        by_name = {receiver.name: receiver for receiver in self.receivers}
        if receiver is not None:
            require_choice("receiver", receiver, by_name)
        shown = self.first if receiver is None else by_name[receiver]
        unit = light_unit(self.lumens_per_watt, far_field=shown.chart.far_field)
        outline = None if which == "target_map" else shown.target_map
        return plot_map(getattr(shown, which), shown.chart, unit, axes, outline)


def _figures(light: ReceiverLight) -> str:
    metrics = {"uniformity": light.uniformity, "efficiency": light.efficiency}
    further = (f"{name} {metric}" for name, metric in metrics.items() if metric is not None)
    return ", ".join((f"NMSE {square(light.nmse.value, light.nmse.standard_error)}", *further))


class LightMetrics(Record):
    """The metrics of one lens among several; None if a metric has no meaning."""

    nmse: Annotated[Metric, NMSE]
    uniformity: Annotated[Metric | None, UNIFORMITY]
    rsd: Annotated[Metric | None, RSD]
    efficiency: Annotated[Metric, EFFICIENCY]

    @staticmethod
    def of(light: Light) -> "LightMetrics":
        """Metrics of ``light``."""
        return LightMetrics(nmse=light.nmse, uniformity=light.uniformity, rsd=light.rsd, efficiency=light.efficiency)

    @staticmethod
    def of_leds(light: Light) -> "dict[str, LightMetrics]":
        """Metrics by the name of each LED; empty for a single one."""
        return {case.led: LightMetrics.of(case.result) for case in light.cases() if case.led}
