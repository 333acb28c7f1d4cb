"""The result of the evaluation: the light on the receiver, its metrics with their standard errors, and the flux."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

from pydantic import Field, model_validator

from lensforge.criteria import Criterion, at_most
from lensforge.figures.light_unit import light_unit
from lensforge.records import (
    Count,
    Irradiance,
    Metric,
    NotNegative,
    PixelCentres,
    Positive,
    Record,
    Share,
    SimulatedResult,
    Text,
)
from lensforge.records.arrays import MOST_PIXELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FLUX_ADDS_UP = 1e-9
Picture = Literal["map", "raw_map", "target_map"]


class Flux(Record):
    """The flux budget: shares of the emitted flux by fate; they add up to 1.

    ``detected``: in the window. ``outside``: on the receiver's plane outside the window. ``missed``: never reached that
    plane. ``reflected``: reflected at either surface, which a sequential design does not follow.
    """

    detected: Share
    outside: Share
    missed: Share
    total_reflection: Share
    not_converged: Share
    reflected: Share


class MissedByCause(Record):
    """Flux that missed the receiver's plane, by cause, as shares of the emitted flux."""

    backward: Share
    outside_cavity: Share
    base: Share
    missed_receiver: Share
    surfaces_intersect: Share


class TableErrors(Record):
    """The largest distance (nm) of each table from its exact surface."""

    inner: NotNegative
    outer: NotNegative


class TableError(Record):
    """Error of a stage's tables against the exact surfaces, by the same rays: an upper bound.

    ``hit_mm``, ``hit_max_mm``: root mean square and largest shift of the hits, over rays that arrive through both.
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


class RawMetrics(Record):
    """Metrics of the picture as it was binned and filtered: with ray noise, which raises NMSE and RSD, and darkens the
    darkest pixel. ``uniformity`` and ``rsd`` are None where the spec names no mask.
    """

    nmse: NotNegative
    uniformity: NotNegative | None
    rsd: NotNegative | None


def light_criteria(flux: Flux) -> tuple[Criterion, ...]:
    """The one criterion on a simulation: a search for a crossing that gives up must not lose any light."""
    remedy = "take a higher accuracy; please report the lens.json"
    return (at_most("flux not converged", flux.not_converged, 0.0, "of the source", remedy),)


class Light(SimulatedResult):
    """The light of a lens on its receiver, simulated with independent replicates of rays.

    ``map``, ``raw_map``, ``target_map``: irradiance (W/m^2) [row y, column x] after the filter, before it, and of the
    target, scaled to the flux there; ``axis_mm``: centres of the pixels along either axis. ``nmse``: Eq. (7) with the
    target scaled to the flux that arrives. ``efficiency``: share of the emitted flux in the window;
    ``share_in_target``: where the target is above a tenth of its maximum. ``uniformity``, ``rsd``: least over mean, and
    standard deviation over mean, in the centred square of ``uniform_mm``; None where the spec names none.

    ``nmse``, ``uniformity`` and ``rsd`` are those of the light, without ray noise; ``raw``: those of ``map``, with it.
    Where the replicates are too few to tell light from noise, both are the same, and there is no standard error.
    ``nmse_of_noise``: the NMSE of the noise in ``map``, about as much as it adds to that of ``raw``.
    """

    stage: ClassVar[str] = "evaluate"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "source")

    nmse: Metric
    efficiency: Metric
    share_in_target: Metric
    uniformity: Metric | None
    rsd: Metric | None
    raw: RawMetrics
    nmse_of_noise: NotNegative | None
    flux: Flux
    missed_by_cause: MissedByCause
    rays: Annotated[Count, Field(ge=1)]
    replicates: Annotated[Count, Field(ge=1)]
    pixels: Annotated[Count, Field(ge=1, le=MOST_PIXELS)]
    filter: Text
    receiver_mm: Positive
    window_mm: Positive
    uniform_mm: Positive | None
    distance_mm: Positive
    lumens_per_watt: Positive | None
    table_nodes: Count
    table_error_nm: TableErrors
    preset_error: PresetError | None
    seed: Count
    seconds: NotNegative
    criteria: tuple[Criterion, ...]
    map: Irradiance
    raw_map: Irradiance
    target_map: Irradiance
    axis_mm: PixelCentres

    @model_validator(mode="after")
    def _is_of_one_piece(self) -> "Light":
        if len(self.axis_mm) != self.pixels:
            raise ValueError(f"pixels = {self.pixels}, but its pictures have {len(self.axis_mm)} a side")
        total = sum(self.flux.model_dump().values())
        if abs(total - 1.0) > _FLUX_ADDS_UP:
            raise ValueError(f"flux: its shares add up to {total:.9g}, must be 1")
        return self

    def __str__(self) -> str:
        named = {"NMSE": self.nmse, "uniformity": self.uniformity, "efficiency": self.efficiency}
        figures = ", ".join(f"{name} {metric}" for name, metric in named.items() if metric is not None)
        where = "" if self.conditions is None else f" under other conditions ({self.conditions})"
        return f"light{where}: {figures} ({self.rays} rays, {self.pixels} x {self.pixels} pixels, {self.filter})"

    def plot(self, axes: "Axes | None" = None, *, which: Picture = "map") -> "Axes":
        """The light on the receiver in false colour with its scale, in lux where the source's lumens are known.

        Raises :class:`InputError` for an unknown map.
        """
        from lensforge.figures.plots import plot_map, require_choice

        require_choice("which", which, get_args(Picture))
        return plot_map(getattr(self, which), self.receiver_mm, light_unit(self.lumens_per_watt), axes)


class LightMetrics(Record):
    """The metrics of one lens among several; None where a metric has no meaning."""

    nmse: Metric
    uniformity: Metric | None
    rsd: Metric | None
    efficiency: Metric

    @staticmethod
    def of(light: Light) -> "LightMetrics":
        """Metrics of ``light``."""
        return LightMetrics(nmse=light.nmse, uniformity=light.uniformity, rsd=light.rsd, efficiency=light.efficiency)
