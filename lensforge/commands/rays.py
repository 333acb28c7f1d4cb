"""``rays``: what is in a ray file."""

import json
from importlib import import_module
from pathlib import Path

import click

from lensforge.commands.printing import print_table


@click.command()
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
    print_table(content)
