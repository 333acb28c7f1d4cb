"""A design with one surface fixed: only the other moves, and every stage takes the pair."""

import numpy as np
import pytest
import torch
from nightly import first_by_day
from presets import FEW
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.light.simulation import TracedLens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.optimiser import search
from lensforge.search.parameters import SphereParameters
from lensforge.sources.build_source import build_source
from lensforge.surfaces.asphere import Asphere, sphere
from lensforge.surfaces.srbf import SrbfSurface

SPHERE = {"kind": "sphere", "radius_mm": 3.0, "centre_z_mm": -1.0}
DOME = {"kind": "asphere", "vertex_z_mm": 6.5, "radius_mm": -6.0, "conic_constant": -0.2, "coefficients": [-1e-5]}
FLAT = {"kind": "biconic", "vertex_z_mm": 3.0, "radius_x_mm": -3.0, "radius_y_mm": -3.0}
NARROW = {"radius_y_mm": -0.5, "conic_y": -5.0 / 6.0}  # 1.22 mm wide in y, 3 mm in x
LONG = {"kind": "asphere", "vertex_z_mm": 6.0, "radius_mm": -6.0, "coefficients": [2e-4]}
OUTSIDE = {"outer": {"offset_mm": 6.0}}
FIXED_INNER = {"lens": {"levels": [9, 25], "inner": {"fixed": SPHERE}, "outer": {"offset_mm": 6.0}}}
FIXED_OUTER = {"lens": {"levels": [9, 25], "inner": {"offset_mm": 3.0}, "outer": {"fixed": DOME}}}
SURFACES = {"inner": sphere(3.0, -1.0), "outer": Asphere(6.5, -6.0, -0.2, (-1e-5,))}


@pytest.mark.parametrize(("changes", "still"), first_by_day(1, [(FIXED_INNER, "inner"), (FIXED_OUTER, "outer")]))
def test_only_the_free_surface_moves(changes, still) -> None:
    spec = small_spec(**changes)
    lens = search(spec, build_source(spec.source), accuracy=FEW).lens
    moved = {"inner": lens.outer, "outer": lens.inner}[still]
    assert getattr(lens, still) == SURFACES[still]
    assert isinstance(moved, SrbfSurface)
    assert np.abs(moved.weights_mm).min() > 0.0
    assert moved.offset_mm != {"inner": 6.0, "outer": 3.0}[still]


def test_the_gradient_of_the_free_surface_is_right_and_that_of_the_fixed_one_nothing() -> None:
    parametrisation = SphereParameters.of(small_spec(**FIXED_INNER), 2.5)
    weights = torch.zeros(34, 2, dtype=torch.float64, requires_grad=True)
    offsets = torch.ones(2, dtype=torch.float64, requires_grad=True)
    inner, outer = parametrisation.tables(weights, offsets)
    (inner.sum() + outer.sum()).backward()
    assert (weights.grad[:, 0] == 0.0).all() and offsets.grad[0] == 0.0
    assert offsets.grad[1] == pytest.approx(6.0 * outer.numel())
    sums = [parametrisation.basis_tables.table(unit).sum() for unit in np.eye(34)]
    assert np.allclose(weights.grad[:, 1].numpy(), 6.0 * np.array(sums), rtol=1e-12)


def test_the_grid_resolves_a_fixed_face_that_is_narrower_than_all_functions() -> None:
    """A dome with a tip, 0.24 rad wide; the functions of the other face are wider."""
    tip = {"kind": "asphere", "vertex_z_mm": 6.0, "radius_mm": -0.2, "conic_constant": -2.0}
    lens = {"inner": {"offset_mm": 3.0}, "outer": {"fixed": tip}, "levels": [4]}
    free = {**lens, "outer": {"offset_mm": 6.0}}
    grid, alone = (
        SphereParameters.of(small_spec(lens=faces, optimise__steps_per_level=[1]), 4.0).grid for faces in (lens, free)
    )
    face = Asphere(6.0, -0.2, -2.0)
    assert 2.0 * grid.step <= face.detail_rad / 4.0 < 0.8 * (2.0 * alone.step)


def test_rays_refract_at_the_sphere_itself() -> None:
    """Snell's law at the fixed sphere and at a concentric one, in closed form."""
    spec = small_spec(**FIXED_INNER)
    lens = SphereParameters.of(spec, 2.5).lens(torch.zeros(34, 2).double(), torch.ones(2).double(), spec, 0, "draft")
    rays = build_source(spec.source).sample(2048, 3)
    landings = receivers_of(spec, 16)[0].land(TracedLens.of(lens, 12.0).trace(rays))
    at = rays.origins
    along = rays.directions
    for centre, radius, ratio in ((-1.0, 3.0, 1.0 / 1.4936), (0.0, 6.0, 1.4936)):
        from_centre = at - np.array([0.0, 0.0, centre])
        half = np.sum(from_centre * along, axis=1)
        at = at + (np.sqrt(half**2 - np.sum(from_centre**2, axis=1) + radius**2) - half)[:, None] * along
        normal = (at - np.array([0.0, 0.0, centre])) / radius
        cosine = np.sum(along * normal, axis=1)[:, None]
        along = ratio * along + (np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine) * normal
    hits = (at + ((100.0 - at[:, 2]) / along[:, 2])[:, None] * along)[:, :2]
    arrived = landings.landed & (np.linalg.norm(hits, axis=1) < 1000.0)
    assert arrived.sum() > 1500
    assert np.allclose(landings.hits[arrived], hits[arrived], rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize(
    ("lens", "constraints", "message"),
    [
        (
            {"outer": {"offset_mm": 6.0}, "inner": {"offset_mm": 3.0, "fixed": SPHERE}},
            {},
            r"lens\.inner: give one of offset_mm, .*, and fixed",
        ),
        (
            {"outer": {"fixed": DOME}, "inner": {"fixed": SPHERE}},
            {},
            "inner.fixed and outer.fixed: one of the faces must be free",
        ),
        (
            {"inner": {"offset_mm": 6.6}, "outer": {"fixed": DOME}},
            {},
            "lens: the vertex of outer.fixed = 6.5 must exceed",
        ),
        (OUTSIDE | {"inner": {"fixed": SPHERE | {"centre_z_mm": 3.5}}}, {}, "lens.inner.fixed: .*star-shaped"),
        (OUTSIDE | {"inner": {"fixed": SPHERE}}, {"cavity_height_mm": 2.5}, "inner.fixed cuts 0.5 mm into"),
        ({"inner": {"offset_mm": 3.0}, "outer": {"fixed": DOME}}, {"max_radius_mm": 6.4}, r"outer.fixed reaches \d"),
        (
            {"outer": {"offset_mm": 6.0}, "inner": {"fixed": FLAT | NARROW}},  # along y alone inside the cavity
            {"cavity_radius_mm": 1.3},
            r"inner.fixed cuts 0\.\d+ mm into",
        ),
        (
            {"inner": {"offset_mm": 3.0}, "outer": {"fixed": LONG}},
            {"max_radius_mm": 6.05},
            r"outer.fixed reaches 6\.076\d* mm",
        ),
        (OUTSIDE | {"inner": {"fixed": FLAT, "concave_radius_mm": 3.2}}, {}, "has a concave radius of 3 mm"),
    ],
)
def test_fixed_surfaces_that_cannot_be_are_one_line(lens, constraints, message) -> None:
    limits = {"cavity_height_mm": 0.5, "cavity_radius_mm": 1.0, "min_thickness_mm": 1.0, "max_radius_mm": 7.0}
    with pytest.raises(InputError, match=message) as caught:
        small_spec(lens={"levels": [9, 25]} | lens, constraints=limits | constraints)
    assert "\n" not in str(caught.value)
