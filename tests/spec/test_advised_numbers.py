"""Numbers that a refusal or a warning advises, put back into the spec: it holds with them, and a little short not."""

import re
from typing import Any

import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.light.lens_light import source_of
from lensforge.search.scene_check import SceneCheck
from lensforge.spec.feasible import require_base_around_cavity

SPHERE = {"levels": [9, 25], "outer": {"offset_mm": 6.0}, "inner": {"fixed": {"kind": "sphere", "radius_mm": 3.0}}}
RADIUS = "constraints__max_radius_mm"
GRID = {"kind": "grid", "columns": 3, "rows": 2}
FEET = {"number": 5, "diameter_mm": 3.0, "height_mm": 1.0, "circle_diameter_mm": 5.0}


def spec_of(changes: dict[str, Any]) -> None:
    """A spec, with the base that its part asks for."""
    spec = small_spec(**changes)
    require_base_around_cavity(spec.lens, spec.constraints, spec.base)


@pytest.mark.parametrize(
    ("changes", "before", "field"),
    [
        ({"constraints__cavity_radius_mm": 6.5}, "make it at least", RADIUS),
        ({"constraints__cavity_height_mm": 7.25}, "make it at least", RADIUS),
        ({"lens": SPHERE, "constraints__min_thickness_mm": 4.5}, "= 7: at least", RADIUS),
        ({"lens": SPHERE, "constraints__max_height_mm": 3.9}, "= 3.9: at least", "constraints__max_height_mm"),
        ({"constraints__cavity_radius_mm": 5.0, "base__diameter_mm": 9.5}, "allowed: above", "base__diameter_mm"),
        ({"base__feet": FEET, "base__diameter_mm": 16.0}, "must be above", "base__feet__circle_diameter_mm"),
        ({"base__kind": "none", "lamps": {**GRID, "pitch_mm": 13.3}}, "allowed: at least", "lamps__pitch_mm"),
        ({"base__diameter_mm": 16.7, "lamps": {**GRID, "pitch_mm": 15.0}}, "allowed: at least", "lamps__pitch_mm"),
    ],
)  # fmt: skip
def test_a_spec_with_the_number_that_its_refusal_names_is_one(changes: dict[str, Any], before: str, field: str) -> None:
    with pytest.raises(InputError) as refused:
        spec_of(changes)
    (advised,) = re.findall(rf"{before} ([0-9.]+)", str(refused.value))
    spec_of(changes | {field: 1.0001 * float(advised)})
    with pytest.raises(InputError):
        spec_of(changes | {field: 0.99 * float(advised)})


def warnings_of(radius_mm: float, **changes: Any) -> list[str]:
    spec = small_spec(constraints__max_radius_mm=radius_mm, base__kind="none", **changes)
    return list(SceneCheck.of(spec, source_of(spec)).warnings())


@pytest.mark.parametrize("stroke_mm", [9.0, 4.0])
def test_a_lens_as_large_as_a_warning_of_blur_names_has_no_such_blur(stroke_mm: float) -> None:
    cross = {"kind": "cross", "length_mm": 160.0, "stroke_mm": stroke_mm, "distance_mm": 100.0, "receiver_mm": 200.0}
    fine = {"target": cross, "optimise__pixels": 256, "evaluate__pixels": 512}
    (message,) = (line for line in warnings_of(7.0, **fine) if "blurs it" in line)
    (advised,) = re.findall(r"a larger lens \(>= ([0-9.]+) mm\)", message)
    assert not any("blurs it" in line for line in warnings_of(1.0001 * float(advised), **fine))
    assert any("blurs it" in line for line in warnings_of(0.99 * float(advised), **fine))
