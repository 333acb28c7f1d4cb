"""The cover glass: the shift of a plane-parallel plate in closed form, its losses, gradients, and both referees."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from landed import by_kernels, in_torch
from scenes import DEVICES, hemisphere_directions, random_surface, small_spec, sphere, table_of

from lensforge.errors import InputError
from lensforge.light.device_trace import tables_on
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.sequential_trace import TensorRays, trace_sequence
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.media import CoverGlass, Media
from lensforge.proof.refraction import AtFace, RefractingFace, through_glass, unpolarised
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.light_path import TableSurface
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

N, Z, GRID = 1.4936, 1000.0, TableGrid(64)
TABLES = [table_of(each, GRID) for each in (random_surface(3, 0.8, 0.03), random_surface(4, 2.45, 0.02))]
RAYS = SquareEmitter(0.9).sample(512, 1)
GLASS = CoverGlass(1.52, 40.0, 10.0, 0.003)
COVERED = Scene(Media(N, outside_index=1.1, cover_glass=GLASS), GRID)


def test_rays_from_a_point_are_shifted_and_dimmed_as_a_plate_does() -> None:
    """Offset t sin(a - b) / cos(b) across the ray (Born and Wolf, 4.7.2); both faces by Fresnel, s and p apart.

    From the centre of spheres the light comes unpolarised, and both faces of the plate have one plane of incidence.
    """
    directions = hemisphere_directions(400)
    rays = RayBundle(np.zeros((400, 3)), directions, np.ones(400))
    tables, air = [table_of(sphere(each), GRID) for each in (2.0, 5.0)], Media(N)
    bare = trace_tables(*tables, Scene(air, GRID), rays)
    found = trace_tables(*tables, Scene(replace(air, cover_glass=GLASS), GRID), rays)
    a = np.arccos(directions[:, 2])
    b = np.arcsin(np.sin(a) / GLASS.refractive_index)
    across = found.points.numpy() - bare.points.numpy()
    across -= np.sum(across * directions, axis=1)[:, None] * directions
    wanted = GLASS.thickness_mm * np.sin(a - b) / np.cos(b)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.directions.numpy(), bare.directions.numpy(), atol=1e-15)
    r_s, r_p = np.sin(a - b) / np.sin(a + b), np.tan(a - b) / np.tan(a + b)
    share = 0.5 * ((1.0 - r_s**2) ** 2 + (1.0 - r_p**2) ** 2) * np.exp(-0.003 * GLASS.thickness_mm / np.cos(b))
    np.testing.assert_allclose(found.flux.numpy(), bare.flux.numpy() * share, rtol=1e-8)
    assert found.lost_in_glass is not None
    assert torch.allclose(found.lost_in_glass + found.flux, bare.flux, rtol=1e-14)


def test_a_plate_of_what_surrounds_it_does_nothing() -> None:
    clear = replace(COVERED, media=replace(COVERED.media, cover_glass=CoverGlass(1.1, 40.0, 10.0)))
    bare = replace(COVERED, media=replace(COVERED.media, cover_glass=None))
    one, other = (trace_tables(*TABLES, scene, RAYS) for scene in (clear, bare))
    assert torch.allclose(one.points, other.points, atol=1e-12) and torch.allclose(one.flux, other.flux, rtol=1e-12)


def test_the_referee_traces_the_plate_face_by_face_and_finds_the_same() -> None:
    """Through spheres, from beside their centre: the light comes to the plate polarised, in planes of its own."""
    tables = [table_of(sphere(each), GRID) for each in (0.8, 2.45)]
    bare = trace_tables(*tables, replace(COVERED, media=replace(COVERED.media, cover_glass=None)), RAYS)
    found, out = trace_tables(*tables, COVERED, RAYS), bare.left_lens.numpy()
    fields, ways, ends = unpolarised(RAYS.directions), RAYS.directions, RAYS.origins
    for radius, face in zip(
        (0.8, 2.45), (RefractingFace.inner(RAYS, COVERED.media), RefractingFace.outer(RAYS, COVERED.media)), strict=True
    ):
        along = np.sum(ends * ways, axis=1)
        ends = ends + (np.sqrt(along**2 - np.sum(ends**2, axis=1) + radius**2) - along)[:, None] * ways
        at = AtFace.of(face, ways, ends / radius, fields)
        ways, fields = at.bent, at.passed
    points, directions, share = through_glass(
        bare.points.numpy()[out], bare.directions.numpy()[out], COVERED.media, None, fields[out]
    )
    unpolarised_share = through_glass(bare.points.numpy()[out], bare.directions.numpy()[out], COVERED.media)[2]
    assert np.abs(share / unpolarised_share - 1.0).max() > 1e-3
    rising = directions[:, 2] > 0.0
    assert rising.sum() > 400
    np.testing.assert_allclose(points[rising, 2], GLASS.distance_mm + GLASS.thickness_mm, rtol=1e-12)
    np.testing.assert_allclose(directions, found.directions.numpy()[out], atol=1e-12)
    np.testing.assert_allclose((bare.flux.numpy()[out] * share), found.flux.numpy()[out], rtol=1e-8)
    apart = points - found.points.numpy()[out]
    apart -= np.sum(apart * directions, axis=1)[:, None] * directions  # the same line
    steep = directions[:, 2] > 0.05
    assert np.abs(apart[steep]).max() < 1e-8 and not apart[~rising].any()


@pytest.mark.parametrize("device", DEVICES)
def test_the_tracer_in_torch_and_its_gradients_are_those_of_the_kernels(device: str) -> None:
    tables = [each.clone().requires_grad_() for each in TABLES]
    inner, outer = (TableSurface(each) for each in tables_on(torch.device(device), *tables, COVERED))
    found = trace_sequence(inner, outer, TensorRays.of(RAYS, COVERED.media, torch.float64, torch.device(device)))
    back = type(found)(*(None if each is None else each.cpu() for each in vars(found).values()))
    twin, kernels = in_torch(back, Z), by_kernels(tables, COVERED, RAYS, Z)
    assert torch.allclose(twin.hits, kernels.hits, rtol=1e-8, atol=1e-6)
    assert torch.allclose(twin.carried, kernels.carried, rtol=1e-10, atol=0.0)
    by_flux = torch.from_numpy(np.random.default_rng(1).normal(size=len(RAYS)))
    pairs = ((by_flux * each.flux).sum() + torch.tanh(each.hits / Z).sum() for each in (twin, kernels))
    one, other = (torch.autograd.grad(value, tables) for value in pairs)
    for a, b in zip(one, other, strict=True):
        assert torch.linalg.norm(a - b) < 1e-8 * torch.linalg.norm(b)


@pytest.mark.parametrize("fresnel", [True, False])
def test_gradients_are_those_of_finite_differences(fresnel: bool) -> None:
    by_flux = torch.from_numpy(np.random.default_rng(2).normal(size=len(RAYS)))
    tables, scene = [each.clone().requires_grad_() for each in TABLES], replace(COVERED, fresnel=fresnel)

    def value(*moved: torch.Tensor) -> torch.Tensor:
        found = by_kernels(list(moved), scene, RAYS, 60.0)
        return (100.0 * by_flux * found.flux).sum() + torch.tanh(found.hits / 60.0).sum()

    for which, gradient in enumerate(torch.autograd.grad(value(*tables), tables)):
        direction = torch.from_numpy(np.random.default_rng(5).normal(size=gradient.shape)) * (gradient != 0)
        ahead, behind = (
            value(*(each + s * 1e-7 * direction * (k == which) for k, each in enumerate(TABLES))) for s in (1, -1)
        )
        assert (ahead - behind).item() / 2e-7 == pytest.approx((gradient * direction).sum().item(), rel=1e-5)


GLASS_SPEC = {"refractive_index": 1.52, "thickness_mm": 3.0, "distance_mm": 20.0}


def test_a_spec_states_it_and_the_budget_names_what_it_takes() -> None:
    spec = small_spec(lens__cover_glass=GLASS_SPEC)
    assert spec.lens.media.cover_glass == CoverGlass(1.52, 3.0, 20.0)
    surfaces = [random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2)]
    lens, bare = (Lens(*surfaces, each, 0, "draft") for each in (spec, small_spec()))
    source = SquareEmitter(1.0)
    seen, was = (evaluate_traced(TracedLens.of(each, 4.0), each.spec, source, 4096, 0).first for each in (lens, bare))
    assert sum(seen.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12) and was.flux.cover_glass == 0.0
    assert seen.flux.reflected == pytest.approx(was.flux.reflected, abs=1e-12)
    assert 0.08 < seen.flux.cover_glass < 0.3  # two faces, and grazing light
    assert seen.possible.efficiency >= was.possible.efficiency


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distance_mm": 5.0}, r"lens.cover_glass.distance_mm = 5: the lens may be 7 mm high"),
        ({"thickness_mm": 0.0}, r"cover_glass.thickness_mm"),
        ({"refractive_index": 0.5}, r"cover_glass.refractive_index"),
    ],
)
def test_a_glass_that_cannot_be_is_one_line(changes: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        small_spec(lens__cover_glass=GLASS_SPEC | changes)
    with pytest.raises(InputError, match=r"cover_glass.refractive_index = 1.3: must be outside_index = 1.4 at least"):
        small_spec(lens__cover_glass=GLASS_SPEC | {"refractive_index": 1.3}, lens__outside_index=1.4)


def test_a_receiver_within_the_glass_is_one_line() -> None:
    with pytest.raises(InputError, match=r"cover_glass ends at z = 110 mm, and a receiver reaches down to z = 100 mm"):
        receivers_of(small_spec(lens__cover_glass=GLASS_SPEC | {"distance_mm": 107.0}), 8)
