"""Draw docs/<name>.png from finished result folders: the lens, its section, its light.

python docs/make_pictures.py cad_out/quickstart cad_out/pi ...
"""

import sys
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from lensforge.files import read_json, replacing
from lensforge.lens import load_lens
from lensforge.report.irradiance_figures import irradiance_map
from lensforge.report.section_figures import lens_section
from lensforge.report.solid_view import Rendering

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
    return ground.convert("RGB").resize((round(picture.width * HEIGHT / picture.height), HEIGHT), Image.LANCZOS)


def draw(directory: Path) -> Image.Image:
    """All panels of one result, side by side."""
    lens = load_lens(directory / "lens.json")
    outline = np.array(read_json(directory / "design.json")["source_outline_mm"])
    rendering = Rendering(directory / "lens.stl", lens.spec.constraints.max_radius_mm)
    with np.load(directory / "evaluate.npz") as images:
        light = irradiance_map(images["irradiance"], lens.spec.target.receiver_mm, float(images["irradiance"].max()))
    views = rendering.result()
    rendering.close()
    panels = [panel(part) for part in (views.pictures["above"], lens_section(lens, 0.0, outline), light)]
    sheet = Image.new("RGB", (sum(each.width for each in panels), HEIGHT), WHITE)
    position = 0
    for each in panels:
        sheet.paste(each, (position, 0))
        position += each.width
    return sheet


def main() -> None:
    """Draw one sheet for each folder on the command line."""
    for name in sys.argv[1:]:
        target = Path(__file__).parent / f"{Path(name).name}.png"
        with replacing(target) as temporary:
            draw(Path(name)).quantize(256).save(temporary, optimize=True)
        print(target)


if __name__ == "__main__":
    main()
