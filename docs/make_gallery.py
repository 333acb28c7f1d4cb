"""Draw docs/gallery/NAME.png, the light of each shipped spec by a draft, and write docs/gallery.md with all of them.

python docs/make_gallery.py            # the drafts that are not drawn yet, then the page: a minute each
python docs/make_gallery.py --page     # the page alone
"""

import argparse
import json
import tomllib
from io import BytesIO
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
EXAMPLES = DOCS.parent / "examples"
PICTURES, FIGURES, PAGE = DOCS / "gallery", DOCS / "gallery.json", DOCS / "gallery.md"
RAYS = 2**20
GROUPS = {
    "The first ones": ("quickstart", "cross", "rectangle", "text", "image"),
    "The paper's": ("flat_top", "flat_top_compact", "pi", "plus"),
    "For the shop": ("flat_top_milled", "robust_pi", "fixed_inner", "fixed_outer", "fixed_step_face"),
    "Real LEDs": ("led_rayfile", "led_colours", "osram_pi", "chip_array", "second_source"),
    "Colours": ("rgbw", "white_two_files"),
    "Other receivers": ("wall_washer", "curved_screen", "two_distances"),
    "Beams and lamps": ("batwing", "elliptical_beam", "from_ies", "signal", "street_lamp"),
    "Roads": ("road_m3", "road_wide", "road_luminance", "pedestrian"),
    "Lamps together": (
        "backlight", "backlight_plate", "backlight_rim", "high_bay", "panel", "street_module", "floodlights",
    ),
    "Total internal reflection": ("spot", "spot_10", "oval", "flashlight", "desk_spot", "collimating_mirror"),
    "Reflectors": ("reflector", "ellipsoidal_reflector"),
    "Materials": ("silicone", "coated_cover_glass", "domed_cover"),
    "Designs of published papers": (
        "published/rectangle_2mm", "published/rectangle_3mm", "published/compact_rectangle",
        "published/compact_one_axis", "published/circle", "published/street", "published/two_numerals",
    ),
}  # fmt: skip
HEAD = """# Gallery

Every shipped spec and its light. The pictures are of drafts, {rays:,} rays, made in a minute each by
`python docs/make_gallery.py`; the figures of the finished lenses are in [Results](results.md) and
[Against what is published](published.md). `lensforge examples NAME` copies a spec, with the files that it names, into
the folder that you are in.

Beside the specs there are two scripts, `examples/design_to_step.py` and `examples/faces_to_step.py`, and three
notebooks:
[A first lens and its light](notebooks/first_light.ipynb),
[Size against efficiency](notebooks/size_against_efficiency.ipynb),
[A target of your own](notebooks/own_target.ipynb).
"""


def names() -> list[str]:
    """All specs of the gallery, as paths in examples/ without their suffix."""
    return [name for group in GROUPS.values() for name in group]


def sentence(name: str) -> str:
    """The comment at the head of a spec, as one paragraph."""
    head = (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8").split("\nname = ")[0]
    return " ".join(line.lstrip("# ") for line in head.splitlines()).replace("|", "\\|")


def picture(name: str) -> Path:
    """Place of the picture of a spec."""
    return PICTURES / f"{Path(name).name}.png"


def draw(name: str) -> dict[str, object]:
    """Design a draft, draw its light on each receiver side by side, and return its figures."""
    import lensforge as lf

    spec = lf.load_spec(EXAMPLES / f"{name}.toml")
    if spec.optimise.seconds is not None:  # the same draft on every machine, not as much as a time allows
        spec = spec.replace({"optimise.seconds": None})
    light = lf.evaluate(lf.design(spec, accuracy="draft", force=True).lens, rays=RAYS)
    panels = []
    for receiver in light.receivers:
        figure = light.plot(receiver=receiver.name).figure
        figure.set_size_inches(3.6, 2.8)
        buffer = BytesIO()
        figure.savefig(buffer, format="png", dpi=90, facecolor="white", bbox_inches="tight")
        panels.append(Image.open(buffer).convert("RGB"))
    sheet = Image.new("RGB", (sum(each.width for each in panels), max(each.height for each in panels)), "white")
    for index, each in enumerate(panels):
        sheet.paste(each, (sum(other.width for other in panels[:index]), 0))
    PICTURES.mkdir(exist_ok=True)
    sheet.quantize(64).save(picture(name), optimize=True)
    return {
        "accuracy": "draft",
        "aim": spec.optimise.aim,
        "share_in_target": [receiver.share_in_target.value for receiver in light.receivers],
        "nmse": [receiver.nmse.value for receiver in light.receivers],
        "efficiency": [receiver.efficiency.value for receiver in light.receivers],
    }


def figures_of(found: dict[str, list[float]]) -> str:
    """The figures of a design in words; where only the share of the light counts, an error of its pattern is none."""
    shares = ", ".join(f"{value:.3f}" for value in found["efficiency"])
    if found.get("aim") == "share":
        return f"In the target {', '.join(f'{value:.3f}' for value in found['share_in_target'])}, efficiency {shares}"
    return f"NMSE {', '.join(f'{value:.4f}' for value in found['nmse'])}, efficiency {shares}"


def page(figures: dict[str, dict[str, list[float]]]) -> str:
    """The page: a group for each heading, a spec for each row."""
    lines = [HEAD.format(rays=RAYS)]
    for title, group in GROUPS.items():
        lines += [f"## {title}", "", "| spec | its light |", "|---|---|"]
        for name in group:
            found = figures.get(name)
            drawn = f"![The light of {Path(name).name}](gallery/{Path(name).name}.png)" if found else ""
            values = f" *{figures_of(found)}.*" if found else ""
            link = f"[`{Path(name).name}`](../examples/{name}.toml)"
            lines.append(f"| {link}: {sentence(name)}{values} | {drawn} |")
        lines.append("")
    return "\n".join(lines)


def _stored() -> dict[str, dict[str, list[float]]]:
    return json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}


def main() -> None:
    """Draw what is missing, and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--page", action="store_true", help="write the page alone")
    if not parser.parse_args().page:
        for name in names():
            figures = _stored()
            source = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")).get("source", {})
            if name in figures or ("file" in source and not (EXAMPLES / name).parent.joinpath(source["file"]).exists()):
                continue
            figures[name] = draw(name)
            FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
            print(name, figures[name], flush=True)
    PAGE.write_text(page(_stored()), encoding="utf-8")


if __name__ == "__main__":
    main()
