"""Result of the photometry: files and the flux they hold, and the figures by which lighting is bought.

Those are candela on the axis, beam and field angles, each with its standard error, read from the table that the files
hold. The level at which angles are read, a half or a tenth of the largest intensity of the plane, has the noise of the
rays taken off: the largest of many noisy numbers is too large. A standard error is of the rays, by their independent
samples, and has in it the error of the level; what the steps of the table may change is the interpolation error.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float

from lensforge.light.angular_grid import FittedIntensity
from lensforge.light.area_lamp import AreaLamp
from lensforge.light.luminaire_figures import LuminaireFigures
from lensforge.light.plane_figures import PlaneFigures
from lensforge.light.spectral_figures import SpectralFigures
from lensforge.public import public
from lensforge.results import (
    Array,
    Count,
    Extent,
    Fact,
    Flag,
    InFile,
    Metric,
    NotNegative,
    Number,
    Positive,
    Record,
    ResultByLed,
    Text,
)
from lensforge.results.criteria import Criteria, at_most
from lensforge.results.estimates import (
    REPLICATES,
    ExtremeEstimate,
    half_sample_error,
    halves_of,
    in_doubt,
    maximum_estimate,
    scaled,
)
from lensforge.results.figure import Apart, Figure
from lensforge.results.files import MIB
from lensforge.results.level_width import width_above
from lensforge.results.numerals import percent, quantity
from lensforge.results.plots import plot_curves
from lensforge.scene.application_light import ApplicationJudgement, with_judgements
from lensforge.sources.intensity import BEAM_SHARE, FIELD_SHARE, plane_profile
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.photometric_file import turned_over
from lensforge.spec import Spec
from lensforge.spec.application import Application

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PLANES_DEG = (0.0, 90.0)  # C 0 - C 180 and C 90 - C 270


class Direction(Record):
    """A direction of the table: half-plane C and angle gamma from the axis (deg)."""

    c_deg: Number
    gamma_deg: Number


@dataclass(frozen=True)
class CandelaTables:
    """Intensities (cd) in the frame of the files: of all rays, and by each half of 16 independent samples.

    ``by_halves``: each half is followed by the other one; empty unless there are 16 samples and light in each half.
    ``samples``: of each sample alone, with values below 0 where they have noise. ``rival``: the same in other steps,
    which other rays might have chosen; ``doubt``: as of :func:`~lensforge.results.estimates.in_doubt`.
    """

    whole: CandelaTable
    by_halves: Sequence[CandelaTable]
    samples: Float[np.ndarray, "p c g"]
    rival: "CandelaTables | None" = None
    doubt: float = 0.0

    @staticmethod
    def of(light: FittedIntensity, per_watt: float) -> "CandelaTables":
        """Tables of ``light``; ``per_watt``: lumens of a watt of the source."""
        values = light.samples * per_watt
        halves = halves_of(values) if len(values) == REPLICATES else values[:0]
        lit = (halves.sum(axis=(1, 2)) > 0.0).all()
        by_halves = [turned_over(light.grid.table(half)) for half in halves] if lit else []
        closed = np.concatenate([values, values[:, :1]], axis=1)[:, ::-1]
        tables = CandelaTables(turned_over(light.grid.table(values.mean(axis=0))), by_halves, closed)
        if light.rival is None:
            return tables
        return replace(tables, rival=CandelaTables.of(light.rival.light, per_watt), doubt=light.rival.doubt)

    def figures(self, read: Callable[[CandelaTable], tuple[float, ...]], unit: str = "") -> tuple[Metric, ...]:
        """Figures that ``read`` takes from a table at once, with standard errors if there are halves."""
        values = read(self.whole)
        if not self.by_halves:
            return tuple(Metric(value=value, unit=unit) for value in values)
        errors = map(half_sample_error, np.array([read(table) for table in self.by_halves]).T)
        return tuple(
            Metric(value=value, unit=unit, standard_error=error) for value, error in zip(values, errors, strict=True)
        )

    def figures_in_doubt(self, read: Callable[[CandelaTable], tuple[float, ...]], unit: str = "") -> tuple[Metric, ...]:
        """Figures of a table, with the doubt that other rays would choose other steps."""
        figures = self.figures(read, unit)
        if self.rival is None:
            return figures
        pairs = zip(figures, self.rival.figures(read, unit), strict=True)
        return tuple(in_doubt(figure, other, self.doubt) for figure, other in pairs)

    @cached_property
    def peak_direction(self) -> Direction:
        """Node with the largest intensity; on the axis, where all half-planes meet, the one at C = 0."""
        plane, angle = np.unravel_index(int(np.argmax(self.whole.values)), self.whole.values.shape)
        c_deg = float(self.whole.c_deg[plane]) % 360.0 if angle > 0 else 0.0
        return Direction(c_deg=c_deg, gamma_deg=float(self.whole.gamma_deg[angle]))

    @property
    def axis_cd(self) -> Metric:
        """Intensity on the axis."""
        (axis,) = self.figures_in_doubt(lambda table: (float(table.values[0, 0]),), "cd")
        return axis

    def plane(self, c_deg: float) -> PlaneFigures:
        """Beam in the plane of C = ``c_deg`` and its opposite."""
        profiles = np.stack([plane_profile(self._with(sample), c_deg)[1] for sample in self.samples])
        peak = maximum_estimate(profiles)
        figures = PlaneFigures(
            c_deg=c_deg,
            peak_cd=peak.metric().changed(unit="cd"),
            beam_angle_deg=self._angle(c_deg, peak, BEAM_SHARE),
            field_angle_deg=self._angle(c_deg, peak, FIELD_SHARE),
        )
        return figures if self.rival is None else figures.in_doubt(self.rival.plane(c_deg), self.doubt)

    def _with(self, values: Float[np.ndarray, "c g"]) -> CandelaTable:
        return CandelaTable(self.whole.c_deg, self.whole.gamma_deg, values)

    def _angle(self, c_deg: float, peak: ExtremeEstimate, share: float) -> Metric | None:
        """Width of the beam at ``share`` of ``peak``; its error is by half-samples, each with a peak of its own."""

        def width(table: CandelaTable, largest: float) -> float:
            return width_above(*plane_profile(table, c_deg), share * largest) or 0.0

        angle = Metric(value=width(self.whole, peak.value), unit="°")
        if not angle.value > 0.0:
            return None
        if peak.by_halves is None or not self.by_halves:
            return angle
        by_halves = [width(*half) for half in zip(self.by_halves, peak.by_halves, strict=True)]
        return angle.changed(standard_error=half_sample_error(np.array(by_halves)))


IES_FILE = "lens.ies"
LDT_FILE = "lens.ldt"
TM33_FILE = "lens.iesxml"
TM25_FILE = "lens.tm25ray"
LUMINAIRE_FILES = {"ies": "luminaire.ies", "ldt": "luminaire.ldt", "tm33": "luminaire.iesxml"}
_CONSERVED = 1e-5  # relative error of a file's integral: seven digits of each number are written


class WrittenFile(Record):
    """One file as read back: its flux, in lumens, in watts or in both, and the relative error from the rays' flux."""

    lumens: NotNegative | None = None
    watts: NotNegative | None = None
    rays: Count | None = None
    relative_error: NotNegative


class WrittenFarFields(Record):
    """The files of candela as read back."""

    ies: WrittenFile
    ldt: WrittenFile
    tm33: WrittenFile


class WrittenFiles(WrittenFarFields):
    """The four files as read back."""

    tm25ray: WrittenFile


class LostFlux(Record):
    """Flux (W) that does not leave the lens upwards, by fate."""

    backward: NotNegative
    outside_cavity: NotNegative
    base: NotNegative
    total_reflection: NotNegative
    not_converged: NotNegative
    surfaces_intersect: NotNegative
    missed_receiver: NotNegative
    event_limit: NotNegative = 0.0
    flange: NotNegative = 0.0
    absorbed: NotNegative = 0.0
    cover_glass: NotNegative = 0.0
    bodies: NotNegative = 0.0
    housing: NotNegative = 0.0
    second_wall: NotNegative = 0.0


def one_of_lenses(spec: Spec) -> str:
    """Phrase for the single lens that has the light, if a lamp has several; else empty."""
    return f"one lens of {spec.photometry.lenses}" if spec.photometry.lenses > 1 else ""


def light_of(spec: Spec) -> str:
    """Phrase for the lens or the lamps whose light the files hold; empty for a single LED."""
    return one_of_lenses(spec) or spec.all_lamps.whole.replace("of all lamps", "one lamp")


def _flux_note(photometry: "Photometry", spec: Spec) -> str:
    source = f"for {quantity(photometry.source_lm, 'lm', digits=5)} of the source"
    unknown = ", whose flux is not stated" if photometry.per_1000_lm else ""
    alone = "" if spec.plate is None else "; as if none entered other lenses of the plate (verify --stray)"
    return f"{_start(spec)}{source}{unknown}{alone}"


def _peak_note(photometry: "Photometry", spec: Spec) -> str:
    direction = photometry.peak_direction
    c_text = quantity(direction.c_deg, "°", digits=4)
    return f"{_start(spec)}at C {c_text}, gamma {quantity(direction.gamma_deg, '°', digits=3)}"


def _start(spec: Spec) -> str:
    whose = light_of(spec)
    return f"{whose}; " if whose else ""


def _noise_note(photometry: "Photometry", spec: Spec) -> str:
    return "" if photometry.node_error is None else f"the table’s noise is {percent(photometry.node_error.rms)} rms"


def _beam_angle(beam: str) -> Figure:
    """The figure of the beam angle in the plane of the field ``beam``."""
    return Figure(
        f"Beam angle, {{{beam}.plane}}",
        lambda photometry, spec: getattr(photometry, beam).beam_note(spec),
        key=f"beam_{{{beam}.plane}}",
        of="beam_angle_deg",
        missing="",
        notice=lambda photometry, spec: getattr(photometry, beam).beam_notice(spec),
        when=lambda photometry, spec: not getattr(photometry, beam).is_judged(spec),
    )


def _field_angle(beam: str) -> Figure:
    label = f"Field angle, {{{beam}.plane}}"
    return Figure(label, "full width at 10 %", key=f"field_{{{beam}.plane}}", of="field_angle_deg", missing="")


_FILE_NAMES = {"ies": IES_FILE, "ldt": LDT_FILE, "tm33": TM33_FILE, "tm25ray": TM25_FILE}


@public
@with_judgements
class Photometry(ResultByLed):
    """Light that leaves the lens upwards, in watts, lumens and candela; of several lamps that of the whole.

    The table of ``candela`` is bilinear in its angles, and fitted to the flux of the rays.

    ``source_w``: flux of the source. ``exit_w``: flux that leaves upwards. ``light_output_ratio``: the latter over the
    former. ``lost_w``: the rest by fate. ``reflected_w``: lost at the surfaces. ``source_lm``: flux of the source; 1000
    where nothing states it. ``source_lm_from``: what states it. ``per_1000_lm``: nothing states it, so lumens and
    candela are per 1000 lm of the source. ``exit_lm``: flux that leaves upwards. ``axis_cd``: intensity on the axis.
    ``peak_cd``: largest intensity, the noise taken off by which the largest of many numbers is too large.
    ``peak_direction``: node of the table with the largest. ``beam_c0``: beam in the plane C 0 - C 180. ``beam_c90``:
    beam in the plane C 90 - C 270. ``figures``: throw, flux code and direct ratios. ``spectrum``: figures of the
    source's spectrum; None if it is not known. ``road``: classes of a lamp for an area or a road, by the spec. A table
    of applications in the spec has a field of its name, such as ``roads``: each of its entries, judged. ``node_error``:
    standard error over intensity, where that is above a tenth of the peak: the largest, and the root mean square over
    solid angle. ``interpolation_error``: rms, relative to the peak, of what a table of half the steps would add.
    ``files``: each file as read back. ``luminaire``: the same of those of all lenses of a lamp, where the spec says
    that it has several. ``luminaire_ies``, ``luminaire_ldt``, ``luminaire_tm33``: content of these. ``c_deg``: angle C
    of the table's rows, 0 at +x and 90 at -y. ``gamma_deg``: angle from the lens axis of its columns. ``candela``:
    intensities in cd. ``candela_standard_error``: of each of them by independent samples of rays, 0 for a single one.
    ``ies``, ``ldt``, ``tm33``, ``tm25``: content of the files.
    """

    omit_if_empty: ClassVar[tuple[str, ...]] = ("led", "others", "luminaire")

    stage: ClassVar[str] = "photometry"

    others: "tuple[Photometry, ...]" = ()
    source_w: Positive
    exit_w: Metric
    light_output_ratio: Metric
    lost_w: LostFlux
    reflected_w: NotNegative
    source_lm: Positive
    source_lm_from: Literal["given", "spec or source file", "not known"]
    per_1000_lm: Flag
    exit_lm: Annotated[
        Metric,
        Figure("Luminous flux", _flux_note, key="exit_lm"),
        Figure(
            "Flux per metre",
            "of the linear lens",
            key="exit_lm_per_m",
            value=lambda photometry, spec: scaled(photometry.exit_lm, 1e3 / spec.lens.drawn_mm, "lm/m"),
            when=lambda photometry, spec: spec.lens.drawn_mm is not None,
        ),
    ]
    peak_cd: Annotated[Metric, Figure("Peak intensity", _peak_note, key="peak_cd")]
    axis_cd: Annotated[Metric, Figure("Intensity on the axis", key="axis_cd")]
    peak_direction: Direction
    beam_c0: Annotated[PlaneFigures, _beam_angle("beam_c0"), _field_angle("beam_c0")]
    beam_c90: Annotated[PlaneFigures, _beam_angle("beam_c90"), _field_angle("beam_c90")]
    figures: LuminaireFigures
    spectrum: Annotated[SpectralFigures | None, Apart()]
    road: Annotated[AreaLamp | None, Apart()]
    rays: Annotated[Count, Figure("Rays", _noise_note, key="photometry_rays")]
    node_error: Extent | None
    interpolation_error: NotNegative | None
    warnings: tuple[Text, ...] = ()
    files: WrittenFiles
    luminaire: WrittenFarFields | None = None
    seconds: NotNegative
    criteria: Criteria = ()
    c_deg: Annotated[Float[np.ndarray, " c"], Array("c")]
    gamma_deg: Annotated[Float[np.ndarray, " g"], Array("g")]
    candela: Annotated[Float[np.ndarray, "c g"], Array("c", "g")]
    candela_standard_error: Annotated[Float[np.ndarray, "c g"], Array("c", "g")]
    ies: Annotated[bytes, InFile(IES_FILE)]
    ldt: Annotated[bytes, InFile(LDT_FILE)]
    tm33: Annotated[bytes, InFile(TM33_FILE)]
    tm25: Annotated[bytes, InFile(TM25_FILE, 1024 * MIB)]  # 38 million rays
    luminaire_ies: Annotated[bytes | None, InFile(LUMINAIRE_FILES["ies"])] = None
    luminaire_ldt: Annotated[bytes | None, InFile(LUMINAIRE_FILES["ldt"])] = None
    luminaire_tm33: Annotated[bytes | None, InFile(LUMINAIRE_FILES["tm33"])] = None

    def judge(self) -> Iterator[Fact]:
        """Make one criterion for each file: it holds the flux of the rays."""
        written = {name: getattr(self.files, field) for field, name in _FILE_NAMES.items()}
        whole_lamp = {} if self.luminaire is None else LUMINAIRE_FILES
        written |= {name: getattr(self.luminaire, field) for field, name in whole_lamp.items()}
        for name, file in written.items():
            error = file.relative_error
            remedy = "please report the lens.json"
            yield at_most(f"flux of {name} as read back", error, _CONSERVED, "relative", remedy)

    def judgements_of(self, applications: Iterable[Application]) -> Iterator[ApplicationJudgement]:
        """The judgement of each of the spec's applications."""
        for _, table in groupby(applications, key=lambda entry: entry.table):
            for number, entry in enumerate(table):
                yield getattr(self, entry.table)[number]

    def products(self) -> dict[str, bytes]:
        """Bytes of the IES, EULUMDAT, TM-33 and TM-25 files, by suffix."""
        return {".ies": self.ies, ".ldt": self.ldt, ".iesxml": self.tm33, ".tm25ray": self.tm25}

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Plot candela over the angle from the axis, in the planes C = 0 and C = 90 degrees."""
        planes = {f"C = {wanted:g}°": int(np.argmin(np.abs(self.c_deg - wanted))) for wanted in (0.0, 90.0)}
        curves = {name: (self.gamma_deg, self.candela[row]) for name, row in planes.items()}
        return plot_curves(curves, ("gamma (degrees)", "intensity (cd)"), axes)
