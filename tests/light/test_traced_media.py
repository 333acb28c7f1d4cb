"""What rays pass, and how it is lost: absorption, gels and water, coatings, a cover glass, faces out of place.

Every medium is traced by the kernels and by the tracer in torch, and its gradients are those of differences; each has
closed forms of its own.
"""

import pickle
from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
import torch
from downward_rays import downward_rays
from known_refraction import normal_transmittance
from landed import by_kernels, in_torch, on_device, trace_bundle, trace_tables
from nightly import first_by_day
from own_media import coatings, with_own
from scenes import DEVICES, hemisphere_directions, random_surface, small_spec, sphere, table_of
from test_as_made import ODD

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.optics.media import (
    Coating,
    CoatingLayer,
    CoverGlass,
    IndexCurve,
    LayerStack,
    Media,
    Medium,
    ReflectanceTable,
)
from lensforge.proof.refraction import AtFace, LitRays, RefractingFace, through_glass, unpolarised
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

N = 1.4936
GEL = 1.41
WATER = 1.333
Z = 1000.0
GRID = TableGrid(64)
TABLES = [table_of(surface, GRID) for surface in (random_surface(3, 0.8, 0.03), random_surface(8, 2.45, 0.05))]
RAYS = SquareEmitter(0.9).sample(512, 1)
RNG = np.random.default_rng(3)
LOSING, LOSES = with_own(RAYS, Medium(N, 0.21), absorptions=RNG.uniform(0.0, 0.5, 512))
BENDING, BENDS = with_own(RAYS, Medium(N), indices=RNG.uniform(1.3, 1.7, 512))
COLOURED = RAYS.with_wavelengths(RNG.uniform(420.0, 680.0, 512))


def stack(*layers: tuple[float, float], body: float = N) -> LayerStack:
    """Layers of index and thickness (nm), the first outside."""
    films = tuple(CoatingLayer(IndexCurve((index,)), thickness) for index, thickness in layers)
    return LayerStack(films, IndexCurve((body,)), (100.0, 20_000.0))


def constant(share: float) -> ReflectanceTable:
    return ReflectanceTable((0.0, 90.0), ((share, share),))


BROAD = ReflectanceTable(
    (0.0, 20.0, 40.0, 60.0, 75.0), ((0.002, 0.003, 0.012, 0.06, 0.2), (0.02, 0.018, 0.02, 0.08, 0.3)), (420.0, 680.0)
)
STACK = stack((1.38, 95.0))
OTHER = stack((1.46, 80.0), (2.1, 110.0), (1.62, 70.0))
CLEAR, DIM, EACH_LOSES, EACH_BENDS = (
    Scene(Media(medium), GRID) for medium in (Medium(N), Medium(N, 0.21), LOSES, BENDS)
)
WET = Scene(Media(Medium(N, 0.1), GEL, WATER), GRID)
GLASS = CoverGlass(1.52, 40.0, 10.0, 0.003)
COVERED = Scene(Media(Medium(N), outside_index=1.1, cover_glass=GLASS), GRID)
COATED_GLASS = CoverGlass(1.52, 40.0, 10.0, 0.003, stack((1.38, 95.0), body=1.52))
COATED = Scene(Media(Medium(N, 0.1), 1.0, 1.05, COATED_GLASS, coatings(OTHER, BROAD), 550.0), GRID)
GELLED = Scene(
    Media(Medium(1.41), 1.6, coatings=coatings(stack((1.5, 90.0), body=1.41), stack((1.2, 95.0), body=1.41))), GRID
)  # gel denser than the body

SCENES = {
    "in air": (CLEAR, RAYS),
    "an index for each ray": (EACH_BENDS, BENDING),
    "level and downwards": (CLEAR, downward_rays(400, 5, 0.7, floor=0.6)),
    "absorbing": (DIM, RAYS),
    "an absorption for each ray": (EACH_LOSES, LOSING),
    "gel and water": (WET, RAYS),
    "behind a glass": (COVERED, RAYS),
    "coated": (COATED, RAYS),
    "coated, coloured": (COATED, COLOURED),
    "dense gel": (GELLED, RAYS),
    "dense gel, coloured": (GELLED, COLOURED),
    "out of place": (Scene(Media(Medium(N, 0.05)), GRID, made=ODD), RAYS),
}


def cases(scenes: Iterable[str], *by_day: tuple[str, bool]) -> list[Any]:
    """Scenes with Fresnel's losses and without."""
    return first_by_day(
        len(by_day), [*by_day, *(case for case in product(scenes, (True, False)) if case not in by_day)]
    )


LOSSLESS = ("coated", False), ("gel and water", False)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("name", "fresnel"), cases(SCENES, *((name, True) for name in SCENES), *LOSSLESS))
def test_the_tracer_in_torch_and_its_gradients_are_those_of_the_kernels(name: str, device: str, fresnel: bool) -> None:
    scene = replace(SCENES[name][0], fresnel=fresnel)
    rays = SCENES[name][1]
    tables = [table.clone().requires_grad_() for table in TABLES]
    exits = on_device(tables, scene, rays, device)
    twin = in_torch(exits, Z)
    kernels = by_kernels(tables, scene, rays, Z)
    assert torch.equal(twin.fates, kernels.fates)
    gentle = kernels.sin2_exit < 0.99  # nearer to the critical angle, rounding grows on the way to the receiver
    assert torch.allclose(twin.hits[gentle], kernels.hits[gentle], rtol=1e-8, atol=1e-6)
    assert torch.allclose(twin.carried, kernels.carried, rtol=1e-10, atol=0.0)
    assert torch.allclose(twin.sin2_exit, kernels.sin2_exit, rtol=0.0, atol=1e-11)
    for one, other in ((exits.absorbed, kernels.exits.absorbed), (exits.lost_in_glass, kernels.exits.lost_in_glass)):
        assert (one is None) == (other is None)
        assert one is None or torch.allclose(one, other, rtol=1e-9, atol=1e-15)
    for one, other in zip(*(torch.autograd.grad(landed.mixed(Z), tables) for landed in (twin, kernels)), strict=True):
        assert torch.linalg.norm(one - other) < 1e-8 * torch.linalg.norm(other)


@pytest.mark.parametrize(
    ("name", "fresnel"), cases(SCENES, ("coated, coloured", True), ("out of place", True), ("gel and water", False))
)
def test_gradients_are_those_of_finite_differences(name: str, fresnel: bool) -> None:
    scene = replace(SCENES[name][0], fresnel=fresnel)
    rays = SCENES[name][1]
    tables = [table.clone().requires_grad_() for table in TABLES]
    before = by_kernels(tables, scene, rays, Z)
    assert before.landed.sum() > 100
    for which, gradient in enumerate(torch.autograd.grad(before.mixed(Z), tables)):
        direction = torch.from_numpy(np.random.default_rng(5).normal(size=gradient.shape)) * (gradient != 0)
        values = []
        for sign in (1, -1):
            moved = [table + sign * 1e-7 * direction * (k == which) for k, table in enumerate(TABLES)]
            after = by_kernels(moved, scene, rays, Z)
            assert torch.equal(after.fates, before.fates)
            values.append(after.mixed(Z).item())
        assert (values[0] - values[1]) / 2e-7 == pytest.approx((gradient * direction).sum().item(), rel=1e-5)


GLASS_SPEC = {"refractive_index": 1.52, "thickness_mm": 3.0, "distance_mm": 20.0}


def from_the_centre(media: Media, wavelength_nm: float | None = None) -> ExitRays:
    """Light from the centre of two spheres, 3 mm apart: 300 rays of 1 W, all at right angles to both."""
    waves = None if wavelength_nm is None else np.full(300, wavelength_nm)
    rays = RayBundle(np.zeros((300, 3)), hemisphere_directions(300), np.ones(300)).with_wavelengths(waves)
    return trace_tables((table_of(sphere(r), GRID) for r in (2.0, 5.0)), Scene(media, GRID), rays)


ONCE = normal_transmittance(N)
SERIES = 4 * GEL * N / (GEL + N) ** 2 * 4 * WATER * N / (WATER + N) ** 2
QUARTER = stack((np.sqrt(N), 550.0 / 4.0 / np.sqrt(N)))
BOTH = Media(Medium(N), coatings=coatings(QUARTER, QUARTER), wavelength_nm=550.0)


@pytest.mark.parametrize(
    ("media", "wavelength_nm", "share", "precision"),
    [
        (Media(Medium(N, 0.1)), None, ONCE**2 * np.exp(-0.3), 1e-9),
        (Media(Medium(N, 0.0), GEL, WATER), None, SERIES, 1e-9),
        (Media(Medium(N), coatings=coatings(constant(0.005), constant(0.02))), None, 0.995 * 0.98, 1e-9),
        (Media(Medium(N), coatings=coatings(outer=constant(0.02))), None, ONCE * 0.98, 1e-9),
        (Media(Medium(N), coatings=coatings(inner=constant(0.005))), None, ONCE * 0.995, 1e-9),
        (
            Media(Medium(N), cover_glass=CoverGlass(1.5, 1.0, 10.0, coating=constant(0.01))),
            None,
            ONCE**2 * 0.99**2,
            1e-9,
        ),
        (BOTH, None, 1.0, 1e-7),  # a quarter wave of the root of the index
        (BOTH, 550.0, 1.0, 2e-5),  # a table by wavelength: 1e-5 a face
        (BOTH, 275.0, ONCE**2, 2e-5),  # a half wave: as if it were not there
    ],
)
def test_light_at_right_angles_passes_as_the_closed_form_says(media, wavelength_nm, share, precision) -> None:
    exits = from_the_centre(media, wavelength_nm)
    np.testing.assert_allclose(exits.flux.numpy(), share, rtol=precision)
    if media.body.absorption_per_mm:
        np.testing.assert_allclose(exits.absorbed.numpy(), ONCE * (1.0 - np.exp(-0.3)), rtol=1e-9)
    if media.cavity_index != 1.0:
        assert transmittance_of(media) == pytest.approx(share, rel=1e-14)


def paths(rays: RayBundle) -> torch.Tensor:
    """Length (mm) of each ray in the body, by its ends."""
    traced = trace_bundle(TABLES, CLEAR, rays)
    inner = rays.origins + traced.lengths[:, :1] * rays.directions
    return torch.from_numpy(np.linalg.norm(traced.exits.points - inner, axis=1))


@pytest.mark.parametrize(("scene", "rays"), [(DIM, RAYS), (EACH_LOSES, LOSING)], ids=["one for all", "of each ray"])
def test_each_ray_loses_by_its_own_path_and_nothing_else_changes(scene: Scene, rays: RayBundle) -> None:
    clear = trace_tables(TABLES, CLEAR, RAYS)
    dim = trace_tables(TABLES, scene, rays)
    out = clear.left_lens
    length = paths(RAYS)
    assert torch.equal(dim.fates, clear.fates) and torch.equal(dim.points, clear.points)
    assert out.sum() > 400
    left = torch.exp(-torch.from_numpy(scene.media.body.absorptions(rays.waves, len(rays))) * length)
    assert torch.allclose(dim.flux[out], (clear.flux * left)[out], rtol=1e-13, atol=0.0)
    # what reached the outer surface was absorbed, or is still there, whatever became of it
    assert clear.absorbed is None and dim.absorbed is not None
    lost = clear.fates == Fate.TOTAL_REFLECTION
    assert lost.sum() > 5
    assert torch.allclose((dim.absorbed + dim.flux)[lost], clear.flux[lost], rtol=1e-13, atol=0.0)
    assert not dim.absorbed[clear.fates == Fate.BASE].any()


def test_rays_and_their_fates_are_those_of_bare_faces() -> None:
    bare = replace(COATED, media=replace(COATED.media, coatings=()))
    coated, plain = (trace_tables(TABLES, scene, COLOURED) for scene in (COATED, bare))
    for name in ("points", "directions", "sin2_exit", "fates"):
        assert torch.equal(getattr(coated, name), getattr(plain, name)), name
    assert (coated.fates == Fate.TOTAL_REFLECTION).sum() > 5
    assert not torch.equal(coated.flux, plain.flux)
    dark = (replace(scene, fresnel=False) for scene in (COATED, bare))
    first, second = (trace_tables(TABLES, scene, COLOURED) for scene in dark)
    assert torch.equal(first.flux, second.flux)  # no face loses any


def test_a_gel_of_the_index_of_the_lens_makes_the_inner_face_do_nothing() -> None:
    gel = Scene(Media(Medium(N), cavity_index=N), GRID)
    one, other = (trace_tables((inner, TABLES[1]), gel, RAYS) for inner in (TABLES[0], table_of(sphere(0.7), GRID)))
    out = one.left_lens & other.left_lens
    assert out.sum() > 400
    for name in ("points", "directions", "flux", "sin2_exit"):
        assert torch.allclose(getattr(one, name)[out], getattr(other, name)[out], rtol=1e-9, atol=1e-12), name


def test_a_gel_denser_than_the_lens_may_reflect_all_light_at_the_inner_face() -> None:
    flat = table_of(random_surface(8, 0.8, 0.1, levels=(25, 81)), GRID)
    exits = trace_tables((flat, table_of(sphere(2.45), GRID)), Scene(Media(Medium(1.3), cavity_index=1.6), GRID), RAYS)
    inside = exits.fates == Fate.TOTAL_REFLECTION
    assert inside.sum() > 5 and not exits.sin2_exit[inside].all()


def test_rays_from_a_point_are_shifted_and_dimmed_as_a_plate_does() -> None:
    """Offset t sin(a - b) / cos(b) across the ray (Born and Wolf, 4.7.2); both faces by Fresnel, s and p apart.

    From the centre of spheres the light comes unpolarised, and both faces of the plate have one plane of incidence.
    """
    bare, covered = (from_the_centre(Media(Medium(N), cover_glass=glass)) for glass in (None, GLASS))
    directions = hemisphere_directions(300)
    a = np.arccos(directions[:, 2])
    b = np.arcsin(np.sin(a) / GLASS.refractive_index)
    across = covered.points.numpy() - bare.points.numpy()
    across -= np.sum(across * directions, axis=1)[:, None] * directions
    wanted = GLASS.thickness_mm * np.sin(a - b) / np.cos(b)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(covered.directions.numpy(), bare.directions.numpy(), atol=1e-15)
    r_s = np.sin(a - b) / np.sin(a + b)
    r_p = np.tan(a - b) / np.tan(a + b)
    share = 0.5 * ((1.0 - r_s**2) ** 2 + (1.0 - r_p**2) ** 2) * np.exp(-0.003 * GLASS.thickness_mm / np.cos(b))
    np.testing.assert_allclose(covered.flux.numpy(), bare.flux.numpy() * share, rtol=1e-8)
    assert covered.lost_in_glass is not None
    assert torch.allclose(covered.lost_in_glass + covered.flux, bare.flux, rtol=1e-14)


def by_referee(rays: RayBundle, media: Media) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and directions behind lens and glass, and flux, of the spheres, by the sums of the verification."""
    radii = (0.8, 2.45)
    flux = rays.flux
    fields = unpolarised(rays.directions)
    points = rays.origins
    directions = rays.directions
    light = LitRays.of(rays, media, ("inner", "outer"))
    count = len(rays)
    waves = light.wavelengths_nm
    faces = (
        RefractingFace(np.full(count, media.cavity_index), light.indices, media.coating("inner"), waves, True),
        RefractingFace(light.indices, np.full(count, media.outside_index), media.coating("outer"), waves, False),
    )
    for radius, face in zip(radii, faces, strict=True):
        along = np.sum(points * directions, axis=1)
        lengths = -along + np.sqrt(along**2 - np.sum(points**2, axis=1) + radius**2)
        if radius == radii[1]:
            flux = flux * np.exp(-media.body.absorptions(rays.waves, len(rays)) * lengths)
        points = points + lengths[:, None] * directions
        at = AtFace.of(face, directions, points / radius, fields)
        directions = at.bent
        fields = at.passed
        flux = flux * at.transmittance
    points, directions, in_glass = through_glass(
        points, directions, media, media.wavelengths(rays.wavelengths_nm, len(rays)), fields
    )
    return points, directions, flux * in_glass


@pytest.mark.parametrize("name", ["coated", "coated, coloured", "dense gel", "dense gel, coloured", "behind a glass"])
def test_the_referees_send_every_ray_the_same_way_with_the_same_flux(name: str) -> None:
    """Through spheres, from beside their centre: the light comes to a plate polarised, in planes of its own."""
    scene, rays = SCENES[name]
    exits = trace_tables((table_of(sphere(r), GRID) for r in (0.8, 2.45)), scene, rays)
    points, directions, flux = by_referee(rays, scene.media)
    steep = exits.left_lens.numpy() & (directions[:, 2] > 0.05)
    assert steep.sum() > 400
    np.testing.assert_allclose(exits.flux.numpy()[steep], flux[steep], rtol=1e-8 if scene is COVERED else 4e-5)
    np.testing.assert_allclose(directions[steep], exits.directions.numpy()[steep], atol=1e-12)
    apart = points - exits.points.numpy()
    apart -= np.sum(apart * directions, axis=1)[:, None] * directions  # the same line
    assert np.abs(apart[steep]).max() < 1e-8


def test_a_spec_states_them_and_a_child_process_has_them_whole() -> None:
    spec = small_spec(lens__cavity_index=GEL, lens__outside_index=WATER, lens__cover_glass=GLASS_SPEC)
    assert spec.lens.media == Media(Medium(N), GEL, WATER, CoverGlass(1.52, 3.0, 20.0))
    for scene in (COATED, GELLED, EACH_LOSES):
        assert pickle.loads(pickle.dumps(scene.media)) == scene.media


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distance_mm": 5.0}, r"lens.cover_glass.distance_mm = 5: the lens may be 7 mm high"),
        ({"thickness_mm": 0.0}, r"cover_glass.thickness_mm"),
        ({"refractive_index": 0.5}, r"cover_glass.refractive_index"),
        ({"refractive_index": 1.3}, r"cover_glass.refractive_index = 1.3: must be outside_index = 1.4 at least"),
        ({"distance_mm": 107.0}, r"cover_glass ends at z = 110 mm, and a receiver reaches down to z = 100 mm"),
    ],
)
def test_a_glass_that_cannot_be_is_one_line(changes: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        receivers_of(small_spec(lens__cover_glass=GLASS_SPEC | changes, lens__outside_index=1.4), 8)


@pytest.mark.parametrize(
    ("coating", "message"),
    [
        (BROAD, r"lens.outer.coating: known from 420 to 680 nm, and the source has light from 380.* % of the flux is"),
        (replace(STACK, range_nm=(400.0, 500.0)), r"lens.outer.coating: known from 400 to 500 nm, and the source"),
    ],
)
def test_light_outside_of_a_coating_is_one_line(coating: Coating, message: str) -> None:
    wide = RAYS.with_wavelengths(np.linspace(380.0, 640.0, 512))
    scene = Scene(Media(Medium(N), coatings=coatings(outer=coating)), GRID)
    with pytest.raises(InputError, match=message):
        trace_tables(TABLES, scene, wide)
    tail = np.arange(512) < 40  # has that of the end, where it has little flux
    few = replace(RAYS, flux=np.where(tail, 0.1, 1.0)).with_wavelengths(np.where(tail, 380.0, 480.0))
    with pytest.raises(InputError, match=r"480 nm: 4\.07 % of the flux is outside"):
        trace_tables(TABLES, scene, replace(few, flux=np.where(tail, 0.5, 1.0)))
    ends = few.with_wavelengths(np.maximum(few.wavelengths_nm, 420.0 if coating is BROAD else 400.0))
    flux, flux_at_ends = (trace_tables(TABLES, scene, rays).flux for rays in (few, ends))
    assert torch.allclose(flux, flux_at_ends, rtol=1e-5)
    blue = replace(scene, media=replace(scene.media, wavelength_nm=300.0))
    with pytest.raises(InputError, match=r"the source has light of 300 nm: 100 % .*lens.design_wavelength_nm"):
        trace_tables(TABLES, blue, RAYS)
