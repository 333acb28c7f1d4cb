"""``recheck``: the kit by which another program checks the light of the lens in a result folder."""

from pathlib import Path

import click

from lensforge.addons.recheck.kit import KIT_FOLDER, RAYS, kit_files
from lensforge.cli.options import FOLDER, WholeNumber
from lensforge.cli.output import Block, Output, with_output
from lensforge.report.folder import opened
from lensforge.results.files import write_file


@click.command()
@FOLDER
@click.option("--rays", type=WholeNumber(2**10, 2**22), default=RAYS, help="Number of rays of the source.")
@with_output
def recheck(directory: Path, rays: int, output: Output) -> None:
    """Write what another program needs to check the light in DIR.

    DIR/recheck has the part, rays of the source, the detector, the figures to expect with their standard errors, and
    programs for Mitsuba, Radiance, OpticStudio and Speos.
    """
    with opened(directory) as here:
        files = kit_files(here.to_show(), rays)
        folder = directory / KIT_FOLDER
        for name, content in files.items():
            write_file(folder / name, content)
    output.show(
        lambda: {"recheck": str(folder), "files": sorted(files)},
        lambda: [Block(f"To check elsewhere, in {folder}", [("Files", ", ".join(sorted(files)))])],
    )
