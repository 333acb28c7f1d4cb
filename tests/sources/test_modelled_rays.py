"""A radiance fitted to rays, against radiances that are known, and what its rays keep of those of the file."""

import re
import runpy
from base64 import b64decode
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.optics.pose import Pose
from lensforge.sources import modelled_rays
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.light_surface import GlassDome, LightSurface
from lensforge.sources.measured_rays import held_back, rays_of_file, searched, smoothed
from lensforge.sources.modelled_rays import ModelledRays, _apart, _best, _Content, modelled
from lensforge.sources.radiance_fit import Angles, Detail, FittedRadiance
from lensforge.sources.ray_bundle import RayBundle, is_round, towards
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.spec.source_sections import RaySource
from lensforge.surfaces.mirror_group import contains

ASKEW = Pose.of_tilts((0.4, -0.3, 0.2), (25.0, -10.0), 40.0)
SIDES = np.array([0.8, 0.5])  # mm of the two chips, along x and y
CENTRES = np.array([[-0.5, 0.1], [0.5, -0.1]])
BLOCKS = 6 * 6 * 3 * 6
LED = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "make_led_rayfile.py"))


def lambertian(random: np.random.Generator, count: int, power: np.ndarray) -> np.ndarray:
    """Directions of intensity cos^p, for the power p of each ray."""
    cosine, azimuth = (1.0 - random.random(count)) ** (1.0 / (power + 1.0)), 2.0 * np.pi * random.random(count)
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)


def two_chips(count: int, seed: int, stray: float = 0.01) -> RayBundle:
    """A left chip of a third of the light, Lambertian, and a right one along cos^3; some light goes backwards."""
    random = np.random.default_rng(seed)
    right = random.random(count) < 2.0 / 3.0
    places = CENTRES[right.astype(int)] + (random.random((count, 2)) - 0.5) * SIDES
    directions = lambertian(random, count, np.where(right, 3.0, 1.0))
    directions[random.random(count) < stray, 2] *= -1.0
    flux = random.uniform(0.5, 1.5, count)
    return RayBundle(np.column_stack([places, np.zeros(count)]), directions, flux)


@cache
def fitted(count: int = 30_000) -> ModelledRays:
    rays = two_chips(count, 1).placed(ASKEW)
    file = RaySetEmitter(rays, 2.5, pose=ASKEW)
    model = _best(_Content.of(file))
    assert isinstance(model, ModelledRays)
    return model


def test_functions_of_the_angle_are_a_partition_of_one_with_known_integrals() -> None:
    angles, random = Angles(5, 24), np.random.default_rng(2)
    directions = lambertian(random, 400_000, np.ones(400_000))  # even in projected solid angle
    nodes, shares = angles.at(directions)
    np.testing.assert_allclose((shares * angles.measures[nodes]).sum(axis=1), 1.0, rtol=1e-12)
    means = np.pi * np.bincount(nodes.ravel(), shares.ravel(), len(angles.measures)) / len(directions)
    np.testing.assert_allclose(means, 1.0, rtol=0.08)
    assert angles.measures.sum() == pytest.approx(np.pi, rel=1e-12)
    weights = random.random((len(angles.measures), 1))
    grid, directions = angles.on_grid(weights)[..., 0], directions[:50]
    turn, square = np.arctan2(directions[:, 1], directions[:, 0]) / (2.0 * np.pi) % 1.0, 1.0 - directions[:, 2] ** 2
    at = [
        np.interp(squared, angles.squares, [np.interp(around, np.arange(25) / 24.0, ring) for ring in grid.T])
        for around, squared in zip(turn, square, strict=True)
    ]
    np.testing.assert_allclose((shares[:50] * weights[nodes[:50], 0]).sum(axis=1), at, rtol=1e-9)


def test_a_step_never_lowers_the_likelihood() -> None:
    rays = two_chips(20_000, 3, stray=0.0)
    surface = LightSurface.of(rays, curved=False)
    rays = rays.take(surface.holds(rays))
    model, likelihoods = FittedRadiance.of(rays, surface, Detail(12, factors=3, blur=0.0), 1), []
    for _ in range(6):
        model = model.fitted(rays, 1)
        likelihoods.append(float(np.average(model.logarithms(rays), weights=rays.flux)))
    assert np.diff(likelihoods).min() > 0.0 and likelihoods[-1] > likelihoods[0] + 1e-3


def test_a_model_is_nearer_to_the_radiance_than_its_rays_are_and_nearer_with_more() -> None:
    """By blocks of place and angle, against two million others: the noise of n rays there is the blocks over n."""
    others = two_chips(500_000, 8)
    apart = {}
    for count in (5_000, 30_000):
        model = fitted(count)
        surface = model.radiance.surface
        apart[count] = _apart(model.radiance, others.take(surface.holds(others)))
        assert apart[count] < 0.5 * BLOCKS / count
    assert apart[30_000] < 0.5 * apart[5_000]
    assert fitted().radiance.detail.factors >= 2  # two patterns of angles


def fitted_to(model: ModelledRays) -> RayBundle:
    """Rays of the file that are not held back, about its own origin."""
    judges = {tuple(place) for place in model.judges.origins.round(9)}
    rays = model.file.rays.seen_from(ASKEW)
    return rays.take(np.array([tuple(place) not in judges for place in rays.origins.round(9)]))


def backward_share(rays: RayBundle) -> float:
    return float(rays.flux[rays.directions[:, 2] < 0.0].sum() / rays.flux.sum())


def test_rays_keep_flux_stray_light_place_and_direction() -> None:
    model = fitted()
    rays, file = model.sample(2**17, 4), model.file.rays
    assert rays.flux.sum() == pytest.approx(2.5, rel=1e-12) and np.ptp(rays.flux) == 0.0
    drawn, of_file = rays.seen_from(ASKEW), file.seen_from(ASKEW)
    for column in ("origins", "directions"):
        mean = np.average(getattr(of_file, column), axis=0, weights=of_file.flux)
        np.testing.assert_allclose(getattr(drawn, column).mean(axis=0), mean, atol=4e-3)
    stray = (drawn.directions[:, 2] < 0.0).mean()
    assert stray == pytest.approx(backward_share(fitted_to(model)), rel=0.005)
    apart = (0.25 * backward_share(of_file) / len(file)) ** 0.5  # four fifths of the rays by chance, from all of them
    assert stray == pytest.approx(backward_share(of_file), abs=3.0 * apart)
    assert np.array_equal(model.sample(2**10, 5).origins, model.sample(2**10, 5).origins)
    assert not np.array_equal(model.sample(2**10, 5).origins, model.sample(2**10, 6).origins)
    assert model.outline() is model.file.outline() and not is_round(model)
    columns, rows = (int(count) for count in re.search(r"on (\d+) x (\d+) cells", model.description).groups())
    width, height = model.radiance.surface.high - model.radiance.surface.low
    assert columns / rows == pytest.approx(width / height, rel=0.15) and columns > 1.5 * rows


def test_edges_stay_sharp() -> None:
    """Between the chips it is dark within a cell of them, and a cell is a twentieth of the light or finer."""
    model = fitted()
    drawn = model.sample(2**17, 3).seen_from(ASKEW)
    lit = drawn.directions[:, 2] > 0.0
    cell = float((model.radiance.surface.high - model.radiance.surface.low)[0]) / model.radiance.shape[1]
    assert cell < 0.13
    gap = np.abs(drawn.origins[lit, 0]) < 0.5 - 0.5 * SIDES[0] - cell
    assert gap.mean() < 2e-3


def test_quasi_random_rays_have_less_noise() -> None:
    model, count = fitted(), 2**12
    means = [(drawn := model.sample(count, seed).seen_from(ASKEW)).directions[:, 0].mean() + drawn.origins[:, 1].mean()
             for seed in range(12)]  # fmt: skip
    many = model.sample(2**16, 1).seen_from(ASKEW)
    of_random = float(np.std(many.directions[:, 0] + many.origins[:, 1])) / count**0.5
    assert np.std(means) < 0.25 * of_random


def test_light_behind_a_window_comes_from_another_height_for_every_angle() -> None:
    """The crossing nearest to a point at depth d below a window of thickness t and index n is at t (1 - tan/tan)."""
    random = np.random.default_rng(3)
    count = 40_000
    starts, directions = LED["_through_top"](random, LED["_on_chip"](random, count))
    starts[:, 2] += LED["WINDOW_TOP_MM"]
    rays = RayBundle(starts, directions, np.ones(count))
    curved, plane = (LightSurface.of(rays, curved=is_curved) for is_curved in (True, False))
    sine = np.sqrt(curved.squares)
    inside = np.tan(np.arcsin(sine / LED["INDEX"])) / np.tan(np.arcsin(sine))
    np.testing.assert_allclose(curved.heights, LED["WINDOW_TOP_MM"] - LED["WINDOW_MM"] * inside, atol=0.04)
    best = modelled(RaySetEmitter(rays, 1.0), "auto")
    assert isinstance(best, ModelledRays) and len(best.radiance.surface.heights) == 8
    assert plane.heights.shape == (1,)


def in_dome(count: int, seed: int, radius: float = 2.0, index: float = 1.5, height: float = 0.2) -> RayBundle:
    """Two chips at a height (mm) in a dome about it, by Snell's law in vectors; the right one has more light."""
    random = np.random.default_rng(seed)
    right = random.random(count) < 2.0 / 3.0
    starts = np.column_stack([CENTRES[right.astype(int)] + (random.random((count, 2)) - 0.5) * SIDES, np.zeros(count)])
    inside = lambertian(random, count, np.ones(count))
    along = np.einsum("ni,ni->n", starts, inside)
    normal = starts + (np.sqrt(along**2 + radius**2 - np.sum(starts**2, axis=1)) - along)[:, None] * inside
    normal /= radius
    across = index * np.cross(np.cross(normal, inside), normal)
    outside = across + np.sqrt(1.0 - np.sum(across**2, axis=1))[:, None] * normal
    return RayBundle(radius * normal + (0.0, 0.0, height), outside, np.ones(count))


def test_light_in_a_dome_is_that_of_a_plane_within() -> None:
    """The rays tell the dome; then patterns of angles are those of chips, and so are edges."""
    rays = in_dome(30_000, 5)
    exact = GlassDome(2.0, 0.2, 1.5)
    points, along = exact.inward(rays)
    np.testing.assert_allclose(points, rays.origins, atol=1e-12)
    again = exact.outward(points - 0.3 * along, along)
    np.testing.assert_allclose(again, (rays.origins, rays.directions), atol=1e-12)
    model = modelled(RaySetEmitter(rays, 1.0), "auto")
    assert isinstance(model, ModelledRays)
    surface = model.radiance.surface
    assert surface.dome is not None and model.radiance.detail.factors == 1
    assert surface.dome.radius / surface.dome.index == pytest.approx(2.0 / 1.5, rel=0.03)
    np.testing.assert_allclose(surface.high, (0.9, 0.35), atol=0.08)
    drawn, others = model.sample(2**17, 3), in_dome(2**12, 6)
    starts, within = exact.inward(drawn)
    places = (starts + ((0.2 - starts[:, 2]) / within[:, 2])[:, None] * within)[:, :2]
    right, left = ((np.abs(places - centre) < 0.5 * SIDES + 0.08).all(axis=1) for centre in CENTRES[::-1])
    assert right.mean() == pytest.approx(2.0 / 3.0, abs=0.02) and (left | right).mean() > 0.97
    assert (1.0 - within[:, 2] ** 2).mean() == pytest.approx(0.5, abs=0.01)  # Lambertian
    far = towards(model, 1e4 * others.directions, 3)
    np.testing.assert_allclose(far.directions, others.directions, atol=1e-3)


def one_chip(count: int, seed: int, brighter: float = 0.0) -> RayBundle:
    """A square chip whose light leans outwards, more the farther from its middle, the right half of it brighter."""
    random = np.random.default_rng(seed)
    places = random.random((count, 2)) - 0.5
    places[:, 0] = np.where(random.random(count) < brighter, np.abs(places[:, 0]), places[:, 0])
    leaning = lambertian(random, count, np.full(count, 8.0)) + np.column_stack([1.2 * places, np.zeros(count)])
    directions = leaning / np.linalg.norm(leaning, axis=1, keepdims=True)
    return RayBundle(np.column_stack([np.add(places, (0.3, -0.2)), np.zeros(count)]), directions, np.ones(count))


@pytest.mark.parametrize(("brighter", "mirrors", "share"), [(0.0, "square", 0.25), (0.1, "mirror_y", 0.8)])
def test_light_that_mirrors_leave_as_it_is_falls_onto_one_image(brighter: float, mirrors: str, share: float) -> None:
    model = modelled(RaySetEmitter(one_chip(30_000, 4, brighter), 1.0), "auto")
    assert isinstance(model, ModelledRays)
    surface, table = model.radiance.surface, model.radiance.table()
    assert surface.mirrors == mirrors and model.radiance.detail.factors > 1
    np.testing.assert_allclose(0.5 * (surface.low + surface.high), (0.3, -0.2), atol=0.03)
    assert table.flux() == pytest.approx(1.0, rel=1e-6)
    middle = 0.5 * (surface.low + surface.high)
    centred = replace(table, x_mm=table.x_mm - middle[0], y_mm=table.y_mm - middle[1])
    assert contains(centred.symmetry, mirrors)
    others = one_chip(200_000, 8, brighter)
    fitted_to = 0.8 * 30_000  # the others are held back
    assert _apart(model.radiance, others.take(surface.holds(others))) < share * BLOCKS / fitted_to
    drawn = model.sample(2**17, 3)
    leaning = [np.cov(rays.origins[:, 0], rays.directions[:, 0])[0, 1] for rays in (drawn, others)]
    assert leaning[0] == pytest.approx(leaning[1], rel=0.03)


@pytest.mark.parametrize("rays", [in_dome, one_chip])
def test_densities_integrate_to_the_light_of_the_surface(rays) -> None:
    """Over place and projected solid angle outside, by even rays within: étendue outside is n^2 times theirs."""
    model = modelled(RaySetEmitter(rays(30_000, 4), 1.0), "auto")
    assert isinstance(model, ModelledRays)
    random, count, surface = np.random.default_rng(1), 200_000, model.radiance.surface
    places, directions = (
        random.uniform(surface.low, surface.high, (count, 2)),
        lambertian(random, count, np.ones(count)),
    )
    starts, outside = surface.outward(places, directions)
    index = 1.0 if surface.dome is None else surface.dome.index
    densities = np.exp(model.radiance.logarithms(RayBundle(starts, outside, np.ones(count))))
    assert densities.mean() * np.pi * index**2 * np.prod(surface.high - surface.low) == pytest.approx(1.0, abs=0.03)
    assert model.radiance.surface.mirrors == ("square" if rays is one_chip else "none")


def test_models_take_part_where_rays_are_drawn_and_files_where_they_are_cast() -> None:
    model = fitted()
    assert searched(model) is model and held_back(model) is model and smoothed(model) is model
    assert rays_of_file(model) is model.file and rays_of_file(model.file) is model.file


def test_rays_that_judge_a_model_are_none_that_it_was_fitted_to() -> None:
    """A fifth of the file's, in its place and with its flux."""
    model = fitted()
    judges, used = model.held_back.rays, RayBundle.joined([model.lit, model.stray]).placed(ASKEW)
    assert len(judges) == 6_000 and len(judges) + len(used) == len(model.file.rays)
    assert model.held_back.flux_w == 2.5
    together = np.concatenate([judges.origins, used.origins])
    np.testing.assert_allclose(np.sort(together[:, 0]), np.sort(model.file.rays.origins[:, 0]), atol=1e-9)


def test_light_into_a_direction_adds_up_to_the_flux() -> None:
    """Every ray towards points of a hemisphere far away, even in solid angle; stray light goes backwards."""
    model, count = fitted(), 2**16
    random = np.random.default_rng(5)
    away = random.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    rays = towards(model, 1e4 * away, 3)
    assert 4.0 * np.pi * rays.flux.sum() == pytest.approx(2.5, rel=0.03)
    np.testing.assert_allclose(rays.directions, away, atol=1e-3)


def test_colours_are_those_of_the_place_and_of_the_stray_rays_themselves() -> None:
    rays = two_chips(20_000, 7)
    nm = np.where(rays.directions[:, 2] < 0.0, 530.0, np.where(rays.origins[:, 0] > 0.0, 620.0, 450.0))
    model = modelled(RaySetEmitter(rays.with_wavelengths(nm), 1.0), "auto")
    assert isinstance(model, ModelledRays)
    drawn = model.sample(2**14, 2)
    assert drawn.wavelengths_nm is not None
    lit = (drawn.directions[:, 2] > 0.0) & (np.abs(drawn.origins[:, 0]) > 0.35)
    right = np.where(drawn.origins[lit, 0] > 0.0, 620.0, 450.0)
    assert (drawn.wavelengths_nm[lit] == right).mean() > 0.99
    backward = drawn.wavelengths_nm[drawn.directions[:, 2] < 0.0]
    assert len(backward) > 100 and (backward == 530.0).all()


def test_refits_tell_what_the_file_leaves_open() -> None:
    """Their mean directions scatter as those of files of so many rays do."""
    model = fitted(5_000)
    shifts = [model.refitted(seed).sample(2**13, 1).seen_from(ASKEW).directions[:, 0].mean() for seed in range(16)]
    seen = model.file.rays.seen_from(ASKEW)
    weights = seen.flux / seen.flux.sum()
    error = float(np.sqrt(np.sum(weights**2 * (seen.directions[:, 0] - np.sum(weights * seen.directions[:, 0])) ** 2)))
    assert 0.5 * error < np.std(shifts) < 1.6 * error


def test_the_picture_shows_the_chips_from_each_side_in_the_file_and_in_the_model(tmp_path: Path) -> None:
    """Colours turned back into values: rows are file, model and difference; the left chip shines towards +x alone."""
    rays = two_chips(40_000, 2, stray=0.0)
    left = rays.origins[:, 0] < 0.0
    rays.directions[left, 0] = np.abs(rays.directions[left, 0])
    columns = (column.astype(np.float32) for column in (rays.origins, rays.directions, rays.flux))
    write_rayfile(tmp_path / "led.tm25ray", RayFile(*columns, "W"), "tm25")
    picture = tmp_path / "led.svg"
    done = CliRunner().invoke(cli, ["rays", str(tmp_path / "led.tm25ray"), "--model", "--plot", str(picture)])
    assert done.exit_code == 0, done.output
    off, chance = map(float, re.findall(r"([\d.]+) (?:off rays held back|by chance)", done.output))
    assert chance == pytest.approx((BLOCKS * (1.0 + 1.0 / 12.0) / 40_000) ** 0.5, rel=0.02)
    assert 0.05 < off < chance
    drawn = picture.read_text(encoding="utf-8")
    panels = re.findall('data:image/png;base64,([^"]+)', drawn)
    assert drawn.count("scale(1 -1)") == len(panels)  # the first row of each is the lowest
    values = [shown(panel, "inferno" if number < 12 else "RdBu_r")[::-1] for number, panel in enumerate(panels)]
    assert len(values) == 18  # from the front, 45 degrees from +x, +y, -x, -y, and the far field
    for front, right, up, away, down, far in (values[:6], values[6:12]):
        middle = front.shape[1] // 2
        for view, share in ((front, (1.0 / 3.0) / 2.0), (right, 1.0 / 1.0), (up, 0.5), (away, 0.0), (down, 0.5)):
            parts = [view[:, half].sum() for half in (slice(0, middle), slice(middle, None))]
            assert parts[0] / parts[1] == pytest.approx(share, abs=0.08 + 0.1 * share)  # left over right
        rows = [float(np.average(np.arange(len(front)), weights=front[:, half].sum(axis=1))) for half in
                (slice(0, middle), slice(middle, None))]  # fmt: skip
        assert rows[0] < rows[1]  # counted from above
        assert front[:, middle - 2 : middle + 2].mean() < 0.25 * front.mean()  # between the chips
        assert far[:, len(far) // 2 :].sum() > 1.5 * far[:, : len(far) // 2].sum()
    differences = np.concatenate([2.0 * value.ravel() - 1.0 for value in values[12:]]) * 0.3
    assert np.abs(differences).mean() < 0.06 and np.abs(differences.mean()) < 0.01


def shown(panel: str, colours: str) -> np.ndarray:
    """Values in [0, 1] of the pixels of a picture, by the nearest of the 256 colours."""
    with Image.open(BytesIO(b64decode(panel))) as image:
        pixels = np.asarray(image.convert("RGB").resize((60, 60), Image.Resampling.NEAREST), float)
    table = 255.0 * matplotlib.colormaps[colours](np.arange(256))[:, :3]
    return np.argmin(np.sum((pixels[:, :, None] - table) ** 2, axis=3), axis=2) / 255.0


def few(count: int = 54) -> RayBundle:
    return two_chips(count, 1)


def point() -> RayBundle:
    rays = two_chips(5_000, 1)
    return replace(rays, origins=np.zeros((5_000, 3)))


def parallel() -> RayBundle:
    rays = two_chips(5_000, 1)
    return replace(rays, directions=np.tile([0.0, 0.0, 1.0], (5_000, 1)))


def dome() -> RayBundle:
    """Each point of a dome that is far from any chip sends its light everywhere, a third of it backwards."""
    return two_chips(5_000, 1, stray=0.3)


def uneven() -> RayBundle:
    rays = two_chips(5_000, 1)
    return replace(rays, flux=10.0 ** np.linspace(-6.0, 0.0, 5_000))


@pytest.mark.parametrize(
    ("rays", "why"),
    [(few, "effective rays are too few"), (point, "from a point or a line"), (parallel, "parallel rays"),
     (dome, "% of the flux comes from no common surface"), (uneven, "effective rays are too few")],
)  # fmt: skip
def test_rays_without_a_model_stay_and_it_is_said_why(rays, why: str) -> None:
    given = rays()
    section = {"positions_mm": given.origins, "directions": given.directions, "ray_flux": given.flux}
    kept = RaySource(**section, model="auto")
    source = build_source(kept)
    assert source.ray_count == len(given)
    reason = summarise(source, kept).model
    assert reason is not None and reason.startswith("rays: ") and why in reason
    with pytest.raises(InputError, match=why) as error:
        build_source(RaySource(**section, model="radiance"))
    assert str(error.value).endswith('set source.model = "rays", or "auto"') and "\n" not in str(error.value)


def test_the_noise_of_a_large_file_is_that_of_all_its_rays_not_of_those_that_are_fitted(monkeypatch) -> None:
    monkeypatch.setattr(modelled_rays, "_FITTED", 3000)
    rays = two_chips(24_000, 11)
    found = _best(_Content.of(RaySetEmitter(rays, 1.0)))
    by_chance = float(found.split("of the file ")[1].split()[0]) if isinstance(found, str) else found.chance
    assert by_chance == pytest.approx((BLOCKS * np.sum(rays.flux**2)) ** 0.5 / rays.flux.sum(), rel=0.03)


def test_a_model_that_is_farther_off_than_the_rays_is_not_taken() -> None:
    """Light whose angle changes with the place on a scale that no model has: one laser on each spot of a fine grid."""
    random = np.random.default_rng(6)
    count = 20_000
    cells = random.integers(0, 23, (count, 2))
    pointed = np.random.default_rng(1).uniform(-0.65, 0.65, (23, 23, 2))[cells[:, 0], cells[:, 1]]
    across = pointed + random.normal(0.0, 0.01, (count, 2))
    directions = np.column_stack([across, np.sqrt(1.0 - np.sum(across**2, axis=1))])
    rays = RayBundle(
        np.column_stack([(cells + random.random((count, 2))) / 23.0, np.zeros(count)]), directions, np.ones(count)
    )
    kept = modelled(RaySetEmitter(rays, 1.0), "auto")
    assert isinstance(kept, RaySetEmitter)
