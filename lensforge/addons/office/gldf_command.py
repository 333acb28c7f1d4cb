"""``gldf``: the light of a result folder as the file of a luminaire for DIALux and Relux."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import click

from lensforge.addons.office.gldf_file import GLDF_FILE, LuminaireVariant, gldf_bytes, variants_of
from lensforge.addons.office.product_figures import GLARE_DEG, HIGH_CD_PER_M2, LEAST_M2
from lensforge.cli.options import FOLDER, Number
from lensforge.cli.output import Block, Output, Row, with_output
from lensforge.report.folder import opened
from lensforge.results.files import write_file


@click.command()
@FOLDER
@click.option(
    "--watts",
    type=Number(0.0, min_open=True),
    help="Electrical power of the luminaire, for its efficacy; default: not stated.",
)
@with_output
def gldf(directory: Path, watts: float | None, output: Output) -> None:
    """Write the light of the lens in DIR as lens.gldf, for DIALux and Relux.

    The EULUMDAT file with flux code, light output ratio, beam angles, cut-off angle and UGR, in a variant for each
    state.
    """
    with opened(directory) as here:
        run = here.to_show()
        variants = variants_of(run.photometry, run.spec)
        write_file(directory / GLDF_FILE, gldf_bytes(variants, run.spec, watts))
        here.refresh_report()
    written = str(directory / GLDF_FILE)
    output.show(
        lambda: {
            "gldf": written,
            "variants": [
                {"name": entry.name, "lumens": entry.file.intensity.flux(), **asdict(entry.figures)}
                for entry in variants
            ],
        },
        lambda: [*(Block(variant.name, list(_rows(variant))) for variant in variants), Block(f"Written: {written}")],
    )


def _rows(variant: LuminaireVariant) -> Iterator[Row]:
    figures = variant.figures
    yield "Light", f"{variant.file.intensity.flux():.4g} lm"
    if figures.luminance_cd_per_m2 is not None:
        yield "Luminance", f"{figures.luminance_cd_per_m2:.3g} cd/m² at {GLARE_DEG:g}°, the largest over C"
        yield "Cut-off angle", f"{figures.cut_off_deg:.1f}°, from which it stays below {HIGH_CD_PER_M2:g} cd/m²"
    if figures.glare is None:
        yield "UGR", f"not defined below {LEAST_M2:g} m² of luminous area (CIE 147)"
    else:
        yield "UGR", "{:.1f} lengthways, {:.1f} across, in 4H 8H, 70/50/20".format(*figures.glare)
