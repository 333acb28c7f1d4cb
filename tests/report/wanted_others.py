"""Numbers of results under other conditions that the report must show, by their label."""

from functools import singledispatch

from shown_numbers import shown, with_error

from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import SurfaceComparison
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight

_SECTION = "Under other conditions"


def other_numbers(results):
    """Entries of the own light beside the others, and of every other result."""
    lights = [each for each in results.others.values() if isinstance(each, Light)]
    fold = f"{_SECTION} / The light under {len(lights)} other condition{'s' if len(lights) > 1 else ''}"
    if lights:
        yield shown(f"{fold} / summary", "The light under {} other condition", len(lights))
        source = "{} mm square Lambertian source"
        yield shown(f"{fold} / the lens’s own / Source", source, results.spec.source.side_mm)
        yield from _light(f"{fold} / the lens’s own", results.light)
    for light in lights:
        row, conditions = f"{fold} / {light.conditions.name}", light.conditions
        yield from _light(row, light)
        yield shown(f"{row} / note", "lens at {} °C", conditions.temperature_c)
        yield shown(f"{row} / title", conditions.name)
        yield shown(f"{row} / figcaption", "{} rays, {} °C", conditions.rays, conditions.temperature_c)
    for stem, result in results.others.items():
        if not isinstance(result, Light):
            row = f"{_SECTION} / Other results / {stem}.json"
            yield shown(f"{row} / Conditions", "{} rays", result.conditions.rays)
            for words, *values in figures(result):
                yield shown(f"{row} / Figures", words, *values)


def _light(row, light):
    first = light.first
    rows, columns = first.map.shape
    yield shown(f"{row} / Rays", "{}", light.rays)
    yield shown(f"{row} / Pixels", "{} × {}", columns, rows)
    yield with_error(f"{row} / NMSE", first.nmse)
    yield shown(f"{row} / Efficiency", "{}\u2009%", 100.0 * first.efficiency.value)
    yield shown(f"{row} / In the target", "{}\u2009%", 100.0 * first.share_in_target.value)


@singledispatch
def figures(result):
    """The main figures of a result: words, and their values."""
    raise TypeError(type(result))


@figures.register
def _(result: Proof):
    yield "landing off the design’s by {} mm rms", result.first.deviation_mm.rms
    yield "NMSE against the design {}", result.first.nmse_vs_design
    yield "efficiency {}\u2009%", 100.0 * result.first.efficiency


@figures.register
def _(result: StrayLight):
    yield "stray light in the window {}\u2009%, base black", 100.0 * result.first.flux.detected_stray
    yield "efficiency {}\u2009%", 100.0 * result.first.efficiency


@figures.register
def _(result: Sensitivity):
    nominal = result.nominal
    yield "NMSE as designed {} ± {}", nominal.nmse.value, nominal.nmse.standard_error
    yield "efficiency {}\u2009%", 100.0 * nominal.efficiency.value


@figures.register
def _(result: Yield):
    rate = result.pass_rate
    shares = 100.0 * rate.value, result.parts, 100.0 * rate.low, 100.0 * rate.high
    yield "{}\u2009% of {} parts pass ({}\u2009% to {}\u2009%)", *shares


@figures.register
def _(result: Photometry):
    yield "{} lm of {} lm", result.exit_lm.value, result.source_lm
    yield "peak {} cd", float(result.candela.max())


@figures.register
def _(result: SurfaceComparison):
    yield "form PV {} µm", result.form_deviation_um.pv
    yield "NMSE with the outer surface {}", result.measured.nmse.value


@figures.register
def _(result: Correction):
    yield "deviation {} µm rms", result.deviation_um.rms
    yield "{} µm expected of the second cut", result.expected_um.rms
    yield "NMSE expected of the second cut {}", result.second_cut.nmse.value
