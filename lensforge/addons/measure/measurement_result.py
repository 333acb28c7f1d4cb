"""Results of measuring the part: a photograph of its light, points on a face, and a face corrected by them."""

from collections.abc import Iterator
from math import inf
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.addons.measure.part_series import FaceMap, PartSeries
from lensforge.cad.face_tolerance import FINEST_MRAD, FINEST_NM
from lensforge.cad.part import FileStamp, SplineNodes
from lensforge.cad.part_limits import round_trip_limit, step_face_limit
from lensforge.light.evaluation_result import LightMetrics
from lensforge.public import public
from lensforge.results import (
    Array,
    Count,
    Extent,
    Flag,
    Image,
    InFile,
    Irradiance,
    Metric,
    NotNegative,
    Number,
    Positive,
    Record,
    Share,
    SimulatedResult,
    StageResult,
    Text,
    stated,
)
from lensforge.results.arguments import require_choice
from lensforge.results.chart import Chart
from lensforge.results.criteria import Criteria
from lensforge.results.figure import Apart, Criterion, Figure, figure
from lensforge.results.numerals import percent, quantity
from lensforge.results.plots import Axes, plot_curves, plot_face
from lensforge.results.stage_result import OnPage
from lensforge.spec.processes import Process

_ERRORS = 3.0  # standard errors from which a cause is named


class Alignment(Record):
    """Similarity transform from the simulated light to the photographed one, about the centre of the target.

    ``scale``: above 1 where the photographed light is larger; ``rotation_deg``: counter-clockwise as the simulation is
    shown. None if the light cannot determine it: a round pattern has no rotation, uniform light no size. Standard
    errors are by the differences of the pictures, over blocks of the target, and by the corners.
    """

    displacement_x_mm: Metric | None
    displacement_y_mm: Metric | None
    scale: Metric | None
    rotation_deg: Metric | None

    def causes(self) -> Iterator[str]:
        """Probable cause of each significant figure, as a phrase."""
        if _beyond_doubt(self.scale, 1.0):
            where = "farther away" if self.scale is not None and self.scale.value > 1.0 else "closer"
            yield (
                f"scale {self.scale}: the target may stand {where} than in the spec, by that ratio, or "
                "the corners bound a target of another size than given"
            )
        if _beyond_doubt(self.rotation_deg, 0.0):
            yield (
                f"rotation {self.rotation_deg}: the lens and the target may be turned against each other about the "
                "axis, or the corners are not those of the target; a turned camera alone is undone by the corners"
            )
        for axis, shift in (("x", self.displacement_x_mm), ("y", self.displacement_y_mm)):
            if _beyond_doubt(shift, 0.0):
                yield (
                    f"displacement along {axis} {shift}: the target may be off the axis, the lens tilted, or the "
                    "LED off the centre of the lens"
                )


def _beyond_doubt(metric: Metric | None, expected: float) -> bool:
    if metric is None or metric.standard_error is None:
        return False
    return abs(metric.value - expected) > _ERRORS * metric.standard_error


CLIPPED_SHARE = 0.01  # of the target: clipped pixels make a pattern look more uniform than it is
USED_SHARE = 0.9  # of the points must lie over the surface once registered
COVERED_SHARE = 0.8  # of the surface must be measured: elsewhere the design is assumed
_RESIDUAL = 2.0  # chi-square beyond which there are errors that are not among the unknowns


Clipped = Annotated[
    Share,
    Figure("Saturated pixels", "of the target", unit="%", digits=3),
    Criterion(
        "<=",
        CLIPPED_SHARE,
        "saturated pixels of the photograph",
        "use a shorter exposure, the same for all photographs",
        name="photo_clipped",
        unit="of the target",
    ),
]
Residual = Annotated[
    NotNegative,
    Figure("Residual (χ²)", "1 where noise alone is left", key="chi_square", digits=3),
    Criterion(
        "<=",
        _RESIDUAL,
        "residual of the pictures over their noise",
        "the lens has errors of higher order, or the LED is another: standard errors count it",
        name="inferred_residual",
    ),
]
Covariance = Annotated[Float[np.ndarray, "k k"], Array("k", "k")]
Pixel = tuple[Number, Number]  # column, row
AxisName = Literal["x", "y"]
Registration = Literal["rigid", "shift", "none"]


class Located(Record):
    """Quality of corners that were found in the photographs, not given.

    ``seen_in``: "on", "off", or "the light" for on minus off. ``lit``: they are corners of the light itself, not of a
    panel. Scatter of the points of the worst edge about its line, and its bow, in pixels.
    """

    seen_in: Text
    lit: bool
    edge_rms_px: NotNegative
    edge_bow_px: NotNegative


class Similarity(Record):
    """Similarity of two images. ``ssim``: structural similarity, 1 for equal images."""

    ssim: Number
    nmse: NotNegative


class Evenness(Record):
    """Uniformity and RSD within the spec's region of uniform light; None if it has none."""

    uniformity: Number | None
    rsd: Number | None


@public
class PhotoComparison(StageResult):
    """A photograph of the part's light against the simulation, both scaled to a mean of 1.

    ``led``: in the photographs, of a lens for several. ``on``, ``off``: names of the photographs. ``corners``: pixels
    (column, row) of the target, clockwise from the top left. ``corners_located``: how they were found; None if they
    were given. ``target_mm``: width and height of the rectangle that they bound. ``width_mm``, ``height_mm``: of the
    images. ``gamma``: exponent of the camera. ``pixels``: along the longer side of the images. ``ssim``: structural
    similarity, 1 for equal images. ``nmse``: of the images. ``alignment``: shift, turn and scale from the simulated to
    the photographed light. ``aligned``: both figures after that. ``measured_evenness``, ``simulated_evenness``:
    uniformity in the region of the spec. ``clipped``: overexposed share of the target. ``measured``, ``simulated``:
    images [row y, column x].
    """

    omit_if_empty: ClassVar[tuple[str, ...]] = ("led",)
    stage: ClassVar[str] = "compare"
    on_page: ClassVar[OnPage] = OnPage("photograph", further=("ssim",))
    command: ClassVar[str] = "compare --on"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "evaluate")

    led: Text = ""
    on: Text
    off: Text | None
    corners: tuple[Pixel, Pixel, Pixel, Pixel]
    corners_located: Located | None
    target_mm: tuple[Positive, Positive]
    width_mm: Positive
    height_mm: Positive
    gamma: Positive
    pixels: Count
    ssim: Annotated[Number, Figure("Similarity (SSIM)", "to the simulation; 1 is equal", digits=3)]
    nmse: Annotated[NotNegative, Figure("NMSE against simulation", key="photo_nmse", digits=3)]
    alignment: Annotated[
        Alignment,
        Figure("Shift in x", key="displacement_x_mm", of="displacement_x_mm"),
        Figure("Shift in y", key="displacement_y_mm", of="displacement_y_mm"),
        Figure("Scale", "measured/simulated", key="scale", of="scale"),
        Figure("Rotation", "counter-clockwise", key="rotation_deg", of="rotation_deg"),
    ]
    aligned: Annotated[
        Similarity,
        Figure("SSIM after alignment", key="aligned_ssim", of="ssim", digits=3),
        Figure("NMSE after alignment", key="aligned_nmse", of="nmse", digits=3),
    ]
    measured_evenness: Annotated[
        Evenness,
        Figure(
            "Uniformity, measured",
            "simulated {simulated_evenness.uniformity:3}",
            key="photo_uniformity",
            of="uniformity",
            digits=3,
        ),
    ]
    simulated_evenness: Evenness
    clipped: Clipped
    criteria: Criteria = ()
    measured: Image
    simulated: Image

    @stated
    def likely_cause(self) -> str:
        """Probable causes of significant misalignment; empty without any."""
        return "; ".join(self.alignment.causes())

    @property
    def chart(self) -> Chart:
        """Size of the images, for figures."""
        return Chart(self.width_mm, self.height_mm)

    def plot(self, axes: "Axes | None" = None, *, axis: AxisName = "x") -> "Axes":
        """Plot photograph and simulation along a central line. Raises :class:`InputError` for an unknown axis."""
        require_choice("axis", axis, get_args(AxisName))
        rows, columns = self.measured.shape
        places = self.chart.x(columns) if axis == "x" else self.chart.y(rows)
        images = {"measured": self.measured, "simulated": self.simulated}
        curves = {name: (places, central_line(image, axis)) for name, image in images.items()}
        return plot_curves(curves, (f"{axis} (mm)", "irradiance over its mean"), axes)


def central_line(image: Float[np.ndarray, "h w"], axis: AxisName) -> Float[np.ndarray, " p"]:
    """Line through the centre along ``axis``; the mean of the two middle lines if their number is even."""
    lines = image if axis == "x" else image.T
    middle = len(lines) // 2
    return np.asarray(lines[middle - (len(lines) % 2 == 0) : middle + 1].mean(axis=0))


class RegisteredPose(Record):
    """Rotation vector and translation that register the points to the design.

    Standard errors are by noise and form error of the part; None for what was not fitted, or is not determined.
    """

    rotation_x_deg: Metric
    rotation_y_deg: Metric
    rotation_z_deg: Metric
    translation_x_mm: Metric
    translation_y_mm: Metric
    translation_z_mm: Metric


class DeviationExtent(Record):
    """Extent of a signed deviation: of points, each counting once, or over a face, by its area."""

    pv: NotNegative
    rms: NotNegative
    min: Number
    max: Number

    @staticmethod
    def of(values: Float[np.ndarray, " n"], areas: Float[np.ndarray, " n"] | None = None) -> "DeviationExtent":
        """Extent of ``values``; the mean square is weighted by ``areas``, or each value counts once."""
        return DeviationExtent(
            pv=float(np.ptp(values)),
            rms=float(np.sqrt(np.average(values**2, weights=areas))),
            min=float(values.min()),
            max=float(values.max()),
        )


def area_extent(values: Float[np.ndarray, "*n"], areas: Float[np.ndarray, "*n"]) -> Extent:
    """Largest absolute value, and rms over the area, without NaN."""
    inside = np.isfinite(values)
    square = float(np.sum(areas[inside] * values[inside] ** 2) / np.sum(areas[inside]))
    return Extent(max=float(np.abs(values[inside]).max()), rms=float(np.sqrt(square)))


class MeasuredLight(Record):
    """Light with one LED as designed, with the measured face, and the corrected one; the ``change`` of the last."""

    design: LightMetrics
    measured: LightMetrics
    corrected: LightMetrics | None = None
    change: LightMetrics


@public
class MeasuredFace(SimulatedResult):
    """Result on a measured face: maps over its chart [Y, X], NaN outside.

    ``surface``: name of the face. ``registration``: motion that was fitted. ``point_count``: of the points in the file.
    ``used_share``: of the points that lie on the face. ``covered_share``: of the face that has points nearby. ``pose``:
    the fitted motion. ``design``: light as designed. ``change``: of the last light less ``design``, on the first
    receiver, by the same rays; of a lens for several LEDs with the first. ``by_led``: the metrics with each LED.
    ``chart``: places of their samples along either axis. ``area_mm2``: area of the face at each sample. ``series``:
    scatter of several parts; the rest is then of the face that they have in common, shares are those of the worst part,
    and each part has its own pose, which is not stated.
    """

    omit_if_empty: ClassVar[tuple[str, ...]] = ("by_led", "series")
    plotted: ClassVar[tuple[str, str]]  # field of the map that is plotted, and its name

    surface: Text
    registration: Registration
    point_count: Count
    used_share: Annotated[
        Share,
        Criterion(
            ">=",
            USED_SHARE,
            "measured points that lie on the surface",
            "give the points of this surface alone, close to lens coordinates",
            name="points_used",
            unit="of the points",
        ),
    ]
    covered_share: Annotated[
        Share,
        Criterion(
            ">=",
            COVERED_SHARE,
            "part of the surface that was measured",
            "measure more of the surface",
            name="surface_covered",
            unit="of the surface",
        ),
    ]
    pose: RegisteredPose
    rays: Count
    design: Annotated[LightMetrics, Apart()]
    change: Annotated[LightMetrics, Apart()]
    by_led: dict[Text, MeasuredLight] = Field(default_factory=dict)
    series: Annotated[PartSeries | None, Apart()] = None
    criteria: Criteria = ()
    chart: Annotated[Float[np.ndarray, " m"], Array("m")]
    area_mm2: Annotated[Float[np.ndarray, "m m"], Array("m", "m", gaps=True, least=0.0)]

    @property
    def stem(self) -> str:
        """Name of its JSON file under the lens's own conditions: each face has one."""
        return f"{self.of_face}_{self.surface}"

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Plot the form deviation, or the correction, over the chart of the surface."""
        field, title = self.plotted
        return plot_face(getattr(self, field).T, float(self.chart[-1]), f"{self.surface}: {title} (µm)", axes)


@public
class SurfaceComparison(MeasuredFace):
    """A measured surface against the design's, and the light of the lens with it.

    ``point_deviation_um``: of the single points. ``form_deviation_um``: of the form; ``rms`` is over the area.
    ``residual_rms_um``: of the points about the form. ``receiver``: name of the first receiver. ``far_field``: it is a
    far field. ``width``, ``height``: of it, in the unit of its chart. ``measured``: light with the measured surface.
    ``nmse_between``: of the two lights. ``points``: as registered, in mm. ``distance_um``: of each point along the
    normal. ``deviation_um``: map of the form deviation. ``irradiance_design``, ``irradiance_measured``: light on the
    first receiver (W/m^2; far field W/sr), [row y, column x].
    """

    stage: ClassVar[str] = "compare_surface"
    of_face: ClassVar[str] = "compare"
    on_page: ClassVar[OnPage] = OnPage("{} surface", further=("form",), in_row=("form", "nmse"))
    command: ClassVar[str] = "compare --points"
    plotted: ClassVar[tuple[str, str]] = ("deviation_um", "form deviation")

    point_deviation_um: DeviationExtent
    form_deviation_um: DeviationExtent
    residual_rms_um: NotNegative
    receiver: Text
    far_field: Flag
    width: Positive
    height: Positive
    measured: Annotated[LightMetrics, Apart()]
    nmse_between: NotNegative
    points: Annotated[Float[np.ndarray, "n 3"], Array("n", 3)]
    distance_um: Annotated[Float[np.ndarray, " n"], Array("n")]
    deviation_um: FaceMap
    irradiance_design: Irradiance
    irradiance_measured: Irradiance

    @property
    def light_chart(self) -> Chart:
        """Size of the maps of light, for figures."""
        return Chart(self.width, self.height, self.far_field)


# A hollow tighter than the ball by this share, as wide as 2 mm, stays 0.1 um uncut by a ball of 1 mm.
KEPT = 1e-3
_STEP_FILE = "lens_corrected.step"  # of a face called outer: lens_corrected_outer.step


_LONGER_WAVES = "take a longer wavelength_mm"


def _designed_radius(made: Any) -> str:
    before = made.cutter.concave_radius_before_mm
    designed = "none" if before is None else quantity(before, "mm", digits=4)
    return f"designed {designed}, cutter {quantity(made.cutter.cutter_radius_mm, 'mm', digits=3)}"


def _least_radius_mm(made: Any) -> float | None:
    """Radius of the ball, or the designed one if that is already tighter; None for a convex face."""
    cutter = made.cutter
    if cutter.concave_radius_mm is None:
        return None
    before = inf if cutter.concave_radius_before_mm is None else cutter.concave_radius_before_mm
    return float(min(cutter.cutter_radius_mm, before) * (1.0 - 2.0 * KEPT))


class CutterLimit(Record):
    """The ball cutter's limit on a correction; radii are the smallest concave ones, None if there is none.

    ``smoothed_more_share``: of the area, where the wavelength was made longer for the cutter; ``cut_back_um``: how much
    of the correction that took away, along the normal.
    """

    cutter_radius_mm: Positive
    concave_radius_before_mm: Positive | None
    concave_radius_mm: Annotated[
        Positive | None,
        Figure("Min. concave radius", _designed_radius, key="concave", missing="none"),
        Criterion(
            ">=", _least_radius_mm, "min. concave radius of the corrected face", _LONGER_WAVES, name="concave_radius"
        ),
    ]
    smoothed_more_share: Share
    cut_back_um: Extent


class InferredForm(Record):
    """Errors of a face by pictures of its light, in the place of measured points.

    ``pictures``: number of these. ``chi_square``: of their residual. ``left``: names of errors that the pictures do not
    tell, and that are not corrected.
    """

    pictures: Count
    chi_square: Residual
    left: Annotated[
        tuple[Text, ...],
        Figure(
            "Not corrected",
            "the pictures do not tell them; further ones may",
            key="not_corrected",
            value=lambda made: ", ".join(made.inferred.left),
            when=lambda made: bool(made.inferred.left),
        ),
    ]


def _why_filtered(made: Any) -> str:
    by_itself = "from the noise of the points" if made.inferred is None else "for errors of low order"
    return f"longer waves pass; {'given' if made.wavelength_given else by_itself}"


@public
class Correction(MeasuredFace):
    """A face corrected by the mirrored deviation of a first cut, in a STEP file for the second one.

    STEP and lengths are in the lens's own size; extents are over the area of the face.

    ``process``: by which the part is made. ``scale``: of the face that is cut against the lens's, 1 + shrinkage for a
    mould insert. ``point_spacing_mm``: twice the distance to the nearest point, at most, on three quarters of the face.
    ``gain``: share of the deviation that is corrected. ``wavelength_mm``: shortest wave that is corrected.
    ``wavelength_given``: it was given, not found. ``noise_rms_um``: of the points. ``residual_rms_um``: what the filter
    leaves of the points, their noise and shorter waves. ``deviation_um``: of the first cut as far as its points show
    it, along the normal. ``correction_um``: that was put into the STEP. ``expected_um``: of the second cut, where the
    machine errs again as in the first. ``cutter``: concave radii of the face that is cut, before and after. ``nodes``:
    spline nodes of each face. ``step_schema``: of the STEP. ``step_volume_change``: of the solid as read back,
    relative. ``form_error_nm``, ``normal_error_mrad``: errors of the face as read back. ``first_cut``, ``second_cut``:
    light of both. ``file``: size and hash of the STEP. ``deviation_map_um``, ``correction_map_um``,
    ``expected_map_um``: maps of the extents above. ``step``: content of the STEP file. ``inferred``: what the deviation
    rests on where it is by pictures; places of an even pattern then stand for points, and ``noise_rms_um`` is the
    standard error of the face.
    """

    omit_if_empty: ClassVar[tuple[str, ...]] = ("by_led", "series", "inferred")
    stage: ClassVar[str] = "correct"
    of_face: ClassVar[str] = "correct"
    on_page: ClassVar[OnPage] = OnPage("correction of the {} surface", in_row=("first_cut", "second_cut", "nmse"))
    command: ClassVar[str] = "correct --points"
    plotted: ClassVar[tuple[str, str]] = ("correction_map_um", "correction")

    process: Process
    scale: Positive
    inferred: InferredForm | None = None
    point_spacing_mm: Positive
    gain: Positive
    deviation_um: Annotated[
        Extent,
        Figure("Deviation, first cut", "rms, {deviation_um.max:3} at most", key="first_cut", of="rms", digits=3),
    ]
    correction_um: Annotated[
        Extent,
        Figure("Correction", "rms, {correction_um.max:3} at most; gain {gain:3}", of="rms", digits=3),
    ]
    expected_um: Annotated[
        Extent,
        Figure("Expected, second cut", "rms, {expected_um.max:3} at most", key="second_cut", of="rms", digits=3),
    ]
    wavelength_mm: Annotated[
        Positive,
        Figure(
            "Filter",
            _why_filtered,
            key="filter",
            digits=3,
        ),
    ]
    wavelength_given: Flag
    noise_rms_um: Annotated[
        NotNegative,
        Figure(
            "Standard error of the face",
            lambda made: f"rms, by {made.inferred.pictures} pictures",
            key="inferred_error",
            digits=2,
            when=lambda made: made.inferred is not None,
        ),
    ]
    residual_rms_um: Annotated[
        NotNegative,
        Figure(
            "Left out by the filter",
            "rms; noise of the points {noise_rms_um:2}",
            key="left_out",
            digits=2,
            when=lambda made: made.inferred is None,
        ),
    ]
    cutter: CutterLimit
    nodes: SplineNodes
    step_schema: Literal["AP214", "AP242"]
    step_volume_change: Annotated[NotNegative, round_trip_limit("the STEP file", _LONGER_WAVES)]
    form_error_nm: Annotated[Extent, step_face_limit("form error", FINEST_NM, _LONGER_WAVES)]
    normal_error_mrad: Annotated[Extent, step_face_limit("normal error", FINEST_MRAD, _LONGER_WAVES)]
    first_cut: Annotated[LightMetrics, Apart()]
    second_cut: Annotated[LightMetrics, Apart()]
    file: FileStamp
    deviation_map_um: FaceMap
    correction_map_um: FaceMap
    expected_map_um: FaceMap
    step: Annotated[bytes, InFile(_STEP_FILE), Field(strict=True, repr=False)]

    @property
    @figure(
        Figure(
            "Cut back for the ball",
            lambda made: (
                f"rms, {quantity(made.cutter.cut_back_um.max, 'µm', digits=3)} at most; "
                f"on {percent(made.cutter.smoothed_more_share)} of the face"
            ),
            key="cut_back",
            digits=3,
        )
    )
    def cut_back_rms_um(self) -> float | None:
        """Part of the correction lost to the cutter; None if there is none."""
        return self.cutter.cut_back_um.rms if self.cutter.smoothed_more_share > 0.0 else None

    def products(self) -> dict[str, bytes]:
        """STEP by suffix."""
        return {".step": self.step, ".stp": self.step}
