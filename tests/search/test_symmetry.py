"""The symmetry that a scene has is found, and none that it has not."""

import pytest
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.search.optimiser import search
from lensforge.search.symmetry import settled_symmetry
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.planar_emitter import planar_emitter
from lensforge.spec import Spec
from lensforge.spec.source_sections import RectangleSource

PLACE = {"distance_mm": 100.0, "receiver_mm": 200.0}
OBLONG = planar_emitter(RectangleSource(kind="rectangle", width_mm=1.0, height_mm=0.5))


def _scene(target: dict) -> Spec:
    return small_spec(lens__symmetry="auto", optimise__pixels=64, target={**target, **PLACE})


@pytest.mark.parametrize(
    ("target", "source", "symmetry"),
    [
        ({"kind": "flat_top", "half_width_mm": 80.0}, SquareEmitter(1.0), "square"),
        ({"kind": "flat_top", "half_width_mm": 80.0}, OBLONG, "rectangle"),
        ({"kind": "cross", "length_mm": 120.0, "stroke_mm": 40.0}, SquareEmitter(1.0), "square"),
        ({"kind": "text", "text": "L", "width_mm": 50.0}, SquareEmitter(1.0), "none"),
        ({"kind": "text", "text": "E", "width_mm": 50.0}, OBLONG, "none"),  # its bars are not quite alike
    ],
)
def test_auto_is_the_largest_that_source_and_target_share(target: dict, source, symmetry: str) -> None:
    assert settled_symmetry(_scene(target), source).lens.symmetry == symmetry


def test_a_fixed_surface_limits_the_symmetry() -> None:
    inner = {"kind": "biconic", "vertex_z_mm": 3.0, "radius_x_mm": -3.0, "radius_y_mm": -2.9}
    lens = {"levels": [9, 25], "fixed_inner": inner, "outer_offset_mm": 6.0}
    target = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "edge_mm": 5.0, **PLACE}
    found, wanted = (
        small_spec(optimise__pixels=64, target=target, lens=lens | {"symmetry": each}) for each in ("auto", "square")
    )
    assert settled_symmetry(found, SquareEmitter(1.0)).lens.symmetry == "rectangle"
    with pytest.raises(InputError, match=r"'square': lens.fixed_inner is not symmetric in this way"):
        settled_symmetry(wanted, SquareEmitter(1.0))


def test_a_lens_records_the_symmetry_that_was_found() -> None:
    lens = search(small_spec(lens__symmetry="auto"), SquareEmitter(1.0), accuracy="draft").lens
    assert lens.spec.lens.symmetry == "square" == lens.outer.basis.symmetry
