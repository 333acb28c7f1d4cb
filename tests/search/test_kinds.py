"""Lenses of several kinds in one search: the sum of their light, what each keeps, and a whole search."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from presets import FEW
from scenes import random_surface, small_spec, sphere, table_of
from search_scenes import Stop

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.design_result import Progress
from lensforge.search.feasibility import measure_constraints
from lensforge.search.merit import MeritFunction
from lensforge.search.problem import Problem, Problems
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.search.searches_in_turn import search_in_turn
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import TableGrid

GRID = {"kind": "grid", "columns": 3, "rows": 3, "pitch_mm": 20.0}
NEAR = {
    "base": {"kind": "none"},
    "target": {
        "kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "distance_mm": 12.0, "receiver_mm": 80.0,
        "uniform_mm": 60.0,
    },
}  # fmt: skip
ONE_LEVEL = {"lens__levels": [9], "optimise__steps_per_level": [14], "optimise__rays": 4096}


def spec_of(kinds: str = "place", **changes: Any) -> Spec:
    return small_spec(**{**NEAR, "lens__symmetry": "auto", "lamps": {**GRID, "kinds": kinds}, **changes})


def problem_of(spec: Spec) -> Problem:
    source = build_source(spec.source, None)
    return Problems(settled_symmetry(spec, source), source, 3.0, None).of((9, 25))


def light_on(problem: Problem, weights: torch.Tensor, offsets: torch.Tensor, rays: int = 2**17) -> np.ndarray:
    merit = problem.merit
    assert isinstance(merit, MeritFunction)
    sample = build_source(problem.spec.source, None).sample(rays, 5)
    return merit.light_of(merit.parametrisation.tables(weights, offsets), sample).images[0].numpy()


def test_equal_kinds_have_the_light_and_the_constraints_of_one_lens() -> None:
    problem = problem_of(spec_of("one"))
    three = problem_of(spec_of())
    weights = 0.02 * torch.from_numpy(np.random.default_rng(0).normal(size=(34, 2)))
    offsets = torch.tensor([1.0, 1.1], dtype=torch.float64)
    # of one function that has all mirrors by itself, so that the lens is the same in every kind
    weights[1:] = 0.0
    alone = light_on(problem, weights, offsets)
    together = light_on(three, weights.repeat(1, 3), offsets.repeat(3))
    coarse = [image.reshape(8, -1, 8, image.shape[1] // 8).sum(axis=(1, 3)) for image in (alone, together)]
    np.testing.assert_allclose(coarse[1], coarse[0], atol=0.01 * coarse[0].max())
    np.testing.assert_allclose(together, together[::-1], atol=1e-12 * together.max())


def test_each_kind_has_the_constraints_of_its_lens_alone() -> None:
    """Three lenses of crooked faces, each by itself as the only one: the same fields, lens by lens."""
    spec = spec_of(lens__symmetry="none")
    grid = TableGrid(33)
    tables = torch.stack([table_of(random_surface(k, (2.5, 6.0)[k % 2], 0.02, (9,)), grid) for k in range(6)])
    three = AugmentedLagrangian.of(spec, grid)
    alone = replace(three, lenses=1)
    fields = three.fields(tables)
    for lens, of_lens in enumerate(fields.chunk(3)):
        torch.testing.assert_close(of_lens, alone.fields(tables[2 * lens : 2 * lens + 2]))
    least = [alone.least(of_lens) for of_lens in fields.chunk(3)]
    assert three.least(fields) == {key: min(values[key] for values in least) for key in three.keys}


@pytest.mark.parametrize(
    ("changes", "of_sum", "of_lenses"),
    [
        ({}, "square", ["square", "mirror_y", "diagonal"]),
        ({"lens__symmetry": "none"}, "none", ["none"] * 3),
        ({"target__height_mm": 40.0, "target__uniform_mm": 40.0}, "rectangle", ["rectangle", "mirror_y", "diagonal"]),
        ({"source": {"kind": "rectangle", "width_mm": 2.0, "height_mm": 1.0}}, "none", ["none"] * 3),
        ({"source__position_mm": [0.3, 0.0, 0.0]}, "none", ["none"] * 3),
    ],
)
def test_each_lens_has_the_mirrors_of_its_kind(changes: dict[str, Any], of_sum: str, of_lenses: list[str]) -> None:
    """An oblong LED at a corner has no mirror about the diagonal, so that nothing is left of the sum's."""
    problem = problem_of(spec_of(**changes))
    assert problem.spec.lens.symmetry == of_sum
    weights = torch.from_numpy(0.01 * np.random.default_rng(1).normal(size=(34, 6)))
    lens = problem.parametrisation.lens(weights, torch.tensor(3 * [1.0, 1.1]), problem.spec, 0, "draft")
    assert [kind.symmetry for kind in lens.kinds] == of_lenses


ROW = {"lamps": {**GRID, "rows": 1, "kinds": "place"}, "target__height_mm": 20.0, "target__uniform_mm": 20.0}


def test_a_search_from_one_lens_lights_the_ends_better(tmp_path: Path) -> None:
    """Interrupted among the kinds, it goes on to the same bits."""
    spec = spec_of(**ONE_LEVEL, **ROW)
    path = tmp_path / "search.bin"
    heard = list[int]()
    source = build_source(spec.source, None)

    def stop(now: Progress) -> None:
        heard.append(now.steps_done)
        if now.steps_done == 24:
            raise Stop

    with pytest.raises(Stop):
        search_in_turn(spec, source, accuracy=FEW, checkpoint=path, progress=stop)
    assert heard == list(range(1, 25))
    result = search_in_turn(spec, source, accuracy=FEW, checkpoint=path, resume=True)
    assert search_in_turn(spec, source, accuracy=FEW).lens.sha256 == result.lens.sha256
    one, kinds = result.history
    assert (result.steps, one.level, kinds.level) == (28, 0, 1)
    assert np.mean(kinds.nmse[-3:]) < 0.9 * np.mean(one.nmse[-3:])
    assert all(criterion.holds for criterion in result.criteria)


def test_the_margins_are_the_least_of_all_kinds() -> None:
    inner = (2.4, 2.6, 2.5)
    outer = (6.0, 6.2, 6.4)
    faces = [
        {"inner": sphere(inner_mm), "outer": sphere(outer_mm)} for inner_mm, outer_mm in zip(inner, outer, strict=True)
    ]
    spec = spec_of(lens__symmetry="square", constraints__max_radius_mm=6.3)
    lens = Lens(faces[0], spec, 0, "draft", others={"edge": faces[1], "corner": faces[2]})
    margins = measure_constraints(lens, 500)
    limits = spec.constraints
    assert margins.wall_margin_mm == pytest.approx(3.6 - limits.min_thickness_mm, abs=1e-6)
    assert margins.radius_margin_mm == pytest.approx(6.3 - 6.4)
    alone = measure_constraints(replace(lens, others={}, spec=spec_of("one")), 500)
    assert margins.cavity_clearance_mm == alone.cavity_clearance_mm


def test_a_symmetry_that_the_led_lacks_is_refused() -> None:
    changes = {"source": {"kind": "rectangle", "width_mm": 2.0, "height_mm": 1.0}, "lens__symmetry": "rectangle"}
    with pytest.raises(InputError, match="'diagonal': the source has only 'rectangle'"):
        problem_of(spec_of(**changes))
