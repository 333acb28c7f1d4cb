"""Draw docs/<name>.png from finished result folders: the lens, its section, its light.

python docs/make_pictures.py cad_out/quickstart cad_out/pi ...
python docs/make_pictures.py --together patterns cad_out/plus cad_out/image ...
"""

import argparse
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from lensforge.report.folder import load
from lensforge.report.lens_figures import lens_section
from lensforge.report.light_figures import irradiance_map
from lensforge.report.solid_view import solid_views
from lensforge.results.chart import light_unit
from lensforge.results.files import replacing

HEIGHT, IN_ROW = 420, 5
WHITE = (255, 255, 255)


def panel(source: Figure | bytes) -> Image.Image:
    """A figure or a PNG as a picture of the common height, on white."""
    if isinstance(source, Figure):
        buffer = BytesIO()
        source.savefig(buffer, format="png", dpi=200, facecolor="white", bbox_inches="tight")
        source = buffer.getvalue()
    picture = Image.open(BytesIO(source)).convert("RGBA")
    ground = Image.new("RGBA", picture.size, WHITE)
    ground.alpha_composite(picture)
    size = round(picture.width * HEIGHT / picture.height), HEIGHT
    return ground.convert("RGB").resize(size, Image.Resampling.LANCZOS)


def light_of(directory: Path) -> list[Figure]:
    """The light of one result on each of its receivers."""
    found = []
    for light in load(directory).light.receivers:
        unit = light_unit(None, far_field=light.chart.far_field)
        found.append(irradiance_map(light.map, light.chart, float(light.map.max()), unit=unit))
    return found


def panels_of(directory: Path) -> list[Figure | bytes]:
    """The lens, its section, its light."""
    run = load(directory)
    views = solid_views(run.part.stl, run.spec.constraints.max_radius_mm)
    section = lens_section(run.lens, 0.0, np.array(run.design.source_outline_mm))
    return [views.pictures["above"], section, *light_of(directory)]


def save(parts: Sequence[Figure | bytes], name: str) -> None:
    """Write all parts as docs/<name>.png, in rows of five at most."""
    panels = [panel(part) for part in parts]
    rows = [panels[first : first + IN_ROW] for first in range(0, len(panels), IN_ROW)]
    width = max(sum(each.width for each in row) for row in rows)
    sheet = Image.new("RGB", (width, HEIGHT * len(rows)), WHITE)
    for number, row in enumerate(rows):
        position = 0
        for each in row:
            sheet.paste(each, (position, HEIGHT * number))
            position += each.width
    target = Path(__file__).parent / f"{name}.png"
    with replacing(target) as temporary:
        sheet.quantize(256).save(temporary, optimize=True)
    print(target)


def main() -> None:
    """Draw one sheet for each folder on the command line, or one with the light of all."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--together", metavar="NAME")
    options = parser.parse_args()
    if options.together:
        save([part for folder in options.folders for part in light_of(folder)], options.together)
    else:
        for folder in options.folders:
            save(panels_of(folder), folder.name)


if __name__ == "__main__":
    main()
