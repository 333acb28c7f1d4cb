"""Parameters, tables and constraints of a lens of four faces: those of a face are as for that face alone."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import random_surface, small_spec, sphere

from lensforge.scene.lens import Lens
from lensforge.search.constraints import AugmentedLagrangian, Constraint
from lensforge.search.parameters import SphereParameters

NAMES = ("cap", "side", "wall", "exit")
SCALE_MM = torch.tensor([3.0, 3.5, 6.0, 6.5], dtype=torch.float64)


def four() -> tuple[SphereParameters, torch.Tensor, torch.Tensor]:
    """Four faces, the third of them fixed, and parameters that are not round."""
    usual = SphereParameters.of(small_spec(), 2.5)
    rng = np.random.default_rng(0)
    faces = replace(usual, names=NAMES, scale_mm=SCALE_MM, fixed=(None, None, sphere(6.2), None))
    weights = torch.from_numpy(rng.normal(size=(usual.basis.size, 4)) * 0.01)
    return faces, weights, torch.tensor([1.0, 1.1, 1.0, 0.9], dtype=torch.float64)


def of_one(faces: SphereParameters, number: int) -> SphereParameters:
    """The parameters of one face alone."""
    scale_mm = faces.scale_mm[number : number + 1]
    fixed = faces.fixed[number : number + 1]
    return replace(faces, names=faces.names[number : number + 1], scale_mm=scale_mm, fixed=fixed)


def test_each_face_has_the_table_and_the_gradient_that_it_has_alone() -> None:
    faces, weights, offsets = four()
    weights.requires_grad_()
    tables = faces.tables(weights, offsets)
    assert tables.shape == (4, faces.grid.side, faces.grid.side) and tables.is_contiguous()
    by = torch.from_numpy(np.random.default_rng(1).normal(size=tables.shape))
    (gradient,) = torch.autograd.grad((by * tables).sum(), weights)
    for number in range(4):
        column = weights.detach()[:, number : number + 1].clone().requires_grad_()
        alone = of_one(faces, number).tables(column, offsets[number : number + 1])
        assert torch.equal(alone[0], tables[number])
        if faces.fixed[number] is None:
            (by_own,) = torch.autograd.grad((by[number] * alone[0]).sum(), column)
            assert torch.equal(by_own[:, 0], gradient[:, number])
    assert not gradient[:, 2].any(), "the fixed face"


def test_a_lens_has_the_faces_by_their_names_and_gives_their_parameters_back() -> None:
    faces, weights, offsets = four()
    lens = faces.lens(weights, offsets, small_spec(), 0, "draft")
    assert tuple(lens.surfaces) == NAMES and lens.surfaces["wall"] is faces.fixed[2]
    turned = Lens(dict(reversed(lens.surfaces.items())), lens.spec, 0, "draft")
    for design in (lens, turned):
        coefficients, places = faces.parameters_of(design)
        free = [0, 1, 3]
        np.testing.assert_allclose(coefficients[:, free].numpy(), weights[:, free].numpy(), rtol=1e-14)
        np.testing.assert_allclose(places[free].numpy(), offsets[free].numpy(), rtol=1e-14)
        assert not coefficients[:, 2].any() and places[2] == 1.0


@pytest.mark.parametrize("between", [("cap", "exit"), ("side", "wall")])
def test_a_wall_is_between_the_two_faces_that_it_names(between: tuple[str, str]) -> None:
    usual = AugmentedLagrangian.of(small_spec(constraints__min_thickness_mm=3.5), (grid := four()[0].grid))
    surfaces = [random_surface(seed, float(radius), 0.02, (9, 25)) for seed, radius in enumerate(SCALE_MM)]
    tables = torch.from_numpy(
        np.stack([grid.coefficients(surface.radius(grid.sample_directions())[:, None]) for surface in surfaces])
    ).reshape(4, grid.side, grid.side)
    numbers = [NAMES.index(name) for name in between]
    inside, outside = between

    def renamed(constraint: Constraint) -> Constraint:
        names = {"inner": inside, "outer": outside}
        return replace(constraint, faces=tuple(replace(face, name=names[face.name]) for face in constraint.faces))

    named = replace(usual, names=NAMES, constraints=tuple(map(renamed, usual.constraints)))
    assert [constraint.names for constraint in named.constraints] == [(inside,), between, (outside,)]
    fields = named.fields(tables)
    assert torch.equal(fields, usual.fields(tables[numbers]))
    assert (fields[1] < 0.0).any() and (fields[1] > 0.0).any() == (inside == "cap")
