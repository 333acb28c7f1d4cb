"""Parameters of profiles that are drawn along y: their gradient, their round trip through faces, their symmetry."""

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.light.lens_light import searched_source
from lensforge.scene.lens import Lens
from lensforge.search.drawn_profiles import DrawnParameters
from lensforge.search.problem import Problem, Problems
from lensforge.search.start_faces import light_across, start_faces
from lensforge.surfaces.bicubic_table import tabulate
from lensforge.surfaces.drawn_profile import DrawnFace

LENS = {"kind": "extruded", "length_mm": 24.0, "profile": 9}
ASIDE = {"kind": "rectangle", "width_mm": 80.0, "height_mm": 60.0, "centre_mm": [40.0, 10.0], "distance_mm": 90.0,
         "receiver_mm": 240.0}  # fmt: skip


def problem(symmetry: str = "none") -> Problem:
    spec = small_spec(lens=LENS | {"symmetry": symmetry}, base={"kind": "none"}, target=ASIDE,
                      optimise__steps_per_level=[1])  # fmt: skip
    return Problems(spec, searched_source(spec), 4.0, None).of(())


def test_the_gradient_is_that_of_differences() -> None:
    """Through constraints, image and tracer, for coefficients and offsets of both profiles."""
    here = problem()
    rng = np.random.default_rng(0)
    weights = torch.from_numpy(0.01 * rng.normal(size=(9, 2))).requires_grad_()
    offsets = torch.tensor([1.0, 1.1], dtype=torch.float64, requires_grad=True)
    ways = torch.from_numpy(rng.normal(size=(9, 2))), torch.from_numpy(rng.normal(size=2))
    rays = searched_source(here.spec).sample(1024, 1)

    def loss(by: float, which: int) -> torch.Tensor:
        moved = [weights, offsets]
        moved[which] = moved[which] + by * ways[which]
        return here.merit.step_loss(*moved, rays, here.constraints, True, ()).loss

    for which, parameter in enumerate((weights, offsets)):
        (gradient,) = torch.autograd.grad(loss(0.0, which), parameter)
        with torch.no_grad():
            change = (loss(1e-7, which) - loss(-1e-7, which)).item() / 2e-7
        assert change == pytest.approx((gradient * ways[which]).sum().item(), rel=1e-3)


@pytest.mark.parametrize("symmetry", ["none", "rectangle"])
def test_faces_come_back_from_their_parameters(symmetry: str) -> None:
    parametrisation = problem(symmetry).parametrisation
    assert isinstance(parametrisation, DrawnParameters)
    weights = torch.from_numpy(0.02 * np.random.default_rng(1).normal(size=(9, 2)))
    offsets = torch.tensor([1.05, 0.95], dtype=torch.float64)
    surfaces = parametrisation.surfaces(weights, offsets)
    for name, table in zip(surfaces, parametrisation.tables(weights, offsets), strict=True):
        surface = surfaces[name]
        assert isinstance(surface, DrawnFace)
        assert np.allclose(tabulate(parametrisation.grid, surface), table.numpy(), rtol=1e-12)
        assert (surface.symmetry == "rectangle") == (symmetry == "rectangle")
    lens = Lens(surfaces, problem(symmetry).spec, 0, "draft")
    again = parametrisation.surfaces(*parametrisation.parameters_of(lens))
    angles = np.linspace(-1.5, 1.5, 50)
    for name, surface in surfaces.items():
        known, copy = surface, again[name]
        assert isinstance(known, DrawnFace) and isinstance(copy, DrawnFace)
        assert np.allclose(known.points(angles), copy.points(angles), rtol=1e-12)


def test_the_start_sends_as_much_light_to_each_side_as_is_wanted_there() -> None:
    """All of it to the side of a target beside the axis, in the order of its angles."""
    spec = problem().spec
    across = light_across(spec)
    turned = across.turned(np.radians([-60.0, -30.0, 0.0, 30.0, 60.0]))
    assert (np.diff(turned) > 0.0).all() and turned[0] > -0.05 and turned[-1] < np.arctan(85.0 / 90.0)
    assert turned[2] == pytest.approx(np.arctan(40.0 / 90.0), abs=0.06)
    outer = start_faces(spec)["outer"]
    assert isinstance(outer, DrawnFace) and outer.symmetry == "mirror_y"
