"""``studio``: a page on which a spec is written, and its light is seen while a lens is searched."""

from pathlib import Path

import click

from lensforge.addons.studio.studio import studio as open_studio


@click.command()
@click.argument("spec", metavar="[SPEC|DIR]", required=False, type=click.Path(path_type=Path))
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port; default: any that is free.")
@click.option("--browser/--no-browser", default=True, help="Open the page in the desktop's browser.")
def studio(spec: Path | None, port: int, browser: bool) -> None:
    """Open a page on this machine: write SPEC, see what is possible, and watch the light while a lens is searched.

    Results go to cad_out/<spec name>, or to DIR. Nothing leaves the machine. Ctrl-C ends it; a search that runs then
    leaves its checkpoint, with which the page goes on.
    """
    opened = open_studio(spec, port=port, browser=browser)
    hint = "" if opened.shown or not browser else "No browser was found: open the address in one. "
    click.echo(f"{opened.address}\n{hint}Results: {opened.folder}. Ctrl-C ends the studio.", err=True)
    try:
        opened.wait()
    finally:
        opened.close()
