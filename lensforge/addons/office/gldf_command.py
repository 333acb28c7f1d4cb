"""``gldf``: the light of a result folder as the file of a luminaire for DIALux and Relux."""

from pathlib import Path

import click

from lensforge.addons.office.gldf_file import GLDF_FILE, LuminaireVariant, gldf_bytes, variants_of
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
        lambda: {"gldf": written, "variants": [dict(_plain(variant)) for variant in variants]},
        lambda: [*(Block(variant.name, list(_rows(variant))) for variant in variants), Block(f"Written: {written}")],
    )


def _plain(variant: LuminaireVariant) -> list[tuple[str, object]]:
    figures = variant.figures
    lit = variant.photometry
    return [
        ("name", variant.name),
        ("lumens", variant.file.intensity.flux()),
        ("light_output_ratio", lit.light_output_ratio.value),
        ("flux_code", lit.figures.flux_code_words),
        ("luminance_65_cd_per_m2", figures.luminance_cd_per_m2),
        ("cut_off_deg", figures.cut_off_deg),
        ("ugr_4h8h_70_50_20", figures.glare),
    ]


def _rows(variant: LuminaireVariant) -> list[Row]:
    figures = variant.figures
    glare = "its luminous area is below 0.005 m², for which UGR is not defined (CIE 147)"
    if figures.glare is not None:
        glare = "{:.1f} lengthways, {:.1f} across, 4H 8H, 70/50/20".format(*figures.glare)
    bright = figures.luminance_cd_per_m2
    rows = [("Light", f"{variant.file.intensity.flux():.4g} lm"), ("UGR", glare)]
    if bright is not None and figures.cut_off_deg is not None:
        rows += [
            ("Luminance", f"{bright:.3g} cd/m² at 65°, the largest over C"),
            ("Cut-off angle", f"{figures.cut_off_deg:.1f}°, from which it stays below 3000 cd/m²"),
        ]
    return rows
