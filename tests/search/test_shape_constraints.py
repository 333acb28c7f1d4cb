"""Curvature and draft in the search: closed forms, derivatives, and the manufacturing check, which shares no code."""

from typing import Any

import numpy as np
import pytest
import torch
from nightly import first_by_day
from presets import FAR
from scenes import random_surface, small_spec, sphere

from lensforge.cad.patch import fit_patch
from lensforge.scene.lens import Lens
from lensforge.search.constraint_points import ChartOperator, RadiusJet, constraint_points
from lensforge.search.design_result import constraint_criteria
from lensforge.search.feasibility import measure_constraints
from lensforge.search.optimiser import search
from lensforge.shop.face_check import SAMPLE_NODES
from lensforge.shop.face_samples import AirSide, OpticalFace, least_draft_rad, sample_face
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces import surface as chart
from lensforge.surfaces.bicubic_table import TableGrid

OUTSIDE = 1
INSIDE = -1


def watched(surface: Any, nodes: int) -> tuple[np.ndarray, ChartOperator, RadiusJet]:
    """Directions of the watched points, and a surface there, from a table of it."""
    grid = TableGrid(nodes)
    points = constraint_points(grid, "none")
    table = grid.coefficients(surface.radius(grid.sample_directions())[:, None]).reshape(grid.side, grid.side)
    watch = ChartOperator.of(grid, points, derivatives=True)
    return chart.to_sphere(points), watch, watch.jets(torch.from_numpy(table)[None])[0]


def shop_spec(**changes: Any) -> Spec:
    wishes = {
        "lens__inner__concave_radius_mm": 2.5,
        "lens__outer__concave_radius_mm": 4.0,
        "lens__inner__draft_deg": 3.0,
        "lens__outer__draft_deg": 2.0,
    }
    return small_spec(**(wishes | changes))


@pytest.mark.parametrize("process", first_by_day(1, ["milled", "moulded"]))
def test_the_manufacturing_check_finds_the_same_curvature_and_draft(process: str) -> None:
    spec = shop_spec(manufacture={"process": process})
    lens = Lens.double(random_surface(1, 3.0, 0.01, (25,)), random_surface(2, 6.0, 0.01, (25,)), spec, 0, "draft")
    margins = measure_constraints(lens)
    airs = (AirSide.INSIDE, AirSide.OUTSIDE) if process == "milled" else (AirSide.OUTSIDE, AirSide.INSIDE)
    for name, surface, air, radius, draft in (
        ("inner", lens.inner, airs[0], 2.5, 3.0),
        ("outer", lens.outer, airs[1], 4.0, 2.0),
    ):
        samples = sample_face(OpticalFace(fit_patch(surface), air), SAMPLE_NODES)
        kappa = samples.lowest_curvature()
        assert margins.curvature_margin_per_mm[name] - 1.0 / radius == pytest.approx(kappa, rel=1e-3)
        assert margins.draft_margin_deg[name] + draft == pytest.approx(
            np.degrees(np.arcsin(samples.outward[:, 2].min())), abs=0.02
        )


def test_a_cavity_tighter_than_the_cutter_fails_its_criterion() -> None:
    spec = small_spec(lens__inner__concave_radius_mm=3.5, lens__inner__draft_deg=0.5)
    criteria = constraint_criteria(spec, measure_constraints(Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft")))
    failed = {criterion.key: criterion for criterion in criteria if not criterion.holds}
    assert set(failed) == {"inner curvature margin", "inner draft margin"}
    assert failed["inner curvature margin"].value == pytest.approx(1.0 / 3.5 - 1.0 / 3.0, abs=1e-9)
    assert failed["inner draft margin"].value == pytest.approx(-0.5, abs=1e-9)
    assert failed["inner curvature margin"].unit == "1/mm"


def test_a_design_for_a_cutter_passes_the_check_of_the_shop() -> None:
    """By what the check measures of the inner face.

    The start is a cavity of 3 mm; the cutter has 3.5 mm, and the mould wants a draft of 1 deg.
    """
    spec = small_spec(
        lens__symmetry="square",
        lens__inner__concave_radius_mm=3.5,
        lens__inner__draft_deg=1.0,
        optimise__steps_per_level=[15, 15],
        optimise__rays=256,
    )
    result = search(spec, build_source(spec.source), accuracy=FAR)
    inner = sample_face(OpticalFace(fit_patch(result.lens.inner), AirSide.INSIDE), SAMPLE_NODES)
    assert all(criterion.holds for criterion in result.criteria), [str(criterion) for criterion in result.criteria]
    assert -1.0 / inner.lowest_curvature() >= 3.5 * (1.0 - 1e-3)
    assert np.degrees(least_draft_rad(inner)) >= 1.0 - 0.01
    assert np.abs(result.lens.inner.weights_mm).max() > 1e-3, "it is a freeform"
