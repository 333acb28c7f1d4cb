"""Single stages on a finished lens: evaluate, export, check, verify, report."""

from pathlib import Path
from typing import Literal

import click

from lensforge.cli.conclusion import finish, finish_page
from lensforge.cli.options import FOLDER, RAYS, THREADS
from lensforge.cli.output import Output, with_output
from lensforge.cli.whole_number import WholeNumber
from lensforge.errors import InputError
from lensforge.results import StageResult
from lensforge.results.files import require_writable
from lensforge.results.ownership import is_free_or_own, require_own
from lensforge.runs import pipeline
from lensforge.runs.arguments import threads_of_torch
from lensforge.runs.results import REPORT_FILE


@click.command()
@FOLDER
@RAYS
@THREADS
@click.option(
    "--pixels", metavar="N", type=WholeNumber(1, 2048), help="Pixels across the receiver; default: from the spec."
)
@click.option("--source", type=click.Path(path_type=Path), help="A ray file to use instead of the spec's source.")
@click.option("--temperature", type=float, metavar="C", help="Temperature (Celsius) of the lens and the air around it.")
@click.option("--name", help="Name of the record under other conditions; default: made from them.")
@with_output
def evaluate(
    directory: Path,
    rays: int | None,
    threads: int | None,
    pixels: int | None,
    source: Path | None,
    temperature: float | None,
    name: str | None,
    output: Output,
) -> None:
    """Simulate the finished lens in DIR again.

    With other --rays, --pixels, --source or --temperature than the lens's own the result is written to
    evaluate_NAME.json beside evaluate.json, and decides nothing; the report shows it under other conditions.
    """
    from lensforge.cli.stage_clock import StageClock

    with StageClock("evaluate", quiet=output.quiet), threads_of_torch(threads):
        light = pipeline.run_evaluate(
            directory, rays=rays, pixels=pixels, source=source, temperature_c=temperature, name=name
        )
    finish(output, directory, light, decides="light")


@click.command()
@FOLDER
@click.option(
    "--schema", type=click.Choice(["AP214", "AP242"]), default="AP214", show_default=True, help="Schema of the STEP."
)
@click.option("--runout", type=float, metavar="DEG", help="Also write the faces untrimmed, extended by DEG degrees.")
@click.option(
    "--nodes",
    metavar="N",
    type=WholeNumber(1, 10_000),
    help="Spline nodes across each optical face; default: as many as the form needs.",
)
@click.option(
    "--rings",
    metavar="N",
    type=WholeNumber(1, 100_000),
    help="Equal rings of the mesh; default: its facets are within 1 um of the faces.",
)
@click.option("--date", metavar="YYYY-MM-DD", help="Date of the files for the shop; default: that of the spec.")
@with_output
def export(
    directory: Path,
    schema: Literal["AP214", "AP242"],
    runout: float | None,
    nodes: int | None,
    rings: int | None,
    date: str | None,
    output: Output,
) -> None:
    """Write STEP, STL and 3MF of the lens in DIR.

    Each file is verified by reading it back.
    """
    from lensforge.cli.stage_clock import StageClock

    with StageClock("export", quiet=output.quiet):
        part = pipeline.run_export(directory, schema=schema, runout_deg=runout, nodes=nodes, rings=rings, date=date)
    finish(output, directory, part, decides="files")


@click.command()
@FOLDER
@with_output
def check(directory: Path, output: Output) -> None:
    """Say if the lens in DIR can be cut, and what to change.

    Each face, each tool, how much of the face it reaches, and the fields of the spec that change it. --json has all
    measurements: best-fit spheres, curvature, walls, draft, cusps.
    """
    from lensforge.cli.stage_clock import StageClock

    with StageClock("check", quiet=output.quiet):
        found = pipeline.run_check(directory)
    finish(output, directory, found, decides="cutting")


@click.command()
@FOLDER
@RAYS
@THREADS
@click.option("--stray", is_flag=True, help="Also trace reflections, the base and absorption; writes stray.json.")
@click.option(
    "--base",
    type=click.Choice(["polished", "black"]),
    default="polished",
    show_default=True,
    help="Finish of the base under --stray.",
)
@with_output
def verify(
    directory: Path,
    rays: int | None,
    threads: int | None,
    stray: bool,
    base: Literal["polished", "black"],
    output: Output,
) -> None:
    """Cast rays through the exported part in DIR.

    The ray cast is independent of the design. With other --rays than the preset's the result is written to
    verify_NUMBERrays.json beside verify.json.
    """
    from lensforge.cli.stage_clock import StageClock

    found: list[StageResult] = []
    with StageClock("verify", quiet=output.quiet) as clock, threads_of_torch(threads):
        proof = pipeline.run_verify(directory, rays=rays)
        found.append(proof)
        for note in proof.notes:
            clock.warn(note)
        if stray:
            clock.begin("stray light")
            found.append(pipeline.run_stray(directory, rays=rays, base=base))
    finish(output, directory, *found, decides="files")


@click.command()
@click.argument("directories", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="The page on several designs; default: compare.html.")
@click.option("--pdf", is_flag=True, help="Also write a PDF next to the page; needs Chromium or Chrome.")
@with_output
def report(directories: tuple[Path, ...], out: Path | None, pdf: bool, output: Output) -> None:
    """Build report.html from the files in DIR.

    Of several folders one page is built that compares the designs.
    """
    if len(directories) == 1 and out is not None:
        raise InputError(f"--out = {out}: the report on one design is written to its folder; give two folders or more")
    from lensforge.cli.stage_clock import StageClock
    from lensforge.report.page import write_pdf

    page = directories[0] / REPORT_FILE if len(directories) == 1 else out or Path("compare.html")
    printed = page.with_suffix(".pdf")
    for path in (page, printed) if pdf else (page,):  # before the pages are drawn
        require_own(path)
    if len(directories) > 1:
        require_writable(page)
    stale = printed.exists() and is_free_or_own(printed)
    with StageClock("report", quiet=output.quiet):
        if len(directories) == 1:
            pipeline.run_report(directories[0])
        else:
            pipeline.run_comparison(directories, page)
        written = {"report": page, **({"pdf": write_pdf(page)} if pdf else {})}
    if stale and not pdf:
        click.echo(f"{printed} showed the earlier page and is removed; --pdf writes a new one", err=True)
    finish_page(output, directories[0] if len(directories) == 1 else None, written)
