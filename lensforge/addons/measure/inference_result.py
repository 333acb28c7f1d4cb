"""Record of the errors of a made lens that pictures of its light tell."""

from typing import Annotated, ClassVar

from lensforge.addons.measure.measurement_result import Clipped, Covariance, Located, Pixel, Residual
from lensforge.public import public
from lensforge.results import Count, Metric, NotNegative, Number, Positive, Record, Share, StageResult, Text, stated
from lensforge.results.criteria import Criteria
from lensforge.results.figure import Criterion, Figure
from lensforge.results.numerals import percent, quantity
from lensforge.results.plots import Axes, plot_bars
from lensforge.results.stage_result import OnPage

NOT_SEEN = 0.8  # posterior over prior standard deviation: the pictures tell little
_EXPECTED = 4.0  # prior standard deviations: by chance no error of a lens is larger

Place = tuple[Number, Number, Number]


class InferredError(Record):
    """One error of the made lens.

    ``expected``: its prior standard deviation, in the unit of ``value``; ``remaining``: the share of it that the
    posterior has.
    """

    name: Text
    value: Metric
    expected: Positive
    remaining: Share

    @property
    def is_seen(self) -> bool:
        """True if the pictures tell of it."""
        return self.remaining <= NOT_SEEN

    @property
    def is_told(self) -> bool:
        """True if its standard error is well below its prior standard deviation, so that a correction gains by it."""
        return (self.value.standard_error or 0.0) <= NOT_SEEN * self.expected


class FurtherPicture(Record):
    """The picture that would tell most: place of the LED from its own (mm), and what ``remaining`` it would leave.

    ``error``: name of the error whose share is lowered most. ``remaining_before``, ``remaining``: of that error.
    """

    led_mm: Place
    error: Text
    remaining_before: Share
    remaining: Share

    def __str__(self) -> str:
        x, y, z = (quantity(shift, digits=3) for shift in self.led_mm)
        return f"LED at {x}, {y}, {z} mm"


@public
class Inference(StageResult):
    """Low-order errors of a made lens by pictures of its light with the LED moved.

    ``pictures``: names of the files. ``led_mm``: place of the LED in each, from its place in the design. ``corners``:
    pixels (column, row) of the target in all of them. ``corners_located``: how they were found; None if they were
    given. ``inner_form_um``, ``outer_form_um``: rms of the form errors over the hemisphere, less what noise adds.
    ``errors``: each error with its standard error; those of form are coefficients of Zernike polynomials of rms 1.
    ``covariance``: of what is wrong in the errors, each in units of what is expected of it.
    ``further``: the picture that would tell most. ``chi_square``: squared residual of the pictures over its variance;
    standard errors are larger by its root where it is above 1. ``over_expected``: the largest error over its prior
    standard deviation. ``clipped``: overexposed share of the target in the worst picture. ``noise_percent``: of a
    pixel of the model, of the mean light. ``pixels``: along the longer side of the model's pictures. ``rays``: of each.
    """

    stage: ClassVar[str] = "infer"
    on_page: ClassVar[OnPage] = OnPage("errors by pictures", in_row=("inner_form", "outer_form"))

    pictures: tuple[Text, ...]
    led_mm: tuple[Place, ...]
    corners: tuple[Pixel, Pixel, Pixel, Pixel]
    corners_located: Located | None
    inner_form_um: Annotated[Metric, Figure("Form error, inner face", "rms, low orders", key="inner_form")]
    outer_form_um: Annotated[Metric, Figure("Form error, outer face", "rms, low orders", key="outer_form")]
    errors: tuple[InferredError, ...]
    further: Annotated[
        FurtherPicture,
        Figure(
            "Best further picture",
            lambda made: (
                f"leaves {percent(made.further.remaining)} of {made.further.error}, now "
                f"{percent(made.further.remaining_before)}"
            ),
            key="further_picture",
            value=lambda made: str(made.further),
        ),
    ]
    chi_square: Residual
    over_expected: Annotated[
        NotNegative,
        Figure("Largest error", "over what is expected of it", key="inferred_largest", digits=3),
        Criterion(
            "<=",
            _EXPECTED,
            "largest error over what is expected of it",
            "give --expected for larger form errors; else it is another lens, or the LED is out of place",
            name="inferred_errors",
        ),
    ]
    clipped: Clipped
    noise_percent: NotNegative
    pixels: Count
    rays: Annotated[Count, Figure("Rays of a picture", key="inference_rays")]
    seed: Count
    seconds: NotNegative
    criteria: Criteria = ()
    covariance: Covariance

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Plot each error and its standard error, in units of its prior standard deviation."""
        values = {error.name: error.value.value / error.expected for error in self.errors}
        errors = [(error.value.standard_error or 0.0) / error.expected for error in self.errors]
        return plot_bars(values, "error over what is expected", axes, errors)

    @stated
    def not_seen(self) -> tuple[str, ...]:
        """Names of the errors that the pictures do not tell."""
        return tuple(error.name for error in self.errors if not error.is_seen)
