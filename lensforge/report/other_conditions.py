"""Section on results under other conditions than the lens's own, such as another source, beside its own light."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import SurfaceComparison
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.report import irradiance_figures
from lensforge.report.headline import SHOWN, Shown
from lensforge.report.light_pictures import pixels_of
from lensforge.report.numerals import number, number_with_error, percent
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.shown_receivers import ShownReceiver, receivers_in, top_of
from lensforge.results import SimulatedResult, State
from lensforge.runs.results import Results
from lensforge.runs.verdict import verdict_on

OWN = "the lens’s own"


@dataclass(frozen=True)
class LightRow:
    """The light under one set of conditions: its figures, the state that a verdict on it alone would have, and notes.

    ``notes``: another temperature, reasons of that state, and warnings on the conditions.
    """

    name: str
    source: str
    rays: str
    pixels: str
    nmse: str
    efficiency: str
    uniformity: str
    in_target: str
    state: State
    shown: Shown
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ResultRow:
    """Another result: the file that holds it, its conditions, its main figures, and the criteria that it misses."""

    file: str
    conditions: str
    figures: str
    missed: tuple[str, ...]


def light_rows(results: Results) -> list[LightRow]:
    """The lens's own light, and each light under other conditions, by receiver; none where there is no other."""
    return [row for name, light in _compared(results).items() for row in _light_rows(results, name, light)]


def _compared(results: Results) -> dict[str, Light]:
    """The lens's own light before every other; none where there is no other."""
    others, own = _lights(results), results.find(Light)
    return others if own is None or not others else {OWN: own, **others}


def _lights(results: Results) -> dict[str, Light]:
    """Light under other conditions, by their name."""
    return {_name(light): light for light in results.others.values() if isinstance(light, Light)}


def _name(result: SimulatedResult) -> str:
    return OWN if result.conditions is None else result.conditions.name


def _light_rows(results: Results, name: str, light: Light) -> Iterator[LightRow]:
    """A row for each receiver; the notes on the light stand in the first."""
    judged = verdict_on(results.lens, None, light, None, None, None)
    conditions, source = light.conditions, results.spec.source.title
    notes: tuple[str, ...] = ()
    if conditions is not None:  # the reasons against the own light stand at the top of the page
        warm = () if conditions.temperature_c is None else (f"lens at {conditions.temperature_c:g} °C",)
        notes = (*warm, *judged.reasons.light, *(f"warning: {words}" for words in conditions.warnings))
        source = conditions.source or source
    for shown in receivers_in(light, results.spec):
        yield LightRow(
            name=_on(name, shown),
            source=source,
            rays=number(light.rays),
            pixels=pixels_of(shown.light),
            nmse=number_with_error(shown.light.nmse, 3),
            efficiency=percent(shown.light.efficiency.value),
            uniformity=number_with_error(shown.light.uniformity, 3),
            in_target=percent(shown.light.share_in_target.value),
            state=judged.light,
            shown=SHOWN[judged.light],
            notes=() if shown.index else notes,
        )


def _on(name: str, shown: ShownReceiver) -> str:
    """Name of the light on one receiver."""
    return f"{name}, {shown.light.name}" if shown.several else name


def light_pictures(results: Results) -> list[PagePicture]:
    """The lens's own light and every other, those in one unit on a receiver of one name on one scale."""
    lights = _compared(results)
    entries = [
        (index, name, light, shown)
        for index, (name, light) in enumerate(lights.items())
        for shown in receivers_in(light, results.spec)
    ]
    return [
        picture(
            shown.picture_name(f"other-{index}"),
            _map(shown, [each for _, _, _, each in entries]),
            _on(name, shown),
            "" if light.conditions is None else str(light.conditions),
        )
        for index, name, light, shown in entries
    ]


def _map(shown: ShownReceiver, others: Sequence[ShownReceiver]) -> Figure:
    alike = [each for each in others if each.light.name == shown.light.name]
    one_unit = len({each.unit for each in alike}) == 1
    top = top_of(each.light.map for each in (alike if one_unit else [shown]))
    return irradiance_figures.irradiance_map(shown.light.map, shown.light.chart, top, unit=shown.unit)


def result_rows(results: Results) -> list[ResultRow]:
    """A row for each result under other conditions that is no light."""
    found = []
    for stem, result in results.others.items():
        if not isinstance(result, Light):
            missed = [str(each) for each in getattr(result, "criteria", ()) if not each.passed]
            found.append(ResultRow(f"{stem}.json", str(result.conditions), "; ".join(_figures(result)), tuple(missed)))
    return found


def _figures(result: SimulatedResult) -> Iterator[str]:
    """The main figures of a result, as words."""
    match result:
        case Proof():
            yield f"landing off the design’s by {number(result.deviation_mm.rms, 2)} mm rms"
            yield f"NMSE against the design {number(result.nmse_vs_design, 2)}"
            yield f"efficiency {percent(result.efficiency, 2)}"
        case StrayLight():
            yield f"stray light in the window {percent(result.flux.detected_stray, 2)}, base {result.base}"
            yield f"efficiency {percent(result.efficiency, 2)}"
        case Sensitivity():
            yield f"NMSE as designed {number_with_error(result.nominal.nmse, 3)}"
            yield f"efficiency {percent(result.nominal.efficiency.value, 2)}"
        case Yield():
            low, high = percent(result.pass_rate.low, 1), percent(result.pass_rate.high, 1)
            yield f"{percent(result.pass_rate.value, 1)} of {result.parts} parts pass ({low} to {high})"
        case Photometry():
            yield f"{number(result.exit_lm.value, 4)} lm of {number(result.source_lm, 4)} lm"
            yield f"peak {number(float(result.candela.max()), 4)} cd"
        case SurfaceComparison():
            yield f"form PV {number(result.form_deviation_um.pv, 3)} µm"
            yield f"NMSE with the {result.surface} surface {number_with_error(result.measured.nmse, 3)}"
        case Correction():
            yield f"deviation {number(result.deviation_um.rms, 3)} µm rms"
            yield f"{number(result.expected_um.rms, 2)} µm expected of the second cut"
            yield f"NMSE expected of the second cut {number_with_error(result.second_cut.nmse, 3)}"
