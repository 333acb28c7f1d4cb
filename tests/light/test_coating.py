"""Coated faces: closed forms, gradients by finite differences, the twin in torch, the sums of the referees."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from known_refraction import normal_transmittance
from landed import by_kernels, in_torch
from pydantic import TypeAdapter
from scenes import DEVICES, hemisphere_directions, random_surface, small_spec, sphere, table_of

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.device_trace import tables_on
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.exact_trace import DenseScan, exact_surfaces, trace_exact
from lensforge.light.sequential_trace import TensorRays, trace_sequence
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.media import Coating, CoatingLayer, CoverGlass, IndexCurve, LayerStack, Media, ReflectanceTable
from lensforge.proof.refraction import AtFace, RefractingFace, through_glass, unpolarised
from lensforge.scene.lens import Lens
from lensforge.search.light_path import TableSurface
from lensforge.search.optimiser import search
from lensforge.sources.build_source import SquareEmitter, build_source
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import TableGrid

N, Z, GRID = 1.4936, 1000.0, TableGrid(64)
TABLES = [table_of(each, GRID) for each in (random_surface(3, 0.8, 0.03), random_surface(8, 2.45, 0.05))]
PLAIN = SquareEmitter(0.9).sample(512, 1)
COLOURED = replace(PLAIN, wavelengths_nm=np.random.default_rng(2).uniform(420.0, 680.0, 512))


def stack(*layers: tuple[float, float], body: float = N) -> LayerStack:
    """Layers of index and thickness (nm), the first outside."""
    found = tuple(CoatingLayer(IndexCurve((index,)), thickness) for index, thickness in layers)
    return LayerStack(found, IndexCurve((body,)), (100.0, 20_000.0))


def constant(share: float) -> ReflectanceTable:
    return ReflectanceTable((0.0, 90.0), ((share, share),))


BROAD = ReflectanceTable(
    (0.0, 20.0, 40.0, 60.0, 75.0), ((0.002, 0.003, 0.012, 0.06, 0.2), (0.02, 0.018, 0.02, 0.08, 0.3)), (420.0, 680.0)
)
STACK, OTHER = stack((1.38, 95.0)), stack((1.46, 80.0), (2.1, 110.0), (1.62, 70.0))
COATED = Scene(
    Media(N, 0.1, 1.0, 1.05, CoverGlass(1.52, 40.0, 10.0, 0.003, stack((1.38, 95.0), body=1.52)), OTHER, BROAD, 550.0),
    GRID,
)
GELLED = Scene(
    Media(1.41, 0.0, 1.6, 1.0, None, stack((1.5, 90.0), body=1.41), stack((1.2, 95.0), body=1.41)), GRID
)  # gel denser than the body


def from_the_centre(media: Media, wavelength_nm: float | None = None) -> np.ndarray:
    """Share of the light from the centre of two spheres that leaves the lens, ray by ray."""
    waves = None if wavelength_nm is None else np.full(300, wavelength_nm)
    rays = RayBundle(np.zeros((300, 3)), hemisphere_directions(300), np.ones(300), wavelengths_nm=waves)
    return trace_tables(*(table_of(sphere(r), GRID) for r in (2.0, 5.0)), Scene(media, GRID), rays).flux.numpy()


def test_a_face_of_constant_reflectance_lets_the_rest_pass() -> None:
    once = normal_transmittance(N)
    for inner, outer in ((0.005, 0.02), (None, 0.02), (0.005, None)):
        media = Media(N, inner_coating=inner and constant(inner), outer_coating=outer and constant(outer))
        wanted = (once if inner is None else 1.0 - inner) * (once if outer is None else 1.0 - outer)
        np.testing.assert_allclose(from_the_centre(media), wanted, rtol=1e-9)
    covered = CoverGlass(1.5, 1.0, 10.0, coating=constant(0.01))
    found = from_the_centre(Media(N, cover_glass=covered))
    np.testing.assert_allclose(found, once**2 * 0.99**2, rtol=1e-9)


def test_a_quarter_wave_layer_of_the_root_of_the_index_reflects_nothing() -> None:
    root = np.sqrt(N)
    layer = stack((root, 550.0 / 4.0 / root))
    both = Media(N, inner_coating=layer, outer_coating=layer, wavelength_nm=550.0)
    np.testing.assert_allclose(from_the_centre(both), 1.0, atol=1e-7)
    np.testing.assert_allclose(from_the_centre(both, 550.0), 1.0, atol=2e-5)  # a table by wavelength: 1e-5 a face
    # at half of the wavelength the layer is a half wave: as if it were not there
    np.testing.assert_allclose(from_the_centre(both, 275.0), normal_transmittance(N) ** 2, atol=2e-5)


def test_rays_and_their_fates_are_those_of_bare_faces() -> None:
    bare = replace(COATED, media=replace(COATED.media, inner_coating=None, outer_coating=None))
    one, other = (trace_tables(*TABLES, scene, COLOURED) for scene in (COATED, bare))
    for name in ("points", "directions", "sin2_exit", "fates"):
        assert torch.equal(getattr(one, name), getattr(other, name)), name
    assert (one.fates == Fate.TOTAL_REFLECTION).sum() > 5
    assert not torch.equal(one.flux, other.flux)
    dark = (replace(scene, fresnel=False) for scene in (COATED, bare))
    first, second = (trace_tables(*TABLES, scene, COLOURED) for scene in dark)
    assert torch.equal(first.flux, second.flux)  # no face loses any


def by_referee(rays: RayBundle, media: Media) -> tuple[np.ndarray, np.ndarray]:
    """Flux behind the inner face and behind the lens of the spheres, by the sums of the verification."""
    radii, flux, fields = (0.8, 2.45), rays.flux, unpolarised(rays.directions)
    points, directions, found = rays.origins, rays.directions, []
    for radius, face in zip(radii, (RefractingFace.inner(rays, media), RefractingFace.outer(rays, media)), strict=True):
        along = np.sum(points * directions, axis=1)
        lengths = -along + np.sqrt(along**2 - np.sum(points**2, axis=1) + radius**2)
        if len(found):
            flux = flux * np.exp(-rays.absorptions(media) * lengths)
        points = points + lengths[:, None] * directions
        at = AtFace.of(face, directions, points / radius, fields)
        directions, fields, flux = at.bent, at.passed, flux * at.transmittance
        found.append(flux)
    return flux, through_glass(points, directions, media, rays.wavelengths(media), fields)[2]


@pytest.mark.parametrize("rays", [PLAIN, COLOURED], ids=["one wavelength", "coloured"])
@pytest.mark.parametrize("scene", [COATED, GELLED], ids=["air", "dense gel"])
def test_the_referees_sum_every_ray_to_the_same_flux(scene: Scene, rays: RayBundle) -> None:
    spheres = [table_of(sphere(r), GRID) for r in (0.8, 2.45)]
    exits = trace_tables(*spheres, scene, rays)
    flux, in_glass = by_referee(rays, scene.media)
    out = exits.left_lens.numpy()
    assert out.sum() > 400
    np.testing.assert_allclose(exits.flux.numpy()[out], (flux * in_glass)[out], rtol=4e-5)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("rays", [PLAIN, COLOURED], ids=["one wavelength", "coloured"])
@pytest.mark.parametrize("scene", [COATED, GELLED], ids=["air", "dense gel"])
def test_the_tracer_in_torch_and_its_gradients_are_those_of_the_kernels(
    scene: Scene, rays: RayBundle, device: str
) -> None:
    tables = [each.clone().requires_grad_() for each in TABLES]
    inner, outer = (TableSurface(each) for each in tables_on(torch.device(device), *tables, scene))
    found = trace_sequence(inner, outer, TensorRays.of(rays, scene.media, torch.float64, torch.device(device)))
    back = type(found)(*(None if each is None else each.cpu() for each in vars(found).values()))
    twin, kernels = in_torch(back, Z), by_kernels(tables, scene, rays, Z)
    assert torch.equal(twin.fates, kernels.fates)
    assert torch.allclose(twin.carried, kernels.carried, rtol=1e-10, atol=0.0)
    by_flux = torch.from_numpy(np.random.default_rng(1).normal(size=len(rays)))
    pairs = ((by_flux * each.flux).sum() for each in (twin, kernels))
    one, other = (torch.autograd.grad(value, tables) for value in pairs)
    for a, b in zip(one, other, strict=True):
        assert torch.linalg.norm(a - b) < 1e-8 * torch.linalg.norm(b)


@pytest.mark.parametrize("fresnel", [True, False])
@pytest.mark.parametrize("scene", [COATED, GELLED], ids=["air", "dense gel"])
def test_gradients_are_those_of_finite_differences(scene: Scene, fresnel: bool) -> None:
    by_flux = torch.from_numpy(np.random.default_rng(2).normal(size=512))
    tables, scene = [each.clone().requires_grad_() for each in TABLES], replace(scene, fresnel=fresnel)

    def value(*moved: torch.Tensor) -> torch.Tensor:
        found = by_kernels(list(moved), scene, COLOURED, Z)
        return (100.0 * by_flux * found.flux).sum() + torch.tanh(found.hits / Z).sum()

    for which, gradient in enumerate(torch.autograd.grad(value(*tables), tables)):
        direction = torch.from_numpy(np.random.default_rng(5).normal(size=gradient.shape)) * (gradient != 0)
        ahead, behind = (
            value(*(each + s * 1e-7 * direction * (k == which) for k, each in enumerate(TABLES))) for s in (1, -1)
        )
        assert (ahead - behind).item() / 2e-7 == pytest.approx((gradient * direction).sum().item(), rel=1e-5)


WHITE = {"kind": "table", "wavelength_nm": [450.0, 550.0, 650.0], "weight": [1.0, 0.5, 1.0]}
MGF2 = {"layers": [{"refractive_index": 1.38, "thickness_nm": 100.0}]}
GLASS = {"refractive_index": 1.52, "thickness_mm": 3.0, "distance_mm": 20.0}


def lens_of(spec: Spec) -> Lens:
    return Lens(*(random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2)), spec, 0, "draft")


def test_a_spec_states_them_and_the_budget_and_the_bounds_know_them() -> None:
    covered = GLASS | {"coating": MGF2}
    coated = small_spec(
        lens__inner_coating=MGF2, lens__outer_coating=MGF2, lens__cover_glass=covered, source__spectrum=WHITE
    )
    bare = small_spec(lens__cover_glass=GLASS, source__spectrum=WHITE)
    lights = []
    for spec in (coated, bare):
        source = build_source(spec.source, spec.lens.dispersion)
        lights.append(evaluate_traced(TracedLens.of(lens_of(spec), 4.0), spec, source, 4096, 0).first)
    light, was = lights
    assert sum(light.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-12)
    assert light.flux.reflected < 0.5 * was.flux.reflected and light.flux.cover_glass < 0.7 * was.flux.cover_glass
    assert was.possible.efficiency < light.possible.efficiency <= 1.0
    assert light.efficiency.value < light.possible.efficiency
    high = small_spec(lens__inner_coating={"reflectance": 0.3}, lens__outer_coating={"reflectance": 0.2})
    dark = evaluate_traced(TracedLens.of(lens_of(high), 4.0), high, SquareEmitter(1.0), 4096, 0).first
    assert dark.flux.detected + dark.flux.outside < 0.56 + 1e-12
    assert dark.efficiency.value <= dark.possible.efficiency <= 0.56 + 1e-12


def test_light_outside_of_a_coating_ends_a_design_before_its_search() -> None:
    table = {"reflectance": [[0.01], [0.02]], "wavelength_nm": [400.0, 500.0]}
    begun: list[object] = []
    for spectrum, words in ((WHITE, "light from 450"), (None, "light of 587.562 nm: 100 %")):
        spec = small_spec(lens__outer_coating=table, source__spectrum=spectrum)
        with pytest.raises(InputError, match=rf"lens.outer_coating: known from 400 to 500 nm, .*{words}"):
            search(spec, build_source(spec.source, spec.lens.dispersion), accuracy="draft", progress=begun.append)
    assert not begun


def test_media_reach_the_casts_of_a_child_process_whole() -> None:
    for scene in (COATED, GELLED):
        assert TypeAdapter(Media).validate_python(json.loads(json.dumps(asdict(scene.media)))) == scene.media


def test_the_exact_tracer_is_coated_as_the_tables_are() -> None:
    spec = small_spec(lens__inner_coating=MGF2, lens__outer_coating=MGF2)
    lens, rays = lens_of(spec), SquareEmitter(1.0).sample(64, 1)
    exact = trace_exact(*exact_surfaces(lens, (DenseScan(), DenseScan())), lens.media, rays)
    assert torch.allclose(exact.flux, TracedLens.of(lens, 8.0).trace(rays).flux, rtol=1e-6)


@pytest.mark.parametrize(
    ("coating", "message"),
    [
        (BROAD, r"lens.outer_coating: known from 420 to 680 nm, and the source has light from 380.* % of the flux is"),
        (replace(STACK, range_nm=(400.0, 500.0)), r"lens.outer_coating: known from 400 to 500 nm, and the source"),
    ],
)
def test_light_outside_of_a_coating_is_one_line(coating: Coating, message: str) -> None:
    wide = replace(PLAIN, wavelengths_nm=np.linspace(380.0, 640.0, 512))
    scene = Scene(Media(N, outer_coating=coating), GRID)
    with pytest.raises(InputError, match=message):
        trace_tables(*TABLES, scene, wide)
    few = replace(PLAIN, wavelengths_nm=np.where(np.arange(512) < 4, 380.0, 480.0))  # a tail has that of the end
    ends = replace(few, wavelengths_nm=np.maximum(few.wavelengths_nm, 420.0 if coating is BROAD else 400.0))
    one, other = (trace_tables(*TABLES, scene, each).flux for each in (few, ends))
    assert torch.allclose(one, other, rtol=1e-5)
    blue = replace(scene, media=replace(scene.media, wavelength_nm=300.0))
    with pytest.raises(InputError, match=r"the source has light of 300 nm: 100 % .*lens.design_wavelength_nm"):
        trace_tables(*TABLES, blue, PLAIN)
