"""The envelope of a lens: height, largest wall and keep-out as limits of the search."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from keep_outs import ball, box, step_file
from presets import FAR
from scenes import hemisphere_directions, random_surface, small_spec, sphere

import lensforge as lf
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.constraint_points import ChartPoints, KeepOutExtent
from lensforge.search.design_result import constraint_criteria
from lensforge.search.feasibility import measure_constraints
from lensforge.search.optimiser import search
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces import step_file as step_reading
from lensforge.surfaces.surface import to_chart, to_sphere

BALL_MM = 1.0
CENTRE = np.array([0.5, 0.0, 0.8])
MARGIN_MM = 0.2
GROWTH_MM = MARGIN_MM + 2e-3  # and the error of the mesh


@pytest.fixture(autouse=True)
def own_files_are_read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """And not in a child process, which loads the CAD kernel for each: they are no strangers'."""

    def read_here(_: Path, folder: Path, *__: Any, **___: Any) -> None:
        step_reading._write_products(folder)

    monkeypatch.setattr(step_reading, "work_in_child", read_here)


@pytest.fixture(scope="module")
def ball_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return step_file(tmp_path_factory.mktemp("keep_out") / "ball.step", ball(BALL_MM, tuple(CENTRE)))


def kept_out(path: Path, margin_mm: float = MARGIN_MM, **changes: Any) -> Spec:
    return small_spec(constraints__keep_out=str(path), constraints__keep_out_margin_mm=margin_mm, **changes)


def ball_extent(u: np.ndarray, growth_mm: float) -> np.ndarray:
    along = u @ CENTRE
    under = along**2 - CENTRE @ CENTRE + (BALL_MM + growth_mm) ** 2
    return np.where(under >= 0.0, along + np.sqrt(np.maximum(under, 0.0)), 0.0)


def box_extent(u: np.ndarray, half: np.ndarray, centre: np.ndarray, growth_mm: float) -> np.ndarray:
    """The last place within the growth of a box, by bisection from afar: the distance is convex along a ray."""
    extent = np.zeros(len(u))
    for k, direction in enumerate(u):
        t = np.linspace(0.0, 6.0, 20_001)
        beyond = np.maximum(np.abs(t[:, None] * direction - centre) - half, 0.0)
        inside = np.flatnonzero(np.linalg.norm(beyond, axis=1) <= growth_mm)
        extent[k] = t[inside[-1]] if len(inside) else 0.0
    return extent


def test_the_extent_of_a_grown_ball_is_a_larger_ball(ball_file: Path, tmp_path: Path) -> None:
    u = hemisphere_directions(800)
    extent = KeepOutExtent.of(kept_out(ball_file)).along(u)
    assert np.abs(extent - ball_extent(u, GROWTH_MM)).max() < 3e-3
    assert (extent > ball_extent(u, MARGIN_MM) - 1e-6).all(), "the mesh is grown by its error, too"
    below = step_file(tmp_path / "below.step", ball(BALL_MM, (0.5, 0.0, -2.0)))
    assert not KeepOutExtent.of(kept_out(below)).along(u).any(), "it ends below z = 0"


def test_a_point_speaks_for_all_directions_within_its_spacing(ball_file: Path) -> None:
    """Of the largest extent on the disc of 0.02 of the chart around it, whose directions are drawn anew."""
    extent = KeepOutExtent.of(kept_out(ball_file))
    places = to_chart(hemisphere_directions(400, seed=4))
    of_cells = extent.at(ChartPoints.of(places, 0.02)).numpy()
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    for away in (0.0, 0.01, 0.02):
        for turn in turns:
            beside = places + away * np.array([np.cos(turn), np.sin(turn)])
            assert (of_cells > ball_extent(to_sphere(beside), MARGIN_MM) - 1e-3).all()
    assert of_cells.max() < np.linalg.norm(CENTRE) + BALL_MM + GROWTH_MM + 1e-3


def test_the_extent_of_a_grown_box_has_round_edges_and_corners(tmp_path: Path) -> None:
    half = np.array([0.8, 0.5, 0.3])
    centre = np.array([0.6, -0.2, 0.7])
    spec = kept_out(step_file(tmp_path / "led.step", box(tuple(2.0 * half), tuple(centre))), lens__symmetry="none")
    u = hemisphere_directions(150, seed=3)
    assert np.abs(KeepOutExtent.of(spec).along(u) - box_extent(u, half, centre, GROWTH_MM)).max() < 1e-3


def test_margins_of_spheres_are_those_of_geometry(ball_file: Path) -> None:
    spec = kept_out(ball_file, constraints__max_wall_mm=2.5, constraints__max_height_mm=5.0)
    margins = measure_constraints(Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft"))
    assert margins.largest_wall_margin_mm == pytest.approx(2.5 - 3.0, abs=1e-12)
    assert margins.height_margin_mm == pytest.approx(5.0 - 6.0, abs=1e-3)
    furthest = np.linalg.norm(CENTRE) + BALL_MM + GROWTH_MM
    assert margins.keep_out_clearance_mm == pytest.approx(3.0 - furthest, abs=2e-3)
    failed = [criterion.key for criterion in constraint_criteria(spec, margins) if not criterion.holds]
    assert failed == ["largest wall margin", "height margin"]


def test_height_and_largest_wall_of_a_freeform_are_those_of_its_points() -> None:
    spec = small_spec(constraints__max_wall_mm=2.5, constraints__max_height_mm=5.0)
    lens = Lens.double(random_surface(1, 3.0, 0.05), random_surface(2, 6.0, 0.05), spec, 0, "draft")
    u = hemisphere_directions(20_000)
    inner = lens.inner.radius(u)
    outer = lens.outer.radius(u)
    height = float((outer * u[:, 2]).max())
    wall = float((outer - inner).max())
    assert height < outer.max() - 0.1, "the furthest point is not the highest"
    margins = measure_constraints(lens)
    assert margins.height_margin_mm == pytest.approx(5.0 - height, abs=2e-3)
    assert margins.largest_wall_margin_mm == pytest.approx(2.5 - wall, abs=2e-3)


def test_a_search_that_starts_outside_its_envelope_ends_inside(tmp_path: Path) -> None:
    """The start is a cavity of 3 mm, 3 mm of wall and 6 mm of height; a package reaches 3.2 mm up."""
    path = step_file(tmp_path / "led.step", box((1.5, 1.0, 3.4), (0.3, 0.0, 1.4)))
    spec = kept_out(
        path,
        0.1,
        constraints__max_wall_mm=2.6,
        constraints__max_height_mm=5.7,
        optimise__steps_per_level=[30, 30],
        optimise__rays=256,
    )
    start = constraint_criteria(spec, measure_constraints(Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft")))
    missed = {criterion.key for criterion in start if not criterion.holds}
    assert missed == {"largest wall margin", "height margin", "keep out clearance"}
    result = search(spec, build_source(spec.source), accuracy=FAR)
    assert all(criterion.holds for criterion in result.criteria), [str(criterion) for criterion in result.criteria]
    u = hemisphere_directions(3000)
    inner = result.lens.inner.radius(u)
    outer = result.lens.outer.radius(u)
    assert (outer - inner).max() <= 2.6 and (outer * u[:, 2]).max() <= 5.7
    beyond = np.maximum(np.abs(inner[:, None] * u - [0.3, 0.0, 1.4]) - [0.75, 0.5, 1.7], 0.0)
    assert np.linalg.norm(beyond, axis=1).min() >= 0.1
    assert result.inputs["file:led.step"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_keep_out_that_no_cavity_holds_is_refused_before_the_search(tmp_path: Path) -> None:
    tall = step_file(tmp_path / "tall.step", box((1.0, 1.0, 7.0), (0.0, 0.0, 3.5)))
    begun: list[object] = []
    with pytest.raises(InputError, match=r"no lens meets all of .*keep_out = .*tall\.step") as no:
        lf.design(kept_out(tall), accuracy="draft", progress=begun.append)
    assert "\n" not in str(no.value) and not begun


def test_a_missing_file_is_named_before_the_search(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.step: no such file") as no:
        lf.design(kept_out(tmp_path / "absent.step"), accuracy="draft")
    assert "\n" not in str(no.value)
