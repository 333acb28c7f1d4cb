"""Each word that a field of the spec may have changes a number, by hand here; a field without a row fails.

A few are tested where their number is made; of these the test is named.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest
from addon_rows import addon_rows
from picture_files import png
from pydantic import BaseModel
from scenes import small_spec, sphere
from scipy.special import ndtr
from scipy.stats import truncnorm

import lensforge as lf
from lensforge.cad.plate_layout import layout_of
from lensforge.light.judged_limits import limit_value
from lensforge.optics.efficacy import Efficacy
from lensforge.optics.pose import Pose
from lensforge.scene.eye_view import eye_views
from lensforge.scene.lens import Lens
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.perturbations import quantiles
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver_shapes import FarField, receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.shop.drawing import SIZES
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.spec.spec_reference import all_sections
from lensforge.spec.tolerances_section import Factor
from lensforge.surfaces.plane_loop import area_mm2
from lensforge.surfaces.srbf import SrbfBasis

TESTS = Path(__file__).parents[1]
Case = tuple[object, object]  # found, and by hand
PLACE = {"distance_mm": 100.0, "receiver_mm": 300.0}


def symmetry(name: str) -> Case:
    """Free weights of 81 functions that a mirror group joins, each with its images."""
    if name == "auto":
        lens = small_spec(lens__symmetry="auto", source__kind="square").lens
        return lens.symmetry, "auto"
    basis = SrbfBasis((9, 25), 1.75, name)
    u = np.array([[0.6, 0.3, np.sqrt(1.0 - 0.45)]])
    images = {"none": [], "mirror_x": [(-1, 1)], "mirror_y": [(1, -1)], "diagonal": ["swap"],
              "rectangle": [(-1, 1), (1, -1)], "square": [(-1, 1), (1, -1), "swap"]}[name]  # fmt: skip
    value = basis.evaluate(u)[0]
    kept = []
    for image in ((-1, 1), (1, -1), "swap"):
        moved = u[:, [1, 0, 2]] if image == "swap" else u * [*image, 1]
        if np.allclose(basis.evaluate(moved)[0], value, atol=1e-12):
            kept.append(image)
    return kept, images


def profile(name: str) -> Case:
    """Intensity at a quarter of the width, over that of the axis."""
    beam = lf.BeamTarget(fwhm_deg=40.0, profile=name, half_angle_deg=45.0)
    field = FarField(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), PixelGrid.square(1.2, 121))
    light = target_light((beam,), field)
    side = 2.0 * np.sin(np.radians(0.5 * 10.0))
    column = round(60 + side / 1.2 * 121)
    angle = np.degrees(2.0 * np.arcsin(0.5 * 1.2 * (column - 60) / 121))
    power = np.log(0.5) / np.log(np.cos(np.radians(20.0)))
    by_hand = {"flat": 1.0, "gaussian": 2.0 ** -((angle / 20.0) ** 2), "cosine": np.cos(np.radians(angle)) ** power}
    return float(light[60, column] / light[60, 60]), pytest.approx(by_hand[name], abs=5e-3)


def distribution(name: str) -> Case:
    """Share of the parts within half of the amount."""
    factor = Factor("a", "a", "mm", 1.0, 0.1, "spread", name, 1)
    deviations = np.abs(quantiles(factor, (np.arange(10_000) + 0.5) / 10_000))
    by_hand = {"uniform": 0.5, "normal": 2.0 * ndtr(1.0) - 1.0, "truncated": 2.0 * truncnorm(-2, 2).cdf(1.0) - 1.0}
    return float((deviations <= 0.5).mean()), pytest.approx(by_hand[name], abs=1e-3)


def preset(name: str) -> Case:
    tolerances = small_spec(tolerances={"preset": name}).part_tolerances
    amounts = [tolerances.tolerance(key).amount for key in ("gap_mm", "source_tilt_deg", "inner_form_um", "index")]
    return amounts, {"precision": [0.005, 0.2, 0.3, 0.0005], "standard": [0.02, 0.5, 1.0, 0.001],
                     "moulded": [0.025, 0.5, 2.0, 0.001]}[name]  # fmt: skip


def kinds(name: str) -> Case:
    """A row of three: the outer two are mirror images of each other."""
    lamps = {"kind": "grid", "columns": 3, "rows": 1, "pitch_mm": 20.0, "kinds": name}
    all_lamps = small_spec(lamps=lamps, base={"kind": "none"}, target__receiver_mm=200.0).all_lamps
    return sorted(len(kind.numbers) for kind in all_lamps.kinds), {"one": [], "place": [1, 2]}[name]


def ends(name: str) -> Case:
    """Distance from the middle of a linear lens of 50 mm at which light ends."""
    lens = lf.ExtrudedSection(length_mm=50.0, ends=name)
    return lens.drawn_half_mm, {"capped": 25.0, "free": np.inf}[name]


def lattice(name: str) -> Case:
    all_lamps = small_spec(lamps={"kind": "endless", "lattice": name, "pitch_mm": 100.0},
                       target__receiver_mm=100.0 if name == "rectangle" else None,
                       **({} if name == "rectangle" else _hexagonal())).all_lamps  # fmt: skip
    return all_lamps.period_mm, pytest.approx((100.0, 100.0 if name == "rectangle" else 100.0 * 3.0**0.5))


def _hexagonal() -> dict[str, Any]:
    disc = [{"kind": "disc", "diameter_mm": 20.0}]
    plane = {"kind": "plane", "centre_mm": [0.0, 0.0, 100.0], "width_mm": 100.0, "height_mm": 100.0 * 3.0**0.5}
    return {"target": None, "receivers": [{**plane, "targets": disc}]}


def base(name: str) -> Case:
    """Widest size of a body of that side."""
    section = lf.BaseSection(kind=name, **{"square": {"side_mm": 9.0}, "cylinder": {"diameter_mm": 9.0}}.get(name, {}))
    return section.widest_mm if name != "none" else 0.0, {"cylinder": 9.0, "square": 9.0 * 2.0**0.5, "none": 0.0}[name]


def plate(name: str) -> Case:
    """Area of the outline."""
    sizes = {"rectangle": {"width_mm": 30.0, "height_mm": 20.0}, "round": {"diameter_mm": 30.0}}[name]
    spec = small_spec(base={"kind": "none"}, plate={"kind": name, "thickness_mm": 1.0, **sizes})
    layout = layout_of(Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft"))
    assert layout is not None
    return area_mm2(layout.outline), pytest.approx({"rectangle": 600.0, "round": np.pi * 225.0}[name])


def unit(name: str) -> Case:
    """A picture of 0.5 mW a pixel, half in the zone, by an LED of 200 lm/W and 4.6 µmol/J; of eyes 1 W/(m² sr)."""
    if name.startswith(("w_per_m2_sr", "cd_per")):
        eyes = {"kind": "luminance", "eyes_deg": [[0, 0]], "spot_mm": 3.0, "unit": name, "at_most": 1.0}
        (view,) = eye_views(seen := small_spec().replace(limits=[eyes]))
        (limit,) = light_limits(seen, (), Efficacy(200.0), 1.0)
        ones = np.full((16, *view.grid.shape), view.pixel_measure)
        return limit_value(limit, ones).value, pytest.approx(200.0 if "cd" in name else 1.0)
    far = name in ("w_per_sr", "cd")
    beam, disc = {"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0}, {"kind": "disc", "diameter_mm": 50.0}
    target = beam if far else disc | PLACE
    place = {"at_deg": [[0.5, 0.5]]} if far else {"at_mm": [[5.0, 5.0]]}
    exposure = {"exposure_s": 60.0} if name == "mj_per_cm2" else {}
    spec = small_spec(target=target).replace(
        limits=[{"kind": "points", **place, "unit": name, "at_least": 0.1, **exposure}]
    )
    (receiver,) = receivers_of(spec, 30)
    picture = np.full((16, 30, 30), 5e-4)
    picture[:, :, 12:18] *= 0.5
    (limit,) = light_limits(spec, [receiver], Efficacy(200.0, 4.6), 1.0)
    pixel = (2.0 * 2.0 * np.sin(np.radians(30.0)) / 30) ** 2 if far else 1e-4  # sr, or m^2
    by_hand = {
        "w_per_m2": 2.5,
        "mw_per_cm2": 0.25,
        "mj_per_cm2": 15.0,
        "lx": 500.0,
        "umol_per_m2_s": 11.5,
        "w_per_sr": 2.5e-4 / pixel,
        "cd": 0.05 / pixel,
        "relative": 0.5,
    }[name]
    return limit_value(limit, picture).value, pytest.approx(by_hand, rel=1e-6)


def sheet(name: str) -> Case:
    return SIZES[name], {"A3": (420.0, 297.0), "A4": (297.0, 210.0)}[name]


def within(name: str) -> Case:
    return lf.ColourSection(within=name).level, {"fwhm": 0.5, "tenth": 0.1}[name]


def halves(folder: Path) -> Path:
    """A picture whose left half has a 16-bit grey of a quarter, the right one of 1."""
    grey = np.full((16, 16), 65535, dtype=np.uint16)
    grey[:, :8] = 16384
    (folder / "halves.png").write_bytes(png(grey, "grey", 16))
    return folder / "halves.png"


HALF = {"as_stored": 16384 / 65535, "srgb": ((16384 / 65535 + 0.055) / 1.055) ** 2.4}


def luminance(name: str, folder: Path) -> Case:
    target = lf.ImageTarget(file=halves(folder), width_mm=300.0, luminance=name, **PLACE)
    light = target_light((target,), receivers_of(small_spec(target=None, receivers=[_plane(target)]), 16)[0])
    return light[8, 2] / light[8, 13], pytest.approx(HALF[name], rel=1e-3)


def _plane(target: lf.ImageTarget) -> lf.PlaneReceiver:
    pattern = target.model_copy(update={"distance_mm": None, "receiver_mm": None})
    return lf.PlaneReceiver(centre_mm=(0.0, 0.0, 100.0), width_mm=300.0, height_mm=300.0, targets=(pattern,))


def emitting_luminance(name: str, folder: Path) -> Case:
    rays = build_source(lf.LuminanceSource(file=halves(folder), width_mm=6.0, luminance=name)).sample(2**14, 0)
    left = rays.flux[rays.origins[:, 0] < 0.0].sum() / rays.flux.sum()
    return left, pytest.approx(HALF[name] / (1.0 + HALF[name]), abs=2e-3)


CASES = {
    **addon_rows("CHOICES"), "symmetry": symmetry,
    "profile": profile, "distribution": distribution, "preset": preset, "kinds": kinds, "lattice": lattice,
    "ends": ends,
    "BaseSection.kind": base, "PlateSection.kind": plate, "within": within, "unit": unit, "sheet": sheet,
    "ImageTarget.luminance": luminance, "LuminanceSource.luminance": emitting_luminance,
}  # fmt: skip
ELSEWHERE = {  # where each value is one of a test's cases
    "axis": "sources/test_ray_set_numbers.py", "mirror": "sources/test_ray_set_numbers.py",
    "origin": "sources/test_ray_set.py", "coordinates": "surfaces/test_given_faces.py",
    **addon_rows("CHOSEN_ELSEWHERE"),
    "process": "spec/test_process.py", "use": "light/test_photometry.py", "aim": "search/test_smallest_lens.py",
    "size": "search/test_smallest_lens.py",
    "levels": "search/test_automatic_search.py", "over_sources": "search/test_several_sources.py",
    "LuminanceLimit.of": "light/test_luminance.py", "BodyLimit.of": "scene/test_body_view.py",
    "model": "sources/test_modelled_rays.py",
    **dict.fromkeys(
        tuple(f"{kind}surface" for kind in ("", "HousingBox.", "HousingCylinder.", "HousingFile.", "HousingRoom.")),
        "scene/test_wall_reflection.py",
    ),
    "robust": "search/test_share_of_parts.py", "application": "light/test_trade_figures.py",
}  # fmt: skip
DEFAULTS = {
    "use": "general",
    "aim": "pattern",
    "origin": "file",
    "BodyLimit.of": "patch",
}  # what every other test takes
OF_FILES = {("BaseSection.kind", "step"), ("PlateSection.kind", "step")}  # in cad/test_custom_base.py and of outlines


def choices() -> Iterator[tuple[str, str]]:
    """Fields of more than one word, and each word; fields of one name with other words have their section's."""
    known: dict[str, set[tuple[str, ...]]] = {}
    rows = [(section, name, literal) for section in all_sections(Spec) for name, field in section.model_fields.items()
             for literal in literals(field.annotation)]  # fmt: skip
    for _, name, values in rows:
        known.setdefault(name, set()).add(values)
    for section, name, values in rows:
        if len(values) > 1 or name != "kind":
            plain = len(known[name]) == 1 and name not in ("luminance", "lighting_class")
            yield from ((name if plain else f"{section.__name__}.{name}", word) for word in values)


def literals(annotation: object) -> Iterator[tuple[str, ...]]:
    if get_origin(annotation) is Literal:
        yield get_args(annotation)
    for part in get_args(annotation):
        if get_origin(part) is not None or (isinstance(part, type) and not issubclass(part, BaseModel)):
            yield from literals(part)


@pytest.mark.parametrize(("field", "word"), sorted(set(choices())))
def test_every_word_changes_a_number(field: str, word: str, tmp_path: Path) -> None:
    if field in ELSEWHERE:
        text = (TESTS / ELSEWHERE[field]).read_text(encoding="utf-8")
        assert f'"{word}"' in text or DEFAULTS.get(field) == word
    elif (field, word) not in OF_FILES:
        case = CASES[field]
        value, wanted = case(word, tmp_path) if field.endswith("luminance") else case(word)
        assert value == wanted
