"""Upper bounds against lenses: no light of a shipped scene exceeds them, whatever the lens."""

from pathlib import Path

import pytest

import lensforge as lf
from lensforge.scene.lens import Lens
from lensforge.search.scene_check import starting_surfaces
from lensforge.spec import Spec, load_spec

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.toml"))
SCENES = [path for path in EXAMPLES if "rayfile" not in path.read_text() and "osram" not in path.read_text()]
KINDS = ("batwing", "curved_screen", "coated_cover_glass", "two_distances")  # the others with the drafts, nightly


def require_possible(light: lf.Light) -> None:
    for each in light.receivers:
        for name in ("efficiency", "share_in_target"):
            found, most = getattr(each, name), getattr(each.possible, name)
            assert found.value <= most + 3.0 * (found.standard_error or 0.0), f"{each.name}: {name}"
        assert each.nmse.value >= each.possible.nmse - 3.0 * (each.nmse.standard_error or 0.0), each.name


def starting_lens(spec: Spec) -> Lens:
    return Lens(starting_surfaces(spec), spec, 0, "draft")


@pytest.mark.parametrize("path", [path for path in SCENES if path.stem in KINDS], ids=lambda path: path.stem)
def test_the_starting_lens_of_each_kind_of_scene_keeps_the_bounds(path: Path) -> None:
    require_possible(lf.evaluate(starting_lens(load_spec(path)), rays=2**13, pixels=32))


@pytest.mark.nightly("drafts of all shipped specs take half an hour")
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_a_draft_of_each_shipped_scene_keeps_the_bounds(path: Path) -> None:
    require_possible(lf.evaluate(lf.design(load_spec(path), accuracy="draft").lens))
