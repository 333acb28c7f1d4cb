"""Light across a crease of the cavity: closed forms, differences of the light itself, and what each source sends."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch
from chains import REACH, clear, collimator, tables_of, upwards
from nightly import first_by_day
from own_media import with_own

from lensforge.errors import InputError
from lensforge.light.crease import adjoint_on, crease_gradients
from lensforge.light.later_creases import _behind, _Lines, _scatters, later_crease_gradients
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.optics.material import MATERIALS
from lensforge.optics.media import FaceScatter, Media, Medium
from lensforge.optics.pose import Pose
from lensforge.optics.scattering import GaussianFacets
from lensforge.scene.body import Body, Face
from lensforge.scene.made_part import AsMade
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver_shapes import FarField
from lensforge.search.collected_light import collected
from lensforge.search.image_terms import nmse_loss
from lensforge.search.light_path import landed_through
from lensforge.seeds import sobol
from lensforge.sources.build_source import PlacedSource, SquareEmitter
from lensforge.sources.dispersion import ColouredSource
from lensforge.sources.emitting_area import Disc
from lensforge.sources.intensity import CosinePower, TabulatedIntensity
from lensforge.sources.measured_rays import TurnedRays
from lensforge.sources.planar_emitter import PlanarEmitter
from lensforge.sources.radiance_emitter import RadianceEmitter, RadianceTable
from lensforge.sources.ray_bundle import RayBundle, Source, towards
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.source_spectrum import Spectrum
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace

GRID = TableGrid(161)
SMALL = 1e-4
ASKEW = Pose.of_tilts((0.4, 0.2, 0.05), (6.0, 0.0))
LED = PlacedSource(PlanarEmitter(Disc(1.0), CosinePower(1.5)), ASKEW)


def pocket(height: float = 4.0, radius: float = 3.0, slope: float = 0.0, tilt: float = 0.0) -> Body:
    """A cap and a side in a ball."""
    cap = PlaneFace(REACH, height, (tilt, 0.4 * tilt, 1.0))
    side = ConeFace(REACH, radius, slope)
    inside = Face("cap", cap, CAVITY, BODY), Face("side", side, CAVITY, BODY)
    return Body((*inside, Face("ball", sphere(11.0), BODY, OUTSIDE)))


def scene(body: Body, events: int = 2) -> Scene:
    return Scene(clear(), GRID, chain=body.chain(events))


def by_parameter(make, base: dict[str, float], name: str, step: float = SMALL) -> np.ndarray:
    """Change of all tables for 1 more of a parameter."""
    ends = [tables_of(make(**(base | {name: base[name] + sign * step})), GRID) for sign in (1.0, -1.0)]
    return (ends[0] - ends[1]) / (2.0 * step)


def at_cap(height: float, radius: float, disc: float) -> float:
    """Share of a Lambertian disc's light that meets a coaxial one (Howell, C-41); of a point's in its middle."""
    if disc == 0.0:
        return radius**2 / (radius**2 + height**2)
    s = 1.0 + (height**2 + radius**2) / disc**2
    return 0.5 * (s - np.sqrt(s**2 - 4.0 * (radius / disc) ** 2))


@pytest.mark.parametrize("disc", [0.0, 1.0, 2.5])
def test_flux_through_the_cap_changes_as_view_factors_do(disc: float) -> None:
    source = PlanarEmitter(Disc(disc), CosinePower()) if disc else SquareEmitter(0.0)
    tables = tables_of(pocket(), GRID)
    base = {"height": 4.0, "radius": 3.0}
    gradients = crease_gradients(tables, scene(pocket()), source, lambda traced: 1.0 * (traced.met[:, 0] < 4), 2**12, 1)
    for name in base:
        more, less = (at_cap(**(base | {name: base[name] + sign * SMALL}), disc=disc) for sign in (1.0, -1.0))
        slope = (gradients * by_parameter(pocket, base, name)).sum()
        assert slope == pytest.approx((more - less) / (2.0 * SMALL), rel=3e-4)


def mixed(traced: TracedBundle) -> np.ndarray:
    flux = traced.exits.flux * traced.exits.left_lens
    (x, _, z) = traced.exits.directions.T
    return flux * (x + z**2 + 0.05 * traced.exits.points[:, 1])


class Waist(ConeFace):
    """A side that is narrowest between the source and the crease, and hides a part of it."""

    def radius(self, directions: np.ndarray) -> np.ndarray:
        return super().radius(directions) * (1.0 - 0.3 * np.exp(-(((directions[:, 2] - 0.4) / 0.15) ** 2)))


def waisted(height: float) -> Body:
    cap, side, ball = pocket(height).faces
    return Body((cap, replace(side, surface=Waist(REACH, 3.0)), ball))


WIDE = PlanarEmitter(Disc(2.2), CosinePower())
BASES = {
    pocket: ({"height": 4.0, "radius": 3.0, "slope": 0.03, "tilt": 0.1}, 2, LED),
    collimator: ({"tilt": 0.1, "draft": 0.05, "eccentricity": 0.8}, 4, LED),
    waisted: ({"height": 4.0}, 2, WIDE),
}
STEPS = [(pocket, "height", 0.06), (pocket, "radius", 0.06), (pocket, "slope", 0.012), (pocket, "tilt", 0.012)]


@pytest.mark.parametrize(("make", "name", "step"), [*STEPS, (collimator, "draft", 0.009), (waisted, "height", 0.06)])
def test_rays_that_change_their_first_face_are_the_slope(make, name: str, step: float) -> None:
    """Differences of the light of those rays alone; their error is that of counting them."""
    base, events, source = BASES[make]
    body = make(**base)
    rays = source.sample(2**18 if name == "tilt" else 2**17, 5)
    ends = [tables_of(make(**(base | {name: base[name] + sign * step})), GRID) for sign in (1.0, -1.0)]
    first, other = (TracedBundle.of(tables, scene(body, 1), rays).met[:, 0] for tables in ends)
    crossing = rays.take(first != other)
    more, less = (mixed(TracedBundle.of(tables, scene(body, events), crossing)) for tables in ends)
    shares = (more - less) / (2.0 * step)
    gradients = crease_gradients(tables_of(body, GRID), scene(body, events), source, mixed, 2**12, 3)
    slope = float((gradients * by_parameter(make, base, name)).sum())
    error = float(np.sqrt((shares**2).sum()))
    assert error < 0.07 * abs(slope)
    assert abs(slope - shares.sum()) < 3.0 * error


def forward(traced: TracedBundle) -> np.ndarray:
    return traced.exits.flux * traced.exits.left_lens * traced.exits.directions[:, 2]


def trumpet(slope: float, height: float) -> Body:
    """A collimator from whose side light reaches the crease of wall and exit."""
    inside = Face("cap", PlaneFace(16.0, 4.0), CAVITY, BODY), Face("side", ConeFace(16.0, 3.2, slope), CAVITY, BODY)
    wall = ConicFace(16.0, 5.0, 1.0)
    leaves = PlaneFace(16.0, height)
    return Body((*inside, Face("wall", wall, BODY, OUTSIDE), Face("exit", leaves, BODY, OUTSIDE)))


TRUMPET = {"slope": -0.05, "height": 9.0}
LATER = [
    (trumpet, TRUMPET, "slope", 0.003, forward),
    (collimator, {"tilt": 0.1, "draft": 0.05}, "tilt", 0.002, mixed),
    (trumpet, TRUMPET, "height", 0.03, forward),
]


@pytest.mark.parametrize(("make", "base", "name", "step", "worth"), first_by_day(2, LATER))
def test_rays_that_change_a_later_face_are_the_slope(make, base, name: str, step: float, worth) -> None:
    """Differences of the light of those rays alone; their error is that of counting them."""
    here = scene(make(**base), 4)
    rays = LED.sample(2**19, 5)
    ends = [tables_of(make(**(base | {name: base[name] + sign * step})), GRID) for sign in (1.0, -1.0)]
    more, less = (TracedBundle.of(tables, here, rays) for tables in ends)
    row = np.arange(len(rays))
    event = (more.met != less.met).argmax(axis=1)
    met_more = more.met[row, event]
    met_less = less.met[row, event]
    crossing = (event > 0) & (met_more >= 0) & (met_less >= 0) & (met_more >> 2 != met_less >> 2)
    shares = ((worth(more) - worth(less)) / (2.0 * step))[crossing]
    gradients = later_crease_gradients(tables_of(make(**base), GRID), here, LED, worth, 2**9, 64, 1)
    slope = float((gradients * by_parameter(make, base, name)).sum())
    error = float(np.sqrt((shares**2).sum()))
    assert error < 0.05 * abs(slope)
    assert abs(slope - shares.sum()) < 3.0 * error


def test_rays_are_followed_to_any_of_their_events_each_with_the_indices_of_its_colour() -> None:
    """To the last, where they leave: by the points and directions of the tracer."""
    body = collimator(0.1)
    indices = np.random.default_rng(1).uniform(1.45, 1.6, 2000)
    rays, medium = with_own(LED.sample(2000, 3), Medium(1.5), indices)
    here = Scene(Media(medium), GRID, chain=body.chain(4))
    tables = tables_of(body, GRID)
    left = TracedBundle.of(tables, here, rays).exits.left_lens
    traced = TracedBundle.of(tables, here, rays.take(left))
    assert traced.met is not None
    event = (traced.met >= 0).sum(axis=1) - 1
    assert set(event) == {1, 2}
    rows = np.random.default_rng(2).permutation(len(event))
    lines = _Lines.of(traced, event, rows)
    assert np.abs(lines.hits - traced.exits.points[rows]).max() < 1e-9
    code = traced.met[rows, event[rows]].astype(int)
    out = _behind(traced, rows, code, lines.hits, lines.directions)
    assert np.abs(out - traced.exits.directions[rows]).max() < 1e-9


def test_crease_and_adjoint_together_are_the_slope_of_an_image_error() -> None:
    """Differences of the error of a far-field picture by the same rays, those that change faces included."""
    base = BASES[pocket][0]
    tables = tables_of(pocket(**base), GRID)
    here = scene(pocket(**base))
    receiver = FarField(Pose.facing((0.1, 0.0, 1.0), (0.0, 0.0, 0.0)), PixelGrid(1.2, 1.0, 9, 7))
    wanted = torch.from_numpy(np.random.default_rng(1).uniform(0.0, 0.02, receiver.grid.shape))
    way = sum(step * by_parameter(pocket, base, name) for _, name, step in STEPS)  # of all parameters together

    def loss(given: torch.Tensor, rays: RayBundle) -> tuple[torch.Tensor, torch.Tensor]:
        (landings,), exits = landed_through(given, here, rays, (receiver,))
        light = collected(landings, exits.sin2_exit, torch.from_numpy(rays.flux), receiver.grid, receiver.window)
        return nmse_loss(light.image, wanted) + 3.0 * light.outside_receiver - 2.0 * light.in_window, light.image

    apart = []
    alone = []
    for seed in range(4):
        rays = LED.sample(2**16, seed)
        given = torch.from_numpy(tables).requires_grad_()
        value, image = loss(given, rays)
        (by_image,) = torch.autograd.grad(nmse_loss(image, wanted), image, retain_graph=True)
        value.backward()
        worth = adjoint_on([receiver], [by_image.numpy()], [np.array([-2.0, 3.0, 0.0])])
        creases = crease_gradients(tables, here, LED, worth, 2**12, seed)
        more, less = (loss(torch.from_numpy(tables + s * way), rays)[0].item() for s in (0.5, -0.5))
        alone.append(more - less - (given.grad.numpy() * way).sum())
        apart.append(alone[-1] - (creases * way).sum())
    error = np.std(apart, ddof=1) / 4**0.5
    assert abs(np.mean(apart)) < 3.5 * error and abs(np.mean(alone)) > 10.0 * error


NESTED = Body((*Body.of({"inner": sphere(3.0), "outer": sphere(5.0)}).faces, Face("hidden", sphere(4.0), CAVITY, BODY)))


@pytest.mark.parametrize("body", [Body.of({"inner": sphere(3.0), "outer": sphere(5.0)}), NESTED])
def test_a_cavity_without_a_crease_has_none(body: Body) -> None:
    for gradients in (crease_gradients, later_crease_gradients):
        assert not gradients(tables_of(body, GRID), scene(body), SquareEmitter(1.0), mixed).any()


def test_what_is_not_known_is_refused() -> None:
    tables = tables_of(pocket(), GRID)
    here = scene(pocket())
    with pytest.raises(InputError, match="RaySetEmitter: the light into a direction is not known; turn its rays"):
        crease_gradients(tables, here, RaySetEmitter(upwards(99, 1), 1.0), mixed)


PLANES = np.array([0.0, 90.0, 200.0, 360.0])
CELLS = np.array([-1.0, 0.3, 1.0])
GAMMAS = np.array([5.0, 30.0, 60.0, 80.0])
VALUES = np.random.default_rng(2).uniform(0.2, 1.0, (2, 2, 4, 4))
VALUES[:, :, 3] = VALUES[:, :, 0]
LINE = Spectrum(np.array([500.0]), np.ones(1))
SOURCES: dict[str, Source] = {
    "square": SquareEmitter(1.0, 2.0),
    "disc": PlanarEmitter(Disc(1.0), CosinePower(2.5), 2.0),
    "planes": PlanarEmitter(Disc(1.0), TabulatedIntensity(PLANES, GAMMAS, VALUES[0, 0]), 2.0),
    "radiance": RadianceEmitter(RadianceTable(CELLS, CELLS, PLANES, GAMMAS, VALUES), 2.0),
    "placed and coloured": ColouredSource.of(LED, LINE, MATERIALS["PMMA"]),
    "ray file": TurnedRays(RaySetEmitter(SquareEmitter(1.0).sample(2**15, 4).placed(ASKEW), 2.0, pose=ASKEW), 0.1),
}  # fmt: skip


@pytest.mark.parametrize("name", SOURCES)
def test_light_into_directions_is_the_light_of_a_sample(name: str) -> None:
    """On a rectangle above the source; of a point (mm) of it the solid angle is cos dA / d^2."""
    source = SOURCES[name]
    corner = np.array([0.5, -1.0, 3.0])
    sides = np.array([2.0, 1.5, 0.0])
    rays = source.sample(2**17, 1)
    hits = rays.origins + ((3.0 - rays.origins[:, 2]) / rays.directions[:, 2])[:, None] * rays.directions
    inside = ((hits - corner)[:, :2] > 0.0).all(1) & ((hits - corner)[:, :2] < sides[:2]).all(1)
    wanted = rays.flux[inside & (rays.directions[:, 2] > 0.0)].sum()
    targets = corner + sides * np.column_stack([sobol(2**17, 6, 2)[:, 4:], np.zeros(2**17)])
    aimed = towards(source, targets, 1)
    distance = np.linalg.norm(targets - aimed.origins, axis=1)
    flux = (aimed.flux * aimed.directions[:, 2] / distance**2).sum() * 3.0
    assert flux == pytest.approx(wanted, rel=0.01)
    assert (aimed.wavelengths_nm is None) == (rays.wavelengths_nm is None)


def test_the_crease_of_a_part_with_its_led_out_of_place_is_that_of_a_led_that_stands_there() -> None:
    """Tilted and shifted by the tolerances of the part, or by its own pose: the same light and the same gradient."""
    made = Pose.displaced((0.2, -0.3, 0.15), (0.06, -0.09, 0.0))
    tables = tables_of(pocket(**BASES[pocket][0]), GRID)
    here = scene(pocket(**BASES[pocket][0]))
    emitter = PlanarEmitter(Disc(1.0), CosinePower(1.5))
    there = PlacedSource(emitter, made)
    wanted = crease_gradients(tables, here, there, mixed, 2**10, 3)
    names = tuple(face.name for face in pocket().faces)
    gradients = crease_gradients(tables, replace(here, made=AsMade(names, source=made)), emitter, mixed, 2**10, 3)
    assert np.abs(gradients - wanted).max() < 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize(("rough", "counted"), [((), True), (("cap", "side"), False)])
def test_light_behind_a_frosted_face_is_not_followed_to_a_crease(rough: tuple[str, ...], counted: bool) -> None:
    """It goes on by a facet of its own; by the smooth face its line led to points far beside all faces."""
    here = scene(trumpet(**TRUMPET), 4)
    scatter = tuple(FaceScatter(name, GaussianFacets(1e-6)) for name in rough)
    here = replace(here, media=replace(here.media, scatter=scatter))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gradients = later_crease_gradients(tables_of(trumpet(**TRUMPET), GRID), here, LED, forward, 2**7, 64, 1)
    assert gradients.any() == counted
    assert _scatters(here).tolist() == [name in rough for name in ("cap", "side", "wall", "exit")]
