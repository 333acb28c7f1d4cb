"""Measurement of accuracy against time: stages of a search, numbers of rays, and the accuracy presets."""

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import torch
from matplotlib.figure import Figure

from lensforge.errors import InputError
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.evaluation_result import Light, LightMetrics
from lensforge.light.lens_light import searched_source
from lensforge.light.simulation import TracedLens
from lensforge.report.folder import RunFolder
from lensforge.report.page import picture, template, write_page
from lensforge.report.tradeoff import Series, TradedError, Tradeoff, TradeoffRow, error_label
from lensforge.results.figure_style import BLUE, GREY, ORANGE, WIDE, in_report_style, new_figure
from lensforge.results.files import require_own
from lensforge.results.folder_lock import locked
from lensforge.results.numerals import number
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Design, Progress
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.search.searches import design
from lensforge.search.searches_in_turn import search_in_turn
from lensforge.search.smallest_lens import within_size_of
from lensforge.sources.measured_rays import held_back
from lensforge.sources.ray_bundle import Source
from lensforge.sources.several_sources import each_of
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.accuracy import PRESETS, Preset, preset_of
from lensforge.spec.spec_files import section_sha256
from lensforge.spec.spec_section import Section
from lensforge.surfaces.imported_face import LENS_FILE

PAGE = "tradeoff.html"
_LEAST_RAYS = 2**12


def run_tradeoff(
    spec: Spec,
    directory: Path,
    *,
    most_rays: int = 2**20,
    accuracy: AnyAccuracy = "standard",
    announce: Callable[[str], None] = lambda _: None,
    warn: Callable[[str], None] = lambda _: None,
) -> Tradeoff:
    """Measure the lens in ``directory`` for the scene ``spec``; without a lens there, a draft is designed first.

    Writes ``tradeoff.json`` and ``tradeoff.html`` there. ``accuracy``: of the search whose stages are followed.
    ``announce`` is called with what is measured next, ``warn`` with each warning on the spec. Raises
    :class:`InputError` if the lens is that of another scene, for a page of another program, and where another process
    writes there.
    """
    require_own(directory / PAGE)
    with locked(directory, create=True):
        source = searched_source(spec)
        if (directory / LENS_FILE).exists():
            lens = _lens_in(directory, spec, source)
        else:
            announce("no lens yet: a draft is designed")
            lens = RunFolder(directory).write(design(spec, accuracy="draft", warn=warn)).lens
        measured = measure(lens, source, most_rays, accuracy, announce)
        measured.write(directory)
        write_page(tradeoff_page(measured), directory / PAGE)
        return measured


def _lens_in(directory: Path, spec: Spec, source: Source) -> Lens:
    """The lens in ``directory``. Raises :class:`InputError` where it was designed for another scene."""
    path = directory / LENS_FILE
    results = RunFolder(directory).run
    require_same_scene(results.lens, spec, source, str(path))
    made = results.find(Design)
    if made is not None and made.inputs["spec"] != section_sha256(results.spec):
        raise InputError(f"{path}: a file that its spec names has changed since; give another folder, or design again")
    return results.lens


def measure(
    lens: Lens, source: Source, most_rays: int, accuracy: AnyAccuracy, announce: Callable[[str], None]
) -> Tradeoff:
    """Measure all series for ``lens`` and its ``source``, all LEDs that it is for.

    ``accuracy``: of the search. ``announce`` is called with the next series' name.
    """
    started = time.perf_counter()
    leds = _judging(lens.spec, source)
    announce("rays of an evaluation")
    traced = TracedLens.of(lens, preset_of(lens.accuracy).evaluate_nodes_per_sigma)
    _light(traced, lens, leds, _LEAST_RAYS)  # compiles the kernels
    rows = []
    for count in ray_counts(most_rays, leds.values()):
        light = _light(traced, lens, leds, count)
        rows.append(_row("rays", f"{count} rays", light, sum(case.result.seconds for case in light.cases())))
    announce("accuracy presets")
    rows += [_preset_row(name, preset, lens, leds, most_rays) for name, preset in PRESETS.items()]
    announce("stages of a search")
    rows += _search_rows(lens.spec, source, most_rays, accuracy)
    return Tradeoff(
        inputs={"lens": lens.sha256},
        name=lens.spec.name,
        accuracy=lens.accuracy,
        threads=torch.get_num_threads(),
        rows=tuple(rows),
        seconds=time.perf_counter() - started,
    )


def _judging(spec: Spec, source: Source) -> dict[str, Source]:
    return dict(zip(spec.by_state, map(held_back, each_of(source)), strict=True))


def _light(traced: TracedLens, lens: Lens, leds: Mapping[str, Source], rays: int) -> Light:
    spec = lens.spec
    return Light.joined({led: evaluate_traced(traced, spec.of_state(led), leds[led], rays, lens.seed) for led in leds})


def ray_counts(most_rays: int, sources: Iterable[Source]) -> tuple[int, ...]:
    """Numbers of rays in factors of four up to ``most_rays``; measured sources have only so many."""
    most = min([most_rays, *(source.ray_count or most_rays for source in sources)])
    return tuple(sorted({min(2**power, most) for power in range(12, 25, 2) if 2**power <= most_rays}))


def _preset_row(name: str, preset: Preset, lens: Lens, leds: Mapping[str, Source], most_rays: int) -> TradeoffRow:
    started = time.perf_counter()  # with the tables
    traced = TracedLens.of(lens, preset.evaluate_nodes_per_sigma)
    light = _light(traced, lens, leds, min(preset.evaluate_rays, most_rays))
    return _row("presets", name, light, time.perf_counter() - started)


def _search_rows(spec: Spec, source: Source, rays: int, accuracy: AnyAccuracy) -> list[TradeoffRow]:
    """The lens by ``rays`` rays after each stage of a search with automatic levels, those left out again among them."""
    stages: list[tuple[Progress, Lens]] = []

    def keep(step: Progress) -> None:
        if step.steps_done == step.steps_total:
            stages.append((step, step.lens()))

    search_in_turn(spec.with_automatic_levels(), source, accuracy=accuracy, progress=keep)
    rows = []
    for step, lens in stages:
        traced = TracedLens.of(lens, preset_of(accuracy).evaluate_nodes_per_sigma)
        light = _light(traced, lens, _judging(spec, source), rays)
        grown = step.functions
        kinds = f", {len(lens.kinds)} kinds" if lens.others else ""
        setting = f"{grown} functions{kinds}"
        rows.append(_row("search", setting, light, step.seconds, functions=grown, steps=step.steps_done))
    return rows


def _row(series: Series, setting: str, light: Light, seconds: float, **grown: int) -> TradeoffRow:
    pattern = light.with_worst("nmse")
    return TradeoffRow(
        series=series,
        setting=setting,
        seconds=seconds,
        rays=light.rays,
        nmse=pattern.nmse,
        efficiency=light.with_worst("efficiency").efficiency,
        noise_nmse=pattern.nmse_of_noise,
        by_led=LightMetrics.of_leds(light),
        **grown,
    )


def require_same_scene(lens: Lens, spec: Spec, source: Source, origin: str) -> None:
    """Raise :class:`InputError` where ``lens`` was designed for another scene than ``spec`` with its ``source``."""
    wanted = settled_symmetry(within_size_of(spec, lens), source)
    if wanted.lens.levels == "auto":
        wanted = wanted.with_levels(lens.spec.lens.basis.levels)
    for section in (name for name in Spec.model_fields if name not in _NOT_OF_THE_SCENE):
        if _hashes(lens.spec, section) != _hashes(wanted, section):
            raise InputError(
                f"{origin}: its lens was designed for another [{section}] than {spec.name!r} has now; "
                "give another folder, or design it again"
            )


# Fields of a spec that change neither its light nor what its lens is searched for: all others count, new ones, too.
_NOT_OF_THE_SCENE = ("name", "optimise", "evaluate", "base", "plate", "manufacture", "drawing", "tolerances")


def _hashes(spec: Spec, section: str) -> list[str]:
    """Hashes of the tables of a section, or the value of a field that is none."""
    content = getattr(spec, section)
    sections = content if isinstance(content, tuple) else () if content is None else (content,)
    return [section_sha256(section) if isinstance(section, Section) else str(section) for section in sections]


_HEIGHT = 3.0
_SERIES: dict[Series, str] = {
    "presets": "Evaluation by preset",
    "rays": "Evaluation by number of rays",
    "search": "Stages of a search",
}
_ERRORS: tuple[tuple[TradedError, str, str], ...] = (("nmse", BLUE, "o"), ("efficiency", ORANGE, "s"))


def tradeoff_page(tradeoff: Tradeoff) -> str:
    """The page: one self-contained HTML file."""
    return template("tradeoff.html").render(
        tradeoff=tradeoff,
        seconds=number(tradeoff.seconds, 3),
        sections=[(title, [row.facts for row in tradeoff.series(name)]) for name, title in _SERIES.items()],
        pictures=[
            picture(f"tradeoff-{name}", tradeoff_figure(tradeoff, name), f"{_SERIES[name]}: error against time")
            for name in ("rays", "search")
        ],
        version=tradeoff.version,
    )


@in_report_style
def tradeoff_figure(tradeoff: Tradeoff, series: Series) -> Figure:
    """Both errors of a series over its seconds, logarithmic; each point of the NMSE is named by its setting."""
    figure, axes = new_figure(WIDE, _HEIGHT)
    for error, colour, marker in _ERRORS:
        rows = [row for row in tradeoff.series(series) if row.seconds > 0.0 and row.error(error) > 0.0]
        x, y = [row.seconds for row in rows], [row.error(error) for row in rows]
        axes.plot(x, y, color=colour, marker=marker, markersize=4.0, label=error_label(series, error))
        if error == "nmse":
            for row, at, value in zip(rows, x, y, strict=True):
                axes.annotate(row.setting, (at, value), (5, 4), textcoords="offset points", fontsize=7.0, color=GREY)
    axes.set(xscale="log", yscale="log", xlabel="seconds")
    axes.margins(x=0.16, y=0.12)
    axes.grid(True)
    figure.legend(loc="outside upper left", ncols=2)
    return figure
