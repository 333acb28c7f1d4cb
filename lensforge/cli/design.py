"""Commands that design: ``design``, whole runs; ``preview``, a first look."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import click

from lensforge.cli.conclusion import document, finish_run, preview_rows
from lensforge.cli.options import (
    ACCURACY,
    DEVICE,
    OPEN,
    SCHEDULER,
    SEARCH_RAYS,
    SEED,
    SPEC,
    THREADS,
    WholeNumber,
    resume_after_interrupt,
    with_force,
    with_rays,
)
from lensforge.cli.output import Block, Output, print_json, with_output
from lensforge.cli.preview_picture import PreviewPicture
from lensforge.cli.studies import design_for_each, run_with_progress
from lensforge.errors import CriterionMissed, FailedDesigns, InputError, LensforgeError
from lensforge.kernels.parallel import thread_count
from lensforge.report.folder import Run, opened
from lensforge.report.results import REPORT_FILE
from lensforge.results.child_pool import child_pool
from lensforge.search import searches
from lensforge.search.checkpoint import CHECKPOINT, is_checkpoint
from lensforge.search.design_result import Progress
from lensforge.search.searches import SearchOptions
from lensforge.spec import Spec, load_spec
from lensforge.spec.spec_files import alike

_PICTURE_FILE = "light.png"  # of a preview
_PREVIEW_RAYS = 2**17  # at most: an eighth of a draft's, for figures that have 2.8 times its errors


@click.command()
@click.argument("specs", metavar="SPEC...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@click.option(
    "--sources",
    "files",
    metavar="FILE",
    multiple=True,
    help="A lens for each of these LEDs: ray files, a .csv table of them, a .toml file with [[sources]].",
)
@ACCURACY
@SEED
@click.option("--resume", is_flag=True, help="Continue from the checkpoint of an interrupted design.")
@with_force
@click.option("--starts", metavar="N", type=WholeNumber(1, 1000), default=1, help="Searches; the best is kept.")
@SEARCH_RAYS
@THREADS
@SCHEDULER
@DEVICE
@OPEN
@with_output
def design(
    specs: tuple[Path, ...],
    out: Path | None,
    files: tuple[str, ...],
    resume: bool,
    rays: int | None,
    shown: bool,
    output: Output,
    **options: Any,
) -> None:
    """Make a lens from SPEC, from the search to the report.

    The stages are design, evaluate, export, check, verify, photometry and report; all files go into one folder. An
    interrupted search continues with --resume. Lengths in the spec are in mm, angles in degrees, flux in W or lm;
    examples/ has specs to begin from.

    Several specs are designed one after the other. With --sources one spec is designed for each LED:

    \b
    lensforge design lens.toml --sources leds/*.ray
    """
    if files:
        spec, leds = _spec_and_leds(specs, files)
        page = design_for_each(with_rays(load_spec(spec), rays), leds, out, resume=resume, output=output, **options)
        if shown:
            click.launch(str(page))
        return
    contents = [with_rays(load_spec(spec), rays) for spec in specs]  # all of them before the first search
    if len(contents) == 1:
        directory = out or Path("cad_out") / contents[0].name
        run = _run_of(contents[0], directory, resume, output, options)
        if shown:
            click.launch(str(run.folder / REPORT_FILE))
        finish_run(output, run)
    else:
        _design_several(contents, out, resume, shown, output, options)


def _run_of(content: Spec, directory: Path, resume: bool, output: Output, options: Mapping[str, Any]) -> Run:
    from lensforge.cli.progress import StageClock

    resume_after_interrupt(lambda: is_checkpoint(directory / CHECKPOINT))
    with StageClock("design", quiet=output.quiet) as clock:
        run = run_with_progress(content, directory, clock, resume=resume, **options)
        clock.total()
    return run


def _design_several(
    contents: Sequence[Spec], out: Path | None, resume: bool, shown: bool, output: Output, options: Mapping[str, Any]
) -> None:
    """Design one spec after the other, whatever becomes of the others.

    Raises :class:`FailedDesigns` when all have ended, :class:`InputError` before the first.
    """
    if (duplicate := alike(content.name for content in contents)) is not None:
        raise InputError(f"SPEC: {duplicate}, and would go to one folder; rename one")
    for given, option in ((out, "--out"), (resume, "--resume"), (shown, "--open")):
        if given:
            raise InputError(f"{option}: goes with one SPEC, {len(contents)} are given; design that one by itself")
    failed = dict[str, LensforgeError]()
    runs = list[Run]()
    for content in contents:
        try:
            runs.append(_run_of(content, Path("cad_out") / content.name, False, output, options))
            finish_run(Output(quiet=True) if output.json else output, runs[-1])
        except (InputError, CriterionMissed) as error:
            failed[content.name] = error
    if output.json:
        print_json({"designs": [document(run, *run.found.values()) for run in runs]})
    if failed:
        raise FailedDesigns(failed)


def _spec_and_leds(specs: Sequence[Path], files: Sequence[str]) -> tuple[Path, list[str]]:
    """The spec apart from the files of LEDs: a shell expands ``--sources *.ray`` into positional arguments."""
    spec = next((spec for spec in specs if spec.suffix == ".toml"), specs[0])
    return spec, [*files, *(str(file) for file in specs if file is not spec)]


@click.command()
@SPEC
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>_preview.")
@SEED
@THREADS
@with_force
@OPEN
@with_output
def preview(spec: Path, out: Path | None, shown: bool, output: Output, **options: Unpack[SearchOptions]) -> None:
    """Search a draft of SPEC in fewer steps, and draw its light: a first look, without the files of a part.

    The picture is there after the first level of the search, and is renewed until the search has ended.
    """
    from lensforge.cli.progress import DesignProgress, StageClock
    from lensforge.kernels.compiled import are_compiled
    from lensforge.search.scene_check import compile_search_kernels

    content = load_spec(spec)
    content = content.replace({"evaluate.rays": min(content.evaluate.rays or _PREVIEW_RAYS, _PREVIEW_RAYS)})
    directory = out or Path("cad_out") / f"{content.name}_preview"
    picture = directory / _PICTURE_FILE
    several = (options.get("threads") or thread_count()) > 1
    with StageClock("design", quiet=output.quiet) as clock, child_pool(int(several), clock.warn) as second:
        if second.runs and not are_compiled():
            second.call(compile_search_kernels, content)
        heard = DesignProgress(clock, content)
        looks = PreviewPicture(picture, second, shown=shown)

        def on_step(step: Progress) -> None:
            heard.on_step(step)
            looks.on_step(step)

        with opened(directory, create=True) as here:
            options.update({"accuracy": "draft", "preview": True, "progress": on_step, "warn": clock.warn})
            made = here.write(searches.design(content, **options))
            clock.begin("evaluate")
            light = here.write(looks.at_the_end(made.lens))
            run = here.run
        clock.total()
    title = f"{content.name}: a draft, {run.design.steps} steps"
    rows = [*preview_rows(run), ("Picture", str(picture))]
    output.show(lambda: document(run, made, light), lambda: [Block(title, rows)])
