"""Draw docs/gallery/NAME.png, the light of each shipped spec by a draft, and write docs/gallery.md with all of them.

python docs/make_gallery.py            # the drafts that are not drawn yet, then the page: a minute each
python docs/make_gallery.py --page     # the page alone
python docs/make_gallery.py --small    # docs/gallery/thumb_NAME.png, the pictures of README's table
"""

import argparse
import json
import tomllib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from PIL import Image, ImageChops

from lensforge.results.numerals import quantity

DOCS = Path(__file__).parent
EXAMPLES = DOCS.parent / "examples"
PICTURES, FIGURES, PAGE = DOCS / "gallery", DOCS / "gallery.json", DOCS / "gallery.md"
RAYS = 2**20
SIDE = 96  # of a small picture of README, in pixels
SMALL = (
    "spot", "oval", "rectangle", "quickstart", "reflector", "backlight_plate", "floodlights", "road_m3", "rgbw",
)  # fmt: skip
GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "Pictures": (
        "Two freeform faces draw a picture: letters, a logo, numbers on a grid ([the target](targets.md)).",
        ("quickstart", "cross", "text", "image", "two_distances", "curved_screen"),
    ),
    "Fields and wide beams": (
        "Two freeform faces make an even field, a beam, or the light of a file ([the target](targets.md),"
        " [limits](limits.md)).",
        ("rectangle", "wall_washer", "batwing", "elliptical_beam", "from_ies", "tof_illuminator", "signal"),
    ),
    "Spots and ovals": (
        "A lens for total internal reflection sends more light into a narrow beam ([spots](beams.md)).",
        ("spot", "spot_thin", "spot_10", "oval", "driving_beam", "flashlight", "desk_spot", "collimating_mirror"),
    ),
    "Reflectors": (
        "A mirror in place of a lens ([reflectors](beams.md#reflectors)).",
        ("reflector", "ellipsoidal_reflector"),
    ),
    "Linear lenses": (
        "A profile drawn along a row of LEDs ([linear lenses](beams.md#linear-lenses)).",
        ("shelf", "vision_line"),
    ),
    "In the figures of a trade": (
        "What a screen, a simulator, a surgical lamp, curing, a bicycle, a backlight and plants are judged by"
        " ([figures of a trade](limits.md#figures-of-a-trade)).",
        (
            "projector", "solar_simulator", "surgical_lamp", "surgical_mask", "uv_curing", "bike_lamp",
            "backlight_thin", "growth_lamp",
        ),
    ),
    "Roads": (
        "A road is stated by its class; the lens is designed for what drivers see ([roads](roads.md)).",
        ("road_m3", "road_wide", "road_luminance", "pedestrian", "street_lamp"),
    ),
    "Offices and escape routes": (
        "The glare of lamps in a standard room, and emergency lighting, are limits"
        " ([offices, escape routes and playing fields](offices.md)).",
        ("office_panel", "escape_route"),
    ),
    "Lamps and plates": (
        "Many LEDs with lenses, whose light adds up, and the one part that holds them ([lamps and plates](plates.md)).",
        ("backlight", "backlight_plate", "backlight_rim", "high_bay", "panel", "street_module", "floodlights"),
    ),
    "LEDs and colours": (
        "Ray files, chips, interchangeable LEDs, and one colour ([the LED](sources.md), [several LEDs](leds.md)).",
        ("led_rayfile", "osram_pi", "chip_array", "second_source", "led_colours", "rgbw", "white_two_files"),
    ),
    "States": (
        "One lens for several conditions, such as spot and flood of a zoom ([states](states.md)).",
        ("stage_zoom", "zoom_torch", "matrix_beam", "hot_and_cold"),
    ),
    "Frosted faces": (
        "Faces that scatter hide chips; the search knows what they do ([frosted faces](leds.md#frosted-faces)).",
        ("frosted_spot", "soft_panel", "printed"),
    ),
    "For the shop": (
        "Cutters, moulds that exist, tolerances, and a lens that was made ([to the shop](shop.md)).",
        ("flat_top_milled", "robust_pi", "fixed_inner", "fixed_outer", "fixed_step_face", "made_lens"),
    ),
    "Materials and covers": (
        "Other materials, coatings, given optics around the lens, and a housing in its light"
        " ([materials](sources.md#materials-and-temperature)).",
        ("silicone", "coated_cover_glass", "domed_cover", "bezel", "uvc_handle", "uvc_wall"),
    ),
    "The paper's designs": (
        "Designs of the paper whose method this is ([figures](validation.md#of-the-paper)).",
        ("flat_top", "flat_top_compact", "pi", "plus"),
    ),
    "Designs of other papers": (
        "Repeated with LED, size and target as far as these are stated ([compared](validation.md#of-other-papers)).",
        (
            "published/rectangle_2mm", "published/rectangle_3mm", "published/compact_rectangle",
            "published/compact_one_axis", "published/circle", "published/street", "published/two_numerals",
        ),
    ),
}  # fmt: skip
HEAD = """# Gallery

Every shipped spec, its light, and what it shows. `lensforge examples NAME` copies a spec, with the files that it
names, into the folder that you are in.

The pictures are of drafts, {rays:,} rays, or more where a spec states them (`python docs/make_gallery.py`, a minute
each). Finished lenses are better: [validation](validation.md#designs).

Scripts: `examples/design_to_step.py`, from objects to a STEP file; `examples/faces_to_step.py`, a TIR lens from four
given faces, traced, exported and proven. Notebooks: [a first lens and its light](notebooks/first_light.ipynb), [size
against efficiency](notebooks/size_against_efficiency.ipynb), [a target of your own](notebooks/own_target.ipynb).
"""


def names() -> list[str]:
    """All specs of the gallery, as paths in examples/ without their suffix."""
    return [name for _, group in GROUPS.values() for name in group]


def sentence(name: str) -> str:
    """The comment at the head of a spec, as one paragraph."""
    head = (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8").split("\nname = ")[0]
    return " ".join(line.lstrip("# ") for line in head.splitlines()).replace("|", "\\|")


def picture(name: str) -> Path:
    """Place of the picture of a spec."""
    return PICTURES / f"{Path(name).name}.png"


def draw(name: str) -> dict[str, object]:
    """Design a draft, draw its light in each state, on each receiver and on bodies, and return its figures."""
    import lensforge as lf
    from lensforge.report.body_figures import lit_body
    from lensforge.results.chart import light_unit
    from lensforge.scene.body_view import body_views

    spec = lf.load_spec(EXAMPLES / f"{name}.toml")
    if spec.optimise.seconds is not None:  # the same draft on every machine, not as much as a time allows
        spec = spec.replace({"optimise.seconds": None})
    rays = max(RAYS, spec.evaluate.rays or 0)
    light = lf.evaluate(lf.design(spec, accuracy="draft", force=True).lens, rays=rays)
    panels = []
    cases = list(light.cases("receivers"))
    unit = light_unit(light.lumens_per_watt)
    figures = [case.result.plot(receiver=case.record.name).figure for case in cases]
    for view, body in zip(body_views(spec), light.on_bodies, strict=True):
        figures.append(lit_body(view, body.irradiance, unit, "lit"))
    for figure in figures:
        figure.set_size_inches(3.6, 2.8)
        buffer = BytesIO()
        figure.savefig(buffer, format="png", dpi=90, facecolor="white", bbox_inches="tight")
        panels.append(Image.open(buffer).convert("RGB"))
    sheet = Image.new("RGB", (sum(each.width for each in panels), max(each.height for each in panels)), "white")
    for index, each in enumerate(panels):
        sheet.paste(each, (sum(other.width for other in panels[:index]), 0))
    PICTURES.mkdir(exist_ok=True)
    sheet.quantize(64).save(picture(name), optimize=True)
    stated = light.figures or (light.limits if spec.applications or light.on_bodies else ())
    return {
        "accuracy": "draft",
        "aim": spec.optimise.aim,
        "figures": [[figure.label, figure.value, figure.unit] for figure in stated],
        "share_in_target": [case.record.share_in_target.value for case in cases],
        "nmse": [case.record.nmse.value for case in cases],
        "efficiency": [case.record.efficiency.value for case in cases],
    }


def square(picture: Image.Image) -> Image.Image:
    """A picture without its white border, in the middle of a white square."""
    whole = Image.new("RGBA", picture.size, "white")
    whole.alpha_composite(picture.convert("RGBA"))
    plain = whole.convert("RGB")
    plain = plain.crop(ImageChops.difference(plain, Image.new("RGB", plain.size, "white")).getbbox())
    plain.thumbnail((SIDE, SIDE), Image.Resampling.LANCZOS)
    found = Image.new("RGB", (SIDE, SIDE), "white")
    found.paste(plain, ((SIDE - plain.width) // 2, (SIDE - plain.height) // 2))
    return found


def save_small(name: str, cut: bytes, light: np.ndarray) -> None:
    """Put the lens, cut open, beside its light, row 0 of which is at the bottom."""
    colours = colormaps["inferno"](light[::-1] / np.quantile(light, 0.995), bytes=True)
    sheet = Image.new("RGB", (2 * SIDE + 8, SIDE), "white")
    for place, picture in enumerate((Image.open(BytesIO(cut)), Image.fromarray(colours))):
        sheet.paste(square(picture), (place * (SIDE + 8), 0))
    sheet.quantize(64).save(PICTURES / f"thumb_{name}.png", optimize=True)


def draw_small(name: str) -> None:
    """Design a draft, and save its small picture."""
    import lensforge as lf
    from lensforge.report.solid_view import solid_views

    spec = lf.load_spec(EXAMPLES / f"{name}.toml").replace({"optimise.seconds": None})
    lens = lf.design(spec, accuracy="draft", force=True).lens
    part = lf.build(lens)
    pictures = solid_views(part.stl, spec.constraints.max_radius_mm, part.plate_stl).pictures
    save_small(name, pictures.get("plate", pictures["cut"]), lf.evaluate(lens, rays=RAYS).receivers[0].map)


def figures_of(found: dict[str, Any]) -> str:
    """The figures of a design in words: those of its trade or of a class that it is to reach, if it has one.

    Where only the share of the light counts, an error of its pattern is none.
    """
    shares = ", ".join(f"{value:.3f}" for value in found["efficiency"])
    if found.get("figures"):
        stated = ", ".join(f"{label} {quantity(value, unit, digits=3)}" for label, value, unit in found["figures"])
        return f"{stated}, efficiency {shares}"
    if found.get("aim") == "share":
        return f"In the target {', '.join(f'{value:.3f}' for value in found['share_in_target'])}, efficiency {shares}"
    # Noise of the rays is taken off: what a file of few rays leaves may be below 0.
    errors = ", ".join(f"{value:.4f}" if value > 0.0 else "0 within its error" for value in found["nmse"])
    return f"NMSE {errors}, efficiency {shares}"


def page(figures: dict[str, dict[str, Any]]) -> str:
    """The page: a group for each heading, a spec for each row."""
    lines = [HEAD.format(rays=RAYS)]
    for title, (words, group) in GROUPS.items():
        lines += [f"## {title}", "", words, "", "| spec | its light |", "|---|---|"]
        for name in group:
            found = figures.get(name)
            drawn = f"![The light of {Path(name).name}](gallery/{Path(name).name}.png)" if found else ""
            values = f" *{figures_of(found)}.*" if found else ""
            link = f"[`{Path(name).name}`](../examples/{name}.toml)"
            lines.append(f"| {link}: {sentence(name)}{values} | {drawn} |")
        lines.append("")
    return "\n".join(lines)


def _stored() -> dict[str, dict[str, Any]]:
    return json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}


def main() -> None:
    """Draw what is missing, and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--page", action="store_true", help="write the page alone")
    parser.add_argument("--small", action="store_true", help="draw the small pictures of README alone")
    options = parser.parse_args()
    if options.small:
        for name in SMALL:
            draw_small(name)
    elif not options.page:
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
