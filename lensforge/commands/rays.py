"""``rays``: a ray file summarised, drawn, or converted."""

import json
from pathlib import Path

import click

from lensforge.commands.printing import print_table
from lensforge.errors import InputError
from lensforge.records import Record


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--header", "only_header", is_flag=True, help="Read only the header: fast, whatever the size.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--to", type=click.Path(path_type=Path), help="Convert to this file; its suffix chooses the format.")
@click.option("--format", "format_name", help="Format of --to, if its suffix stands for several.")
@click.option(
    "--plot", type=click.Path(path_type=Path), help="Draw the origins and directions of the rays; PNG or SVG."
)
def rays(
    file: Path, only_header: bool, as_json: bool, to: Path | None, format_name: str | None, plot: Path | None
) -> None:
    """Summarise, draw or convert a ray file."""
    if format_name and not to:
        raise InputError(f"--format {format_name}: give --to FILE with it")
    from lensforge.sources.rayfiles import convert, describe, outline, read_rayfile
    from lensforge.sources.rayfiles.plot import draw

    if plot:
        draw(read_rayfile(file), plot)
    found: Record
    if to:
        found = convert(file, to, format_name)
    elif only_header:
        found = outline(read_rayfile(file))
    else:
        found = describe(read_rayfile(file))
    content = found.model_dump(mode="json", exclude={"inputs", "version"})
    if as_json:
        click.echo(json.dumps(content, indent=2, allow_nan=False))
        return
    content.get("header", {}).pop("spectral_tables", None)
    print_table(content)
