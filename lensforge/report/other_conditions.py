"""Section on results under other conditions than the lens's own, such as another source, beside its own light."""

from collections.abc import Iterator
from dataclasses import dataclass

from matplotlib.figure import Figure

from lensforge.evaluation.light import Light
from lensforge.far_field.photometry import Photometry
from lensforge.figures.light_unit import LightUnit, light_unit
from lensforge.measurement.comparison import SurfaceComparison
from lensforge.records import SimulatedResult, State
from lensforge.report import irradiance_figures
from lensforge.report.headline import SHOWN, Shown
from lensforge.report.numerals import number, number_with_error, percent
from lensforge.report.pictures import PagePicture, picture
from lensforge.results import Results
from lensforge.tolerancing.sensitivity_table import Sensitivity
from lensforge.verdict import verdict_on
from lensforge.verification.proof import Proof, StrayLight

OWN = "the lens’s own"


@dataclass(frozen=True)
class LightRow:
    """The light under one set of conditions: its figures, the state that a verdict on it alone would have, and notes.

    ``notes``: reasons of that state, and warnings on the source.
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
    """The lens's own light, and a row for each light under other conditions; none where there is no other."""
    others = _lights(results)
    own = results.find(Light)
    rows = [] if own is None or not others else [_light_row(results, OWN, own)]
    return [*rows, *(_light_row(results, name, light) for name, light in others.items())]


def _lights(results: Results) -> dict[str, Light]:
    """Light under other conditions, by their name."""
    return {_name(light): light for light in results.others.values() if isinstance(light, Light)}


def _name(result: SimulatedResult) -> str:
    return OWN if result.conditions is None else result.conditions.name


def _light_row(results: Results, name: str, light: Light) -> LightRow:
    judged = verdict_on(results.lens, None, light, None, None, None)
    conditions, source = light.conditions, results.spec.source.title
    notes: tuple[str, ...] = ()
    if conditions is not None:  # the reasons against the own light stand at the top of the page
        notes = (*judged.reasons.light, *(f"warning: {words}" for words in conditions.warnings))
        source = conditions.source or source
    return LightRow(
        name=name,
        source=source,
        rays=number(light.rays),
        pixels=f"{light.pixels} × {light.pixels}",
        nmse=number_with_error(light.nmse, 3),
        efficiency=percent(light.efficiency.value),
        uniformity=number_with_error(light.uniformity, 3),
        in_target=percent(light.share_in_target.value),
        state=judged.light,
        shown=SHOWN[judged.light],
        notes=notes,
    )


def light_pictures(results: Results) -> list[PagePicture]:
    """The lens's own light and every other, on one scale where they have one unit."""
    others, own = _lights(results), results.find(Light)
    lights = others if own is None or not others else {OWN: own, **others}
    units = {name: light_unit(light.lumens_per_watt) for name, light in lights.items()}
    same = len(set(units.values())) == 1
    top = max((float(light.map.max()) for light in lights.values()), default=0.0)
    return [
        picture(
            f"other-{index}",
            _map(light, top if same else float(light.map.max()), units[name]),
            name,
            "" if light.conditions is None else str(light.conditions),
        )
        for index, (name, light) in enumerate(lights.items())
    ]


def _map(light: Light, top: float, unit: LightUnit) -> Figure:
    return irradiance_figures.irradiance_map(light.map, light.receiver_mm, top or 1.0, unit=unit)


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
        case Photometry():
            yield f"{number(result.exit_lm, 4)} lm of {number(result.source_lm, 4)} lm"
            yield f"peak {number(float(result.candela.max()), 4)} cd"
        case SurfaceComparison():
            yield f"form PV {number(result.form_deviation_um.pv, 3)} µm"
            yield f"NMSE with the {result.surface} surface {number_with_error(result.measured.nmse, 3)}"
