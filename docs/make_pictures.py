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

from lensforge.figures.light_unit import light_unit
from lensforge.files import replacing
from lensforge.report.irradiance_figures import irradiance_map
from lensforge.report.section_figures import lens_section
from lensforge.report.solid_view import Rendering
from lensforge.run_folder import load

HEIGHT = 420
WHITE = (255, 255, 255)


def panel(source: Figure | bytes) -> Image.Image:
    """A figure or a PNG as a picture of the common height, on white."""
    if isinstance(source, Figure):
        buffer = BytesIO()
        source.savefig(buffer, format="png", dpi=200, facecolor="white")
        source = buffer.getvalue()
    picture = Image.open(BytesIO(source)).convert("RGBA")
    ground = Image.new("RGBA", picture.size, WHITE)
    ground.alpha_composite(picture)
    size = round(picture.width * HEIGHT / picture.height), HEIGHT
    return ground.convert("RGB").resize(size, Image.Resampling.LANCZOS)


def light_of(directory: Path) -> Figure:
    """The light of one result on its first receiver."""
    light = load(directory).light.first
    unit = light_unit(None, far_field=light.chart.far_field)
    return irradiance_map(light.map, light.chart, float(light.map.max()), unit=unit)


def panels_of(directory: Path) -> list[Figure | bytes]:
    """The lens, its section, its light."""
    run = load(directory)
    rendering = Rendering(run.part.stl, run.spec.constraints.max_radius_mm)
    views = rendering.result()
    rendering.close()
    section = lens_section(run.lens, 0.0, np.array(run.design.source_outline_mm))
    return [views.pictures["above"], section, light_of(directory)]


def save(parts: Sequence[Figure | bytes], name: str) -> None:
    """Write all parts side by side as docs/<name>.png."""
    panels = [panel(part) for part in parts]
    sheet = Image.new("RGB", (sum(each.width for each in panels), HEIGHT), WHITE)
    position = 0
    for each in panels:
        sheet.paste(each, (position, 0))
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
        save([light_of(folder) for folder in options.folders], options.together)
    else:
        for folder in options.folders:
            save(panels_of(folder), folder.name)


if __name__ == "__main__":
    main()
