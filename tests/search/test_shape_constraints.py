"""Curvature and draft in the search: closed forms, derivatives, and the manufacturing check, which shares no code."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from scenes import random_surface, small_spec, sphere, table_of

from lensforge.cad.patch import fit_patch
from lensforge.scene.lens import Lens
from lensforge.search.constraint_points import ChartOperator, RadiusJet, constraint_points, draft_sine, least_curvature
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.design_result import constraint_criteria
from lensforge.search.feasibility import measure_constraints
from lensforge.search.optimiser import search
from lensforge.shop.face_check import SAMPLE_NODES
from lensforge.shop.face_samples import AirSide, OpticalFace, least_draft_rad, sample_face
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces import surface as chart
from lensforge.surfaces.bicubic_table import TableGrid

OUTSIDE, INSIDE = 1, -1


@dataclass(frozen=True)
class Ellipsoid:
    axes: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def radius(self, u: np.ndarray) -> np.ndarray:
        scaled, shift = u / np.array(self.axes), np.array(self.centre) / np.array(self.axes)
        quadratic, linear = np.sum(scaled**2, axis=1), scaled @ shift
        return (linear + np.sqrt(linear**2 - quadratic * (shift @ shift - 1.0))) / quadratic

    def curvatures(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From the Gaussian and the mean curvature; convex is positive."""
        a2, b2, c2 = np.array(self.axes) ** 2
        point = self.radius(u)[:, None] * u - np.array(self.centre)
        support = 1.0 / np.sqrt(np.sum(point**2 / np.array([a2, b2, c2]) ** 2, axis=1))
        gauss = support**4 / (a2 * b2 * c2)
        mean = support**3 * (a2 + b2 + c2 - np.sum(point**2, axis=1)) / (2.0 * a2 * b2 * c2)
        deviator = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
        return mean - deviator, mean + deviator

    def normal_z(self, u: np.ndarray) -> np.ndarray:
        gradient = (self.radius(u)[:, None] * u - np.array(self.centre)) / np.array(self.axes) ** 2
        return gradient[:, 2] / np.linalg.norm(gradient, axis=1)


def watched(surface: Any, nodes: int) -> tuple[np.ndarray, ChartOperator, RadiusJet]:
    """Directions of the watched points, and a surface there, from a table of it."""
    grid = TableGrid(nodes)
    points = constraint_points(grid, "none")
    table = grid.coefficients(surface.radius(grid.sample_directions())[:, None]).reshape(grid.side, grid.side)
    watch = ChartOperator.of(grid, points, derivatives=True)
    return chart.to_sphere(points), watch, watch.jets(torch.from_numpy(table))[0]


def worst(found: torch.Tensor, expected: np.ndarray) -> float:
    return float(np.abs(found.numpy() - expected).max())


def test_curvature_and_draft_of_an_ellipsoid_converge_as_the_fourth_power_of_the_spacing() -> None:
    egg = Ellipsoid((1.0, 1.3, 0.8), (0.1, -0.05, 0.2))
    errors = []
    for nodes in (41, 81):
        u, watch, jet = watched(egg, nodes)
        low, high = egg.curvatures(u)
        inner = torch.hypot(watch.points.x, watch.points.y).numpy() < 1.0 - 1e-9  # rim points lie anywhere in a cell
        errors.append(
            [
                np.abs(least_curvature(jet, watch.points, OUTSIDE).numpy() - low)[inner].max(),
                np.abs(least_curvature(jet, watch.points, INSIDE).numpy() + high)[inner].max(),
                np.abs(draft_sine(jet, watch.points).numpy() - egg.normal_z(u)).max(),
            ]
        )
    assert max(errors[1]) < 2e-5
    orders = np.log2(np.array(errors[0]) / np.array(errors[1]))
    assert (orders > [3.5, 3.5, 3.0]).all()


def test_the_dimple_of_an_apple_is_a_saddle_that_the_cutter_sees() -> None:
    """The outer part of a torus whose tube (1.0) is wider than its ring (0.4): hollow along the parallels on top."""

    @dataclass(frozen=True)
    class Apple:
        tube: float = 1.0
        ring: float = 0.4

        def radius(self, u: np.ndarray) -> np.ndarray:
            sine, cosine = np.hypot(u[:, 0], u[:, 1]), u[:, 2]
            return self.ring * sine + np.sqrt(self.tube**2 - self.ring**2 * cosine**2)

    apple = Apple()
    u, watch, jet = watched(apple, 121)
    smooth = u[:, 2] < np.cos(0.25)  # the stalk is a corner
    off_axis = apple.radius(u) * np.hypot(u[:, 0], u[:, 1])
    across = (off_axis - apple.ring) / (apple.tube * np.maximum(off_axis, 1e-9))
    low, high = np.minimum(1.0 / apple.tube, across), np.maximum(1.0 / apple.tube, across)
    assert low[smooth].min() < -0.4
    assert np.abs(least_curvature(jet, watch.points, OUTSIDE).numpy() - low)[smooth].max() < 1e-3
    assert np.abs(least_curvature(jet, watch.points, INSIDE).numpy() + high)[smooth].max() < 1e-3


def shop_spec(**changes: Any) -> Spec:
    wishes = {
        "constraints__inner_concave_radius_mm": 2.5,
        "constraints__outer_concave_radius_mm": 4.0,
        "constraints__inner_draft_deg": 3.0,
        "constraints__outer_draft_deg": 2.0,
    }
    return small_spec(**(wishes | changes))


def test_the_derivative_is_finite_at_umbilics_and_at_the_apex() -> None:
    grid = TableGrid(24)
    constraints = AugmentedLagrangian.of(shop_spec(), grid)
    tables = [table_of(sphere(radius), grid).requires_grad_() for radius in (2.0, 6.0)]
    gradients = torch.autograd.grad(constraints.fields(*tables).sum(), tables)
    assert all(torch.isfinite(gradient).all() for gradient in gradients)


@pytest.mark.parametrize("symmetry", ["mirror_x", "rectangle", "square"])
def test_one_of_the_mirror_images_tells_all(symmetry: str) -> None:
    grid, surface = TableGrid(41), random_surface(3, 3.0, symmetry=symmetry)
    extremes = []
    for each in ("none", symmetry):
        watch = ChartOperator.of(grid, constraint_points(grid, each), derivatives=True)
        (jet,) = watch.jets(table_of(surface, grid))
        kappa, draft = least_curvature(jet, watch.points, INSIDE), draft_sine(jet, watch.points)
        extremes.append([float(v) for v in (kappa.min(), kappa.max(), draft.min(), jet.rho.min(), jet.rho.max())])
    assert extremes[0] == pytest.approx(extremes[1], rel=1e-9)


@pytest.mark.parametrize("make", ["part", "insert"])
def test_the_manufacturing_check_finds_the_same_curvature_and_draft(make: str) -> None:
    spec = shop_spec(manufacture={"make": make})
    lens = Lens(random_surface(1, 3.0, 0.01, (25,)), random_surface(2, 6.0, 0.01, (25,)), spec, 0, "draft")
    found = measure_constraints(lens)
    airs = (AirSide.INSIDE, AirSide.OUTSIDE) if make == "part" else (AirSide.OUTSIDE, AirSide.INSIDE)
    for name, surface, air, radius, draft in (
        ("inner", lens.inner, airs[0], 2.5, 3.0),
        ("outer", lens.outer, airs[1], 4.0, 2.0),
    ):
        samples = sample_face(OpticalFace(fit_patch(surface), air), SAMPLE_NODES)
        kappa = samples.lowest_curvature()
        assert getattr(found, f"{name}_curvature_margin_per_mm") - 1.0 / radius == pytest.approx(kappa, rel=1e-3)
        assert getattr(found, f"{name}_draft_margin_deg") + draft == pytest.approx(
            np.degrees(np.arcsin(samples.outward[:, 2].min())), abs=0.02
        )


def test_a_cavity_tighter_than_the_cutter_fails_its_criterion() -> None:
    spec = small_spec(constraints__inner_concave_radius_mm=3.5, constraints__inner_draft_deg=0.5)
    criteria = constraint_criteria(spec, measure_constraints(Lens(sphere(3.0), sphere(6.0), spec, 0, "draft")))
    failed = {criterion.name: criterion for criterion in criteria if not criterion.passed}
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
        constraints__inner_concave_radius_mm=3.5,
        constraints__inner_draft_deg=1.0,
        optimise__steps_per_level=[15, 15],
        optimise__rays=256,
        optimise__learning_rate=0.01,
    )
    found = search(spec, build_source(spec.source), accuracy="draft")
    inner = sample_face(OpticalFace(fit_patch(found.lens.inner), AirSide.INSIDE), SAMPLE_NODES)
    assert all(criterion.passed for criterion in found.criteria), [str(criterion) for criterion in found.criteria]
    assert -1.0 / inner.lowest_curvature() >= 3.5 * (1.0 - 1e-3)
    assert np.degrees(least_draft_rad(inner)) >= 1.0 - 0.01
    assert np.abs(found.lens.inner.weights_mm).max() > 1e-3, "it is a freeform"
