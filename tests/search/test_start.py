"""A search that goes on from a finished lens which the spec names."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.scene.lens import Lens, load_lens
from lensforge.spec import Spec
from lensforge.surfaces.srbf import SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder that holds a lens."""
    folder = tmp_path_factory.mktemp("finished")
    inner = random_surface(1, 3.0, 0.03, (9, 25))
    outer = random_surface(2, 6.0, 0.03, (9, 25))
    Lens.double(inner, outer, small_spec(), 0, "draft").save(folder / "lens.json")
    return folder


def started(start: Path, **changes: object) -> Spec:
    return small_spec(lens__start=str(start), optimise__steps_per_level=(2, 2), **changes)


def test_the_search_goes_on_from_the_lens_of_the_folder(finished: Path) -> None:
    seen: list[lf.Progress] = []
    by_spec = lf.design(started(finished), accuracy=FEW, progress=seen.append)
    by_file = lf.design(started(finished / "lens.json"), accuracy=FEW)
    start = load_lens(finished / "lens.json")
    by_argument = lf.design(started(finished).replace(lens={"start": None}), accuracy=FEW, start=start)
    u = fibonacci_hemisphere(100)
    for other in (by_file, by_argument):
        assert np.array_equal(by_spec.lens.outer.radius(u), other.lens.outer.radius(u))
    assert seen[0].functions == 34, "all functions from the first step on"
    assert by_spec.steps == 2, "the last level alone"
    assert by_spec.inputs["file:lens.json"], "the start is an input of the search"


@pytest.mark.parametrize("levels", [[9, 25], [9, 25, 81]])
def test_other_levels_index_and_target_start_from_the_same_surfaces(finished: Path, levels: list[int]) -> None:
    spec = small_spec(
        lens__start=str(finished),
        lens__levels=levels,
        lens__refractive_index=1.585,
        target__distance_mm=40.0,
        optimise__steps_per_level=[2] * len(levels),
    )
    seen: list[lf.Progress] = []
    with pytest.raises(lf.Cancelled):
        lf.design(spec, accuracy=FEW, progress=lambda step: seen.append(step) or False)
    start = load_lens(finished / "lens.json")
    begun = seen[0].lens()
    u = fibonacci_hemisphere(500)
    for before, after in ((start.inner, begun.inner), (start.outer, begun.outer)):
        moved = np.abs(after.radius(u) - before.radius(u)).max()
        assert moved < 0.15 * np.ptp(before.radius(u)), "but for the first step"


def test_a_start_that_is_not_there_or_no_lens_is_one_line(finished: Path, tmp_path: Path) -> None:
    with pytest.raises(lf.InputError, match="no such file") as caught:
        lf.design(started(tmp_path), accuracy=FEW)
    assert "\n" not in str(caught.value)
    (tmp_path / "lens.json").write_text("{}", encoding="utf-8")
    with pytest.raises(lf.InputError, match=r"lens\.json") as caught:
        lf.design(started(tmp_path), accuracy=FEW)
    assert "\n" not in str(caught.value)


def test_automatic_levels_move_the_broad_functions_of_the_lens_first_and_keep_the_others(finished: Path) -> None:
    spec = small_spec(lens__start=str(finished)).with_automatic_levels()
    seen: list[lf.Progress] = []
    with pytest.raises(lf.Cancelled):
        lf.design(spec, accuracy=FEW, progress=lambda step: seen.append(step) or len(seen) < 3)
    assert [step.functions for step in seen] == [9, 9, 9]
    start = load_lens(finished / "lens.json")
    lens = seen[-1].lens()
    for before, after in ((start.inner, lens.inner), (start.outer, lens.outer)):
        assert isinstance(before, SrbfSurface) and isinstance(after, SrbfSurface)
        moved = np.abs(after.weights_mm - before.weights_mm)
        assert after.basis.levels == (9, 25) and moved[:9].min() > 1e-6
        assert np.array_equal(after.weights_mm[9:], before.weights_mm[9:])
    turned = Lens.double(*(_narrow_turned(surface) for surface in (start.inner, start.outer)), start.spec, 0, "draft")
    others: list[lf.Progress] = []
    with pytest.raises(lf.Cancelled):
        lf.design(spec, accuracy=FEW, start=turned, progress=lambda step: others.append(step) or False)
    assert others[0].nmse != seen[0].nmse, "the light is that of all functions"


def _narrow_turned(surface: Surface) -> SrbfSurface:
    assert isinstance(surface, SrbfSurface)
    return replace(surface, weights_mm=np.where(np.arange(34) < 9, 1.0, -1.0) * surface.weights_mm)
