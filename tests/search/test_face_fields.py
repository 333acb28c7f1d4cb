"""Derivatives of curvature, draft and wall, in closed form, by differences; of means over mirror images, too."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scenes import random_surface, table_of
from torch import Tensor

from lensforge.search.constraint_points import ChartOperator, ChartPoints, RadiusJet
from lensforge.search.face_fields import draft_sine, least_curvature, wall_mm
from lensforge.search.parameters import ChartMirrors, mirror_mean, mirrored_light
from lensforge.surfaces.bicubic_table import TableGrid

PLACES = np.array([[0.0, 0.0], [0.3, -0.5], [-0.9, 0.1], [0.6, 0.8], [-0.2, -0.7]])


def random(*shape: int, seed: int = 0) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(size=shape)).requires_grad_()


@pytest.mark.parametrize("field", [least_curvature, draft_sine])
@pytest.mark.parametrize("sign", [1, -1])
def test_curvature_and_draft_have_the_slopes_of_differences(field: Callable[..., Tensor], sign: int) -> None:
    """By radius and all derivatives, at the apex and on the rim too, with sensitivities that differ; one is 0."""
    points = ChartPoints.of(PLACES)
    by = torch.tensor([1.0, -2.0, 0.5, 0.0, 3.0], dtype=torch.float64)

    def weighed(rho: Tensor, derivatives: Tensor) -> Tensor:
        return field(RadiusJet(rho, derivatives), points, sign) * by

    rho = (3.0 + random(5).detach().abs()).requires_grad_()
    assert torch.autograd.gradcheck(weighed, (rho, random(5, 5, seed=1)), eps=1e-6, atol=1e-7, rtol=1e-6)


def test_the_curvature_of_a_sphere_has_finite_slopes() -> None:
    """Both curvatures are the same there: the root of their difference has no slope."""
    rho = torch.full((5,), 4.0, dtype=torch.float64)
    derivatives = torch.zeros(5, 5, dtype=torch.float64)
    jet = RadiusJet(rho.requires_grad_(), derivatives.requires_grad_())
    curvature = least_curvature(jet, ChartPoints.of(PLACES), 1)
    np.testing.assert_allclose(curvature.detach().numpy(), 0.25, rtol=1e-9)
    slopes = torch.autograd.grad(curvature.sum(), (rho, derivatives))
    np.testing.assert_allclose(slopes[0].numpy(), -1.0 / 16.0, rtol=1e-9)
    assert all(torch.isfinite(slope).all() for slope in slopes)


def test_the_wall_has_the_slopes_of_differences() -> None:
    """Beyond reach along the ray, within it to the nearest point, crossed, and on the rim."""
    grid = TableGrid(24)
    operator = ChartOperator.of(grid, PLACES, derivatives=False)
    faces = [random_surface(1, 3.0, levels=(9,)), random_surface(2, 3.4, levels=(9,))]
    tables = torch.stack([table_of(face, grid) for face in faces]).requires_grad_()
    along = random(*tables.shape, seed=3).detach()

    def walls(size: float, reach_mm: float) -> Tensor:
        inside, outside = operator.jets(tables + size * along)
        return wall_mm(inside, outside, operator.points, reach_mm)

    for reach_mm in (0.01, 5.0):
        for k in range(len(PLACES)):
            (slope,) = torch.autograd.grad(walls(0.0, reach_mm)[k], tables)
            ends = [walls(sign * 1e-6, reach_mm)[k].item() for sign in (1.0, -1.0)]
            assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(float((slope * along).sum()), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("symmetry", ["none", "mirror_x", "mirror_y", "rectangle", "diagonal", "square"])
def test_means_over_mirror_images_have_the_slopes_of_differences(symmetry: str) -> None:
    assert torch.autograd.gradcheck(lambda grid: mirror_mean(grid, symmetry), (random(4, 4),))


@pytest.mark.parametrize("mirrors", [(((-1, 0), (0, 1)),), (((0, 1), (1, 0)), ((0, -1), (1, 0)))])
def test_means_of_mirrored_light_have_the_slopes_of_differences(mirrors: ChartMirrors) -> None:
    """Also after a quarter turn, whose way back is another."""
    assert torch.autograd.gradcheck(lambda image: mirrored_light(image, mirrors), (random(4, 4),))
