"""Studies of many designs: ``sweep`` over a field, a lens for each LED, and ``tradeoff`` over time, tool or process."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, get_args

import click

from lensforge.cli.conclusion import finish_study
from lensforge.cli.options import (
    ACCURACY,
    SCHEDULER,
    SEARCH_RAYS,
    SEED,
    SPEC,
    THREADS,
    WholeNumber,
    resume_after_interrupt,
    with_rays,
)
from lensforge.cli.output import Output, with_output
from lensforge.errors import CriterionMissed, InputError
from lensforge.light.lens_light import evaluate, is_same_source, other_source
from lensforge.report import pipeline
from lensforge.report.folder import Run, RunFolder, opened
from lensforge.report.variation import AnyVariation, ToolAxis, parse_variation, sources_of, tool_study
from lensforge.results.arguments import threads_of_torch
from lensforge.results.criteria import require
from lensforge.scene.lens import load_lens
from lensforge.search.checkpoint import CHECKPOINT
from lensforge.search.searches import SearchOptions, redesign
from lensforge.spec import AnyAccuracy, Spec, load_spec
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.spec_files import joined_name
from lensforge.surfaces.imported_face import LENS_FILE

if TYPE_CHECKING:
    from lensforge.cli.progress import StageClock

_PAGE = "sweep.html"


def run_with_progress(
    spec: Spec,
    directory: Path,
    clock: "StageClock",
    *,
    resume: bool = False,
    starts: int = 1,
    scheduler: str | None = None,
    **options: Unpack[SearchOptions],
) -> Run:
    """Run with progress on ``clock``. Raises :class:`InputError` where there is no checkpoint to ``resume`` from."""
    from lensforge.cli.progress import DesignProgress

    checkpoint = directory / CHECKPOINT
    if resume and not checkpoint.exists():
        raise InputError(f"{checkpoint}: no checkpoint to resume from; run without --resume")
    heard = DesignProgress(clock, spec)
    options.update({"checkpoint": checkpoint if resume else None, "progress": heard.on_step, "warn": clock.warn})
    return pipeline.run(
        spec, directory, announce=heard.on_stage, ended=heard.on_end, starts=starts, scheduler=scheduler, **options
    )


def renewed_for(here: RunFolder, source: Path, clock: "StageClock", threads: int | None) -> Run:
    """Search a lens for ``source`` from the lens of a folder on, with its light, in a folder beside it.

    Raises :class:`InputError` where that folder holds a lens for another LED, such as one of a file of the same stem.
    """
    from lensforge.cli.progress import DesignProgress

    lens = here.run.lens
    folder = here.path.parent / joined_name(here.path.resolve().name, source.stem)
    heard = DesignProgress(clock, lens.spec)
    clock.begin("design")
    with opened(folder, create=True) as there:
        _require_same_led(folder, other_source(lens.spec, source))
        made = there.write(redesign(lens, source, threads=threads, progress=heard.on_step, warn=clock.warn))
        clock.begin("evaluate")
        there.write(evaluate(made.lens, threads=threads))
        return there.run


def _require_same_led(folder: Path, led: EmitterSection) -> None:
    path = folder / LENS_FILE
    if path.exists() and not is_same_source(led, load_lens(path).spec.source):
        raise InputError(f"{folder}: holds a lens for another LED; rename it, or the ray file")


@click.command()
@SPEC
@click.option("--vary", required=True, metavar="FIELD=V1,V2,...", help="The field and its values.")
@click.option("--scale", multiple=True, metavar="FIELD", help="A field that keeps its ratio to the varied one.")
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>_sweep.")
@ACCURACY
@SEED
@click.option("--resume", is_flag=True, help="Keep the designs that an earlier call finished, and continue.")
@SEARCH_RAYS
@THREADS
@SCHEDULER
@with_output
def sweep(
    spec: Path,
    vary: str,
    scale: tuple[str, ...],
    out: Path | None,
    rays: int | None,
    **options: Any,
) -> None:
    """Design SPEC for each value of one field.

    Writes sweep.json and sweep.html.

    \b
    lensforge sweep examples/pi.toml --vary constraints.max_radius_mm=8,10,12,14 \\
        --scale lens.inner.offset_mm --scale lens.outer.offset_mm
    """
    content = with_rays(load_spec(spec), rays)
    directory = out or Path("cad_out") / f"{content.name}_sweep"
    _run_study(content, parse_variation(vary, scale), directory, **options)


def design_for_each(content: Spec, leds: Sequence[str], out: Path | None, **options: Any) -> Path:
    """Design a spec for each LED of the files ``leds``, and return the page on all."""
    directory = out or Path("cad_out") / f"{content.name}_sources"
    _run_study(content, sources_of(list(leds), content), directory, **options)
    return directory / _PAGE


def _run_study(
    content: Spec,
    variation: AnyVariation,
    directory: Path,
    *,
    resume: bool,
    output: Output,
    scheduler: str | None,
    **options: Any,
) -> None:
    """Make every design of ``variation``, and print all. Raises :class:`CriterionMissed` where one fails."""
    from lensforge.cli.progress import StageClock
    from lensforge.report.sweep_runs import resumable, run_sweep

    resume_after_interrupt(lambda: resumable(directory))
    with StageClock("sweep", quiet=output.quiet) as clock:

        def run_design(spec: Spec, folder: Path, resume: bool) -> object:
            clock.begin("design")
            return run_with_progress(spec, folder, clock, resume=resume, **options)

        result = run_sweep(
            content,
            variation,
            directory,
            run_design,
            resume=resume,
            scheduler=scheduler,
            announce=clock.head,
            **options,
        )
    finish_study(output, directory, result, f"{result.vary}, {len(result.designs)} designs", _PAGE)
    if result.failed:
        name, why = next(iter(result.failed.items()))
        rest = f", and {len(result.failed) - 1} more" if len(result.failed) > 1 else ""
        raise CriterionMissed(f"{directory}: no design for {name}{rest}: {why}")
    require(result.criteria)


@click.command()
@SPEC
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@click.option(
    "--over",
    type=click.Choice(["time", *get_args(ToolAxis)]),
    default="time",
    show_default=True,
    help="What is traded for light: time; the radius of the tool, a quarter of that in the spec to twice it; or the "
    "process, each with a search of its own.",
)
@click.option(
    "--most-rays",
    metavar="N",
    type=WholeNumber(2**12, 2**24),
    help="Over time, rays of the longest evaluation; 2^24 takes a minute; default: 2^20.",
)
@ACCURACY
@THREADS
@with_output
def tradeoff(
    spec: Path,
    over: Literal["time"] | ToolAxis,
    out: Path | None,
    most_rays: int | None,
    accuracy: AnyAccuracy,
    threads: int | None,
    output: Output,
) -> None:
    """Measure light against time, tool or process for the scene of SPEC.

    Over time it writes tradeoff.json and tradeoff.html; over tool or process sweep.json and sweep.html into a folder of
    that name.

    \b
    lensforge tradeoff examples/rectangle.toml --over tool --accuracy draft
    """
    content = load_spec(spec)
    if over != "time":
        if most_rays is not None:
            raise InputError(f"--most-rays {most_rays}: goes with --over time, not {over}; leave it out")
        directory = out or Path("cad_out") / joined_name(content.name, over)
        varied, variation = tool_study(content, over)
        options: dict[str, Any] = {"accuracy": accuracy, "seed": 0, "threads": threads}
        _run_study(varied, variation, directory, resume=False, scheduler=None, output=output, **options)
        return
    directory = out or Path("cad_out") / content.name

    from lensforge.cli.progress import StageClock
    from lensforge.report.tradeoff_study import run_tradeoff

    with StageClock("tradeoff", quiet=output.quiet) as clock, threads_of_torch(threads):
        begin = partial(clock.begin, "study")
        measured = run_tradeoff(
            content,
            directory,
            most_rays=most_rays or 2**20,
            accuracy=accuracy,
            announce=begin,
            warn=clock.warn,
        )
    finish_study(output, directory, measured, "Error of each preset on this scene", "tradeoff.html")
