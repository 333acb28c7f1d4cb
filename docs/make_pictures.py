"""Draw docs/<name>.png from finished result folders: the lens, its section, its light.

python docs/make_pictures.py cad_out/quickstart cad_out/lamp
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

HEIGHT = 420
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
    """Write all parts side by side as docs/<name>.png."""
    panels = [panel(part) for part in parts]
    sheet = Image.new("RGB", (sum(picture.width for picture in panels), HEIGHT), WHITE)
    position = 0
    for picture in panels:
        sheet.paste(picture, (position, 0))
        position += picture.width
    target = Path(__file__).parent / f"{name}.png"
    with replacing(target) as temporary:
        sheet.quantize(256).save(temporary, optimize=True)
    print(target)


def main() -> None:
    """Draw one sheet for each folder on the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="+", type=Path)
    for folder in parser.parse_args().folders:
        save(panels_of(folder), folder.name)


if __name__ == "__main__":
    main()
