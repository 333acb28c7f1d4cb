"""Draw examples/arrow.png, the target of examples/image.toml: a bright arrow in a ring of half its irradiance.

python examples/make_arrow.py
"""

from pathlib import Path

from PIL import Image, ImageDraw

SIDE, FINE = 400, 4  # pixels; drawn four times as large, so that edges are smooth
RING = 128  # grey value
ARROW = ((0.0, 0.62), (0.48, 0.05), (0.18, 0.05), (0.18, -0.58), (-0.18, -0.58), (-0.18, 0.05), (-0.48, 0.05))


def draw() -> Image.Image:
    """The picture, white on black; ``ARROW`` in units of half the side, y upwards."""
    large = SIDE * FINE
    picture = Image.new("L", (large, large))
    pen = ImageDraw.Draw(picture)
    width = 0.13 * large
    pen.ellipse((0, 0, large - 1, large - 1), fill=RING)
    pen.ellipse((width, width, large - 1 - width, large - 1 - width), fill=0)
    pen.polygon([(large * (0.5 + 0.5 * x), large * (0.5 - 0.5 * y)) for x, y in ARROW], fill=255)
    return picture.resize((SIDE, SIDE), Image.Resampling.BOX)


if __name__ == "__main__":
    path = Path(__file__).parent / "arrow.png"
    draw().save(path, optimize=True)
    print(path)
