"""``rays``: a ray file or a photometric file summarised, drawn, or converted."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lensforge.cli.options import IES_VERSION, WholeNumber
from lensforge.cli.output import Block, Output, Row, print_json, print_screen, with_output
from lensforge.errors import InputError
from lensforge.report.record_tables import TableRow, rows
from lensforge.results import Record
from lensforge.results.figure import Figure, figures_at
from lensforge.results.files import require_regular_file, require_writable
from lensforge.results.numerals import NOTHING, with_unit, without_unit
from lensforge.sources.light_files import holds_far_field, read_rayfile
from lensforge.sources.photometric.ies_labels import NEWEST, require_ies_version
from lensforge.sources.photometric.photometric_io import PhotometricConversion, convert_photometric
from lensforge.sources.photometric_summary import summarise_photometric

if TYPE_CHECKING:
    from lensforge.sources.rayfiles.ray_file_io import Conversion

_PLOT_SUFFIXES = (".png", ".svg", ".pdf")


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--header", "only_header", is_flag=True, help="Read only the header: fast, whatever the size.")
@click.option("--to", type=click.Path(path_type=Path), help="Convert to this file; its suffix chooses the format.")
@click.option("--format", "format_name", help="Format of --to, if its suffix stands for several.")
@IES_VERSION
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    help="Draw origins and directions of the rays, or the polar diagram; PNG, SVG or PDF.",
)
@click.option("--model", is_flag=True, help="Fit a radiance to the rays; --plot and --to are of this model then.")
@click.option("--rays", "count", type=WholeNumber(1, 2**26), metavar="N", help="Rays of --model that --to writes.")
@with_output
def rays(
    file: Path,
    only_header: bool,
    to: Path | None,
    format_name: str | None,
    ies_version: int | None,
    plot: Path | None,
    model: bool,
    count: int | None,
    output: Output,
) -> None:
    """Summarise, draw or convert a file of rays or candela.

    Ray files of many formats, and photometric files: IES LM-63, EULUMDAT and TM-33.
    """
    require_regular_file(file, missing="give the path of a ray file or a photometric file")
    _require_other_files(file, to, plot)
    _require_fitting(to, format_name, ies_version)
    _require_fit_of_rays(file, to, model, only_header, count)
    summary: Record | Conversion | PhotometricConversion
    if model:
        summary = _model(file, to, format_name, plot, count)
    elif holds_far_field(file):
        summary = _far_field(file, to, format_name, ies_version, plot)
    else:
        summary = _rays(file, only_header, to, format_name, plot)
    content = _content(summary)
    if output.json:
        print_json(content)
    elif output.screen:
        content.get("header", {}).pop("spectral_tables", None)
        texts = [(name, text) for name in ("lost", "warnings") for text in content.pop(name, None) or ()]
        unit = str((content.get("flux") or {}).pop("unit", ""))
        figures = figures_at(type(summary)) if isinstance(summary, Record) else {}
        told = [row for row in rows(content) if row.value.strip() not in ("", NOTHING)]
        listed = [_row(row, figures.get(row.path), unit) for row in told]
        print_screen([Block(str(file), [*listed, *texts])])


def _content(summary: "Record | Conversion | PhotometricConversion") -> dict[str, Any]:
    """Entries of a summary, or of the account of a conversion, as JSON holds them."""
    if isinstance(summary, Record):
        return summary.model_dump(mode="json", exclude={"inputs", "version"})
    return {name: list(value) if isinstance(value, tuple) else value for name, value in vars(summary).items()}


def _row(row: TableRow, figure: Figure | None, flux_unit: str) -> Row:
    """A value of the record, under its label where its field has one; of a long list the number of its entries."""
    value = f"{len(row.value.split('  '))} entries" if row.block else row.value
    if figure is None:
        path = without_unit(row.path).replace(".", " ").replace("_", " ")
        return path, with_unit(value, row.unit)
    unit = row.unit if figure.unit is None else figure.unit.format(unit=flux_unit)
    return str(figure.label), with_unit(value, unit)


def _rays(
    file: Path, only_header: bool, to: Path | None, format_name: str | None, plot: Path | None
) -> "Record | Conversion":
    from lensforge.sources.ray_file_statistics import describe, outline
    from lensforge.sources.ray_file_summary import draw
    from lensforge.sources.rayfiles.ray_file_io import convert

    if plot:
        draw(read_rayfile(file), plot)
    if to:
        return convert(file, to, format_name)
    return outline(read_rayfile(file)) if only_header else describe(read_rayfile(file))


def _require_other_files(file: Path, to: Path | None, plot: Path | None) -> None:
    """Raise :class:`InputError` for a file to write that cannot be written, or that is the input."""
    for option, path in (("--to", to), ("--plot", plot)):
        if path is not None:
            require_writable(path)
        if path is not None and path.exists() and path.samefile(file):
            raise InputError(f"{option} {path}: is the input file; give another name")


def _require_fitting(to: Path | None, format_name: str | None, ies_version: int | None) -> None:
    """Raise :class:`InputError` for a format or a version without a file of that kind."""
    if format_name and not to:
        raise InputError(f"--format {format_name}: give --to FILE with it")
    if ies_version and (to is None or to.suffix.lower() != ".ies"):
        raise InputError(f"--ies-version {ies_version}: give --to FILE.ies with it; other files have no such version")


def _require_fit_of_rays(file: Path, to: Path | None, model: bool, only_header: bool, count: int | None) -> None:
    """Raise :class:`InputError` for a model of what has no rays, or that writes an unknown number of them."""
    if (count is None) == (model and to is not None):
        raise InputError("--model with --to FILE needs --rays N, which is for these two alone")
    if model and (only_header or holds_far_field(file)):
        raise InputError(f"--model {file}: of the rays of a ray file; leave it out for a header or a photometric file")


def _model(file: Path, to: Path | None, format_name: str | None, plot: Path | None, count: int | None) -> Record:
    from lensforge.sources.model_of_file import draw_model, drawn_file, model_of
    from lensforge.sources.ray_file_statistics import describe
    from lensforge.sources.rayfiles.ray_file_io import write_rayfile

    if plot and plot.suffix.lower() not in _PLOT_SUFFIXES:
        raise InputError(f"{plot}: its suffix must be one of {', '.join(_PLOT_SUFFIXES)}")
    rayfile = read_rayfile(file)
    model = model_of(rayfile)
    if plot:
        draw_model(rayfile, model, plot)
    if to and count:
        write_rayfile(to, drawn_file(rayfile, model, count), format_name)
        rayfile = read_rayfile(to)
    return describe(rayfile).changed(model=model.description)


def _far_field(
    file: Path, to: Path | None, format_name: str | None, ies_version: int | None, plot: Path | None
) -> Record | PhotometricConversion:
    if format_name:
        raise InputError(
            f"--format {format_name}: {file} is photometric; the suffix of --to, .ies, .ldt or .iesxml, is enough"
        )
    if plot:
        if plot.suffix.lower() not in _PLOT_SUFFIXES:
            raise InputError(f"{plot}: its suffix must be one of {', '.join(_PLOT_SUFFIXES)}")
        summarise_photometric(file).save(plot)
    if to is None:
        return summarise_photometric(file)
    return convert_photometric(file, to, ies_version=require_ies_version(ies_version or NEWEST))
