"""The command line. Exit code 0: done; 1: a gate failed; 2: bad input. Only this module prints or exits.

What a command needs is imported when it runs: ``--help`` answers at once, and CAD loads only where CAD is asked for.
"""

import json
import sys
import tempfile
import traceback
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from lensforge.errors import InputError, LensforgeError
from lensforge.gates import Gate, require
from lensforge.version import __version__

_FOLDER = click.argument("directory", metavar="DIR", type=click.Path(path_type=Path))
_RAYS = click.option("--rays", type=click.IntRange(1, 2**28), help="Number of rays; default: by the accuracy preset.")
_THREADS = click.option("--threads", type=click.IntRange(1, 256), help="Threads; default: all cores.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="%(version)s")
def cli() -> None:
    """From an LED and a wanted light pattern to a lens that a machine shop can cut."""


@cli.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@click.option(
    "--accuracy", type=click.Choice(["draft", "standard", "reference"]), default="standard", show_default=True
)
@click.option("--seed", type=click.IntRange(0, 2**20), default=0, show_default=True)
@click.option("--resume", is_flag=True, help="Go on from the checkpoint of an interrupted design.")
@click.option("--snapshots", is_flag=True, help="Draw lens and light after each level into DIR/snapshots.")
@_RAYS
@_THREADS
def design(
    spec: Path,
    out: Path | None,
    accuracy: Any,
    seed: int,
    resume: bool,
    snapshots: bool,
    rays: int | None,
    threads: int | None,
) -> None:
    """Go the whole way: design, evaluate, export, check, verify, report."""
    content = import_module("lensforge.spec").load_spec(spec)
    directory = out or Path("cad_out") / content.name
    _use_threads(threads)
    observers = []
    if snapshots:
        taken = import_module("lensforge.report.snapshots").Snapshots(content, directory, resume=resume)
        observers = [taken.on_step]
    with import_module("lensforge.progress").Reporter(content, *observers) as reporter:
        gates = _pipeline().run(
            content,
            directory,
            accuracy=accuracy,
            seed=seed,
            rays=rays,
            resume=resume,
            observer=reporter.on_step,
            announce=reporter.on_stage,
        )
    click.echo(f"report\t{directory / 'report.html'}")
    _print_headline(directory)
    require(gates)


@cli.command()
@_FOLDER
@_RAYS
@_THREADS
@click.option("--pixels", type=click.IntRange(1, 2048), help="Pixels across the receiver; default: by the spec.")
@click.option("--source", type=click.Path(path_type=Path), help="A ray file to use instead of the spec's source.")
def evaluate(directory: Path, rays: int | None, threads: int | None, pixels: int | None, source: Path | None) -> None:
    """Simulate the finished lens in DIR again."""
    _use_threads(threads)
    _finish(_pipeline().run_evaluate(directory, rays=rays, pixels=pixels, source=source), directory)


@cli.command()
@_FOLDER
@click.option(
    "--schema", type=click.Choice(["AP214", "AP242"]), default="AP214", show_default=True, help="Of the STEP."
)
@click.option("--runout", type=float, metavar="DEG", help="Also write the faces untrimmed, going on by DEG degrees.")
@click.option("--nodes", type=int, help="Spline nodes across each optical face; default: as many as the form needs.")
@click.option("--rings", type=int, help="Rings of the mesh; default: as many as its tolerance needs.")
def export(directory: Path, schema: str, runout: float | None, nodes: int | None, rings: int | None) -> None:
    """Write STEP, STL and 3MF of the lens in DIR, and prove them by reading them back."""
    _finish(_pipeline().run_export(directory, schema=schema, runout_deg=runout, nodes=nodes, rings=rings), directory)


@cli.command()
@_FOLDER
def check(directory: Path) -> None:
    """Say whether the lens in DIR can be cut, and with what."""
    _finish(_pipeline().run_check(directory), directory)


@cli.command()
@_FOLDER
@_RAYS
@_THREADS
@click.option("--stray", is_flag=True, help="Also follow reflections, the base and absorption; writes stray.json.")
@click.option(
    "--base",
    type=click.Choice(["polished", "black"]),
    default="polished",
    show_default=True,
    help="Base under --stray.",
)
def verify(directory: Path, rays: int | None, threads: int | None, stray: bool, base: str) -> None:
    """Cast rays through the exported part in DIR, independently of the design."""
    _use_threads(threads)
    result = _pipeline().run_verify(directory, rays=rays)
    if stray:
        followed = _pipeline().run_stray(directory, rays=rays, base=base)
        result["gates"] += followed.pop("gates")
        result["stray_light"] = followed
    _finish(result, directory)


@cli.command()
@_FOLDER
@_RAYS
@_THREADS
def sensitivity(directory: Path, rays: int | None, threads: int | None) -> None:
    """Say what errors of form, position and index of the lens in DIR do to its light; writes sensitivity.json."""
    _use_threads(threads)
    result = _pipeline().run_sensitivity(directory, rays=rays)
    click.echo("error\tamount\tunit\tnmse\tuniformity\tefficiency")
    for row in ({"name": "as designed", "amount": 0.0, "unit": "", **result["nominal"]}, *result["rows"]):
        click.echo("\t".join(str(row[key]) for key in ("name", "amount", "unit", "nmse", "uniformity", "efficiency")))


@cli.command()
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Result folder; default: cad_out/<spec name>.")
@_THREADS
def tradeoff(spec: Path, out: Path | None, threads: int | None) -> None:
    """Measure accuracy against time for the scene of SPEC; writes tradeoff.json and tradeoff.html."""
    content = import_module("lensforge.spec").load_spec(spec)
    directory = out or Path("cad_out") / content.name
    _use_threads(threads)
    run = import_module("lensforge.tradeoff.measure").run_tradeoff
    _print_table(run(content, directory, announce=lambda line: click.echo(line, err=True))["presets"])
    click.echo(f"page\t{directory / 'tradeoff.html'}")


@cli.command()
@_FOLDER
def handover(directory: Path) -> None:
    """Write what goes to the shop with the STEP in DIR: drawing, verdicts, points.csv, hashes; HTML and PDF."""
    _finish(_pipeline().run_handover(directory), directory)


class _Corner(click.ParamType):
    """A pixel, written as column,row."""

    name = "x,y"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[float, float]:
        try:
            column, row = (float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r}: write column,row in pixels, such as 120.5,88", param, ctx)
        return column, row


@cli.command()
@_FOLDER
@click.option("--on", type=click.Path(path_type=Path), help="Photograph of the target with the LED on.")
@click.option("--off", type=click.Path(path_type=Path), help="The same with the LED off.")
@click.option("--corners", type=_Corner(), nargs=4, help="Target corners in it: top left, and on clockwise.")
@click.option("--target-mm", type=click.FloatRange(0.0, min_open=True), help="Side of the square of --corners.")
@click.option("--gamma", type=click.FloatRange(0.2, 5.0), default=1.0, show_default=True, help="Of the camera.")
@click.option("--points", type=click.Path(path_type=Path), help="Points x, y, z in mm, measured on one surface.")
@click.option("--surface", type=click.Choice(["inner", "outer"]), help="The surface of --points.")
@click.option(
    "--registration",
    type=click.Choice(["rigid", "shift", "none"]),
    default="rigid",
    show_default=True,
    help="How --points may be moved onto the design.",
)
@_RAYS
def compare(directory: Path, on: Path | None, points: Path | None, rays: int | None, **options: Any) -> None:
    """Compare the machined part with the design in DIR: a photograph of its light, or points on a surface."""
    if (on is None) == (points is None):
        raise InputError("compare: give --on PHOTO with --corners, or --points FILE with --surface")
    if on is not None:
        if not options["corners"]:
            raise InputError("compare: --on needs --corners, four pixels x,y in it, from the top left clockwise")
        shot = {name: options[name] for name in ("off", "corners", "target_mm", "gamma")}
        result = _pipeline().run_compare_photo(directory, on=on, **shot)
    else:
        if not options["surface"]:
            raise InputError("compare: --points needs --surface, inner or outer")
        chosen = {name: options[name] for name in ("surface", "registration")}
        result = _pipeline().run_compare_surface(directory, points=points, rays=rays, **chosen)
    _finish(result, directory)


@cli.command()
@_FOLDER
@_RAYS
@_THREADS
@click.option("--lumens", type=click.FloatRange(1e-6, 1e9), help="Of the LED; default: by the spec, or 1000.")
def photometry(directory: Path, rays: int | None, threads: int | None, lumens: float | None) -> None:
    """Write the light of the lens in DIR as IES, EULUMDAT and TM-25 files."""
    _use_threads(threads)
    export = import_module("lensforge.photometry.export").export_photometry
    _finish(export(directory, rays=rays, lumens=lumens), directory)


@cli.command()
@click.argument("directories", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="The page on several designs; default: compare.html.")
@click.option("--pdf", is_flag=True, help="Also as PDF, beside the page; needs Chromium or Chrome.")
def report(directories: tuple[Path, ...], out: Path | None, pdf: bool) -> None:
    """Build report.html from the files in DIR, or one page that lays several designs side by side."""
    if len(directories) == 1 and out is not None:
        raise InputError(f"--out = {out}: one design's report goes into its folder; give two folders or more")
    if len(directories) == 1:
        page = _pipeline().run_report(directories[0])
    else:
        page = import_module("lensforge.report.compare").build_comparison(directories, out or Path("compare.html"))
    click.echo(f"report\t{page}")
    if pdf:
        click.echo(f"pdf\t{import_module('lensforge.report.pdf').write_pdf(page)}")


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--to", type=click.Path(path_type=Path), help="Convert to this file; its suffix chooses the format.")
@click.option("--format", "format_name", help="Format of --to, where a suffix stands for several.")
@click.option(
    "--plot", type=click.Path(path_type=Path), help="Draw where rays start and which way they go; PNG or SVG."
)
def rays(file: Path, as_json: bool, to: Path | None, format_name: str | None, plot: Path | None) -> None:
    """Say what is in a ray file, draw it, or convert it."""
    rayfiles = import_module("lensforge.sources.rayfiles")
    if plot:
        import_module("lensforge.sources.rayfiles.picture").draw(rayfiles.read_rayfile(file), plot)
    content = rayfiles.convert(file, to, format_name) if to else rayfiles.describe(rayfiles.read_rayfile(file))
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    content.get("header", {}).pop("spectral_tables", None)
    _print_table(content)


def _pipeline() -> Any:
    return import_module("lensforge.pipeline")


def _use_threads(threads: int | None) -> None:
    if threads is not None:
        import_module("torch").set_num_threads(threads)


def _finish(result: dict[str, Any], directory: Path) -> None:
    """Print one stage's numbers, refresh the report if there is one, and judge the stage's gates."""
    gates = [Gate(**{k: v for k, v in gate.items() if k != "passed"}) for gate in result.get("gates", [])]
    _print_table({key: value for key, value in result.items() if key != "gates"})
    if (directory / "report.html").exists():
        _pipeline().run_report(directory)
    require(gates)


def _print_table(content: dict[str, Any], prefix: str = "") -> None:
    """One ``key<TAB>value`` line for each number, keys joined by dots: easy to read, grep and cut."""
    for key, value in content.items():
        if isinstance(value, dict):
            _print_table(value, f"{prefix}{key}.")
        else:
            click.echo(f"{prefix}{key}\t{json.dumps(value) if isinstance(value, list) else value}")


_HEADLINE = {
    "evaluate": ("nmse", "nmse_standard_error", "uniformity", "efficiency", "efficiency_standard_error"),
    "design": ("steps", "seconds", "max_radius_mm", "height_mm", "constraints"),
    "export": ("form_error_nm", "normal_error_mrad", "watertight", "genus", "volume_mm3"),
    "check": ("min_wall_mm",),
    "verify": ("nmse_vs_design", "noise_floor_nmse", "deviation_mm"),
}


def _print_headline(directory: Path) -> None:
    read_json = import_module("lensforge.files").read_json
    for stage, keys in _HEADLINE.items():
        content = read_json(directory / f"{stage}.json")
        _print_table({key: content[key] for key in keys if content.get(key) is not None}, f"{stage}.")


def main() -> None:
    """Entry point: every way out is an exit code and at most one line on stderr."""
    try:
        cli.main(prog_name="lensforge", standalone_mode=False)
    except LensforgeError as error:
        _leave(str(error), error.exit_code)
    except click.ClickException as error:
        _leave(f"{error.format_message()}; see --help", 2)
    except (click.Abort, KeyboardInterrupt):
        _leave("interrupted; the same command with --resume goes on from the last checkpoint", 130)
    except BrokenPipeError:
        sys.exit(0)
    except MemoryError:
        _leave("out of memory; use fewer --rays or a lower --accuracy", 1)
    except Exception as error:  # a bug: the user gets a line, the developer the details
        with tempfile.NamedTemporaryFile("w", prefix="lensforge-", suffix=".log", delete=False) as log:
            traceback.print_exc(file=log)
        _leave(f"internal error: {type(error).__name__}: {error}; details for a bug report: {log.name}", 1)


def _leave(message: str, code: int) -> None:
    click.echo(f"lensforge: {' '.join(message.split())}", err=True)
    sys.exit(code)
