"""Result of the trace of stray light: its flux budget, its causes, and where it lands."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

from pydantic import Field

from lensforge.proof.proof_result import OnReceiver
from lensforge.results import (
    Count,
    Irradiance,
    NotNegative,
    Record,
    Share,
    SimulatedResult,
    stated,
)
from lensforge.results.arguments import require_choice
from lensforge.results.chart import light_unit
from lensforge.results.criteria import Criterion

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LightPath = Literal["sequential", "direct", "stray"]


class StrayFlux(Record):
    """Flux budget of the non-sequential trace; shares of the emitted flux, which add up to 1."""

    detected_direct: Share
    detected_stray: Share
    outside_direct: Share
    outside_stray: Share
    backward: Share
    absorbed: Share
    cover_glass: Share = 0.0
    bodies: Share = 0.0
    base: Share
    too_dim: Share
    leaked: Share


class StrayByCause(Record):
    """Detected stray light, by the first event that took it off the sequential path."""

    inner_reflection: Share
    outer_reflection: Share
    total_reflection: Share
    base: Share
    met_again: Share


class ReceiverStray(OnReceiver):
    """Stray light on one receiver.

    ``sequential``, ``direct``, ``stray``: irradiance (W/m^2) or intensity (W/sr)
    [row y, column x]. ``misplaced_flux``: flux that lands on other pixels than by the sequential trace, as a share of
    the emitted flux. ``peak_of_mean``: largest stray light over the mean of the sequential light; None where that is 0.
    """

    flux: StrayFlux
    balance_error: NotNegative
    detected_stray_by_cause: StrayByCause
    misplaced_flux: NotNegative
    nmse_vs_sequential: NotNegative | None
    peak_of_mean: NotNegative | None
    efficiency: Share
    efficiency_sequential: Share
    sequential: Irradiance
    direct: Irradiance
    stray: Irradiance


class StrayLight(SimulatedResult):
    """Stray light, which the sequential design leaves out: reflections, the base, absorption; on every receiver.

    The flux budget and the efficiencies are those of the first. Of a plate with several ``lenses`` one in the middle is
    lit; ``neighbours``: share of its light that meets another of them, above z = 0.
    """

    stage: ClassVar[str] = "stray"
    command: ClassVar[str] = "verify --stray"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "export")

    receivers: Annotated[tuple[ReceiverStray, ...], Field(min_length=1)]
    rays: Count
    base: Literal["polished", "black"]
    lenses: Count = 1
    neighbours: Share = 0.0
    absorption_per_mm: NotNegative
    cut_off: NotNegative
    depth: Count
    seconds: NotNegative
    criteria: tuple[Criterion, ...]

    @property
    def first(self) -> ReceiverStray:
        """The light on the first receiver."""
        return self.receivers[0]

    @stated
    def flux(self) -> StrayFlux:
        """Flux budget of the first receiver."""
        return self.first.flux

    @stated
    def efficiency(self) -> float:
        """Share of the emitted flux in the first receiver's window, reflections included."""
        return self.first.efficiency

    @stated
    def efficiency_sequential(self) -> float:
        """Share of the emitted flux in the first receiver's window, without reflections."""
        return self.first.efficiency_sequential

    def plot(self, axes: "Axes | None" = None, *, which: LightPath = "stray", receiver: str | None = None) -> "Axes":
        """Light on a receiver, by default the first (W/m^2 or W/sr): ``which`` part.

        Raises :class:`InputError` for an unknown part or receiver.
        """
        from lensforge.results.plots import plot_map

        require_choice("which", which, get_args(LightPath))
        named = {each.name: each for each in self.receivers}
        if receiver is not None:
            require_choice("receiver", receiver, named)
        shown = self.first if receiver is None else named[receiver]
        return plot_map(getattr(shown, which), shown.chart, light_unit(None, far_field=shown.far_field), axes)
