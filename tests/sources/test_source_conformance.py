"""Every emitter that the package has, and every kind that a spec can name, keeps the promises of ``Source``."""

import inspect
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numpy as np
import pytest
from PIL import Image
from scenes import small_spec
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from test_radiance import write_radiance

from lensforge import sources
from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.sources.build_source import FacetedSource, build_source
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.measured_rays import RefittedSource, smoothed
from lensforge.sources.photometric import PhotometricFile, write_photometric
from lensforge.sources.photometric.photometric_file import LampSet
from lensforge.sources.radiance_emitter import RadianceTable
from lensforge.sources.ray_bundle import ChangedSource, Source
from lensforge.sources.several_sources import SeveralSources
from lensforge.spec.emitter_section import EmitterSection
from lensforge.surfaces.mirror_group import NAMES, contains, group

EXAMPLES = Path(__file__).parents[2] / "examples"
LED = str(EXAMPLES / "led.tm25ray")
COSINE = {"kind": "cosine", "power": 3.0}
TABLE = {"kind": "table", "gamma_deg": [0.0, 20.0, 60.0, 80.0], "intensity": [1.0, 2.0, 0.5, 0.0]}
FAR_FIELD = {"kind": "photometric", "file": "far.ldt"}
CHIP = {"x_mm": 0.6, "y_mm": -0.3, "width_mm": 0.5, "height_mm": 0.25}
GIVEN = np.random.default_rng(8).normal(size=(1200, 7))
GIVEN[:, 6] = np.abs(GIVEN[:, 6])
WHITE = {"kind": "table", "wavelength_nm": [430.0, 460.0, 550.0, 680.0], "weight": [0.0, 1.0, 0.6, 0.0]}
PLACE = {"rotate_z_deg": 25.0, "tilt_deg": [10.0, -35.0], "position_mm": [0.4, -0.7, 1.5]}
PLACES = ({}, PLACE)
# kind of the spec -> forms of it; a kind without a case fails the suite
CASES = {
    "square": [
        {"side_mm": 1.5, "flux_w": 2.0},
        {"side_mm": 0.0},
        {"side_mm": 1.5, "flux_lm": 200.0, "rotate_z_deg": 45.0, "position_mm": [0.0, 0.0, -0.5]},
        {"side_mm": 1.5, "tilt_deg": [0.0, 20.0], "position_mm": [0.8, 0.0, -0.5]},
    ],
    "rayfile": [
        {"file": LED, "flux_w": 2.0, "model": "rays"},
        {"file": LED, "origin": "virtual_focus", "mirror": "x", "scale": 2.0, "model": "rays"},
        {"file": LED, "flux_lm": 200.0, "model": "rays", **PLACE},
        {"file": LED, "flux_w": 2.0, "model": "radiance"},
        {"file": LED, "model": "radiance", **PLACE},
    ],
    "rayfiles": [
        {"files": [{"file": LED, "flux_w": 3.0}, {"file": LED}], "flux_w": 2.0, "model": "rays", **place}
        for place in PLACES
    ],
    "rays": [
        {"rays": GIVEN, "flux_w": 2.0},
        {"rays": GIVEN[:, :6].tolist(), "flux_w": 1.0, "spectrum": WHITE},
        {"rays": GIVEN, "wavelengths_nm": np.linspace(430.0, 660.0, 1200), "origin": "virtual_focus"},
        {"rays": GIVEN, **PLACE},
    ],
    "rectangle": [
        {"width_mm": 2.0, "height_mm": 1.0},
        {"width_mm": 1.0, "height_mm": 1.0, "intensity": TABLE},
        {"width_mm": 1.0, "height_mm": 1.0, "intensity": FAR_FIELD},
        {"width_mm": 2.0, "height_mm": 1.0, "rotate_z_deg": 90.0, "tilt_deg": [180.0, 0.0]},
    ],
    "disc": [
        {"diameter_mm": 2.0, "flux_w": 0.5, "intensity": COSINE},
        {"diameter_mm": 2.0, "spectrum": WHITE},
        {"diameter_mm": 2.0, "spectrum": WHITE, "flux_lm": 90.0, "tilt_deg": [-30.0, 0.0], "position_mm": [0, 1, 2]},
    ],
    "chips": [
        {"chips": [CHIP, {**CHIP, "x_mm": -0.6, "flux_w": 2.0}]},
        {"chips": [CHIP], "flux_w": 0.25},
        {"chips": [{**CHIP, "flux_lm": 100.0}], **PLACE},
        {"chips": [{**CHIP, "spectrum": WHITE}, {**CHIP, "x_mm": -0.6, "spectrum": WHITE}], **PLACE},
    ],
    "chip_array": [
        {"columns": 2, "rows": 3, "width_mm": 0.5, "height_mm": 0.25, "pitch_mm": [0.75, 0.5]},
        {"columns": 2, "rows": 2, "width_mm": 0.5, "height_mm": 0.5, "pitch_mm": [0.75, 0.75]},
        {"columns": 2, "rows": 3, "width_mm": 0.5, "height_mm": 0.25, "pitch_mm": [0.75, 0.5], **PLACE},
    ],
    "luminance": [{"file": "led.png", "width_mm": 2.0, **place} for place in PLACES],
    "radiance": [
        {"file": "slanted.npz", "flux_w": 2.0},
        {"file": "square.npz"},
        {"file": "turned.npz"},
        {"file": "square.npz", "flux_lm": 100.0, "position_mm": [0.0, 0.5, 0.0]},
    ],
}
NAMED = [(kind, index) for kind, forms in CASES.items() for index in range(len(forms))]


@pytest.fixture
def source(request, tmp_path):
    return _built(_fields(*request.param, tmp_path))


def _fields(kind, index, folder):
    """The fields of a case, its files in ``folder``."""
    fields = {"kind": kind, **CASES[kind][index]}
    if kind == "radiance":
        fields["file"] = _radiance(folder / fields["file"])
    if kind == "luminance":
        fields["file"] = str(folder / fields["file"])
        Image.fromarray(np.array([[0, 1, 4, 1], [2, 9, 9, 2], [0, 3, 3, 0]], dtype=np.uint8)).save(fields["file"])
    return _with_far_field(fields, folder)


def _built(fields):
    """The emitter, its light dispersed by PMMA where a spectrum is known, and coloured where chips have their own."""
    coloured = "spectrum" in str(fields.get("chips"))
    return build_source(small_spec(source=fields).source, MATERIALS["PMMA"], coloured=coloured)


def _radiance(path):
    """A table without any mirror, one with all mirrors of a square, one of revolution about every point."""
    edges, azimuth, gamma = np.linspace(-1.0, 1.0, 5), np.linspace(0.0, 360.0, 13), np.linspace(0.0, 80.0, 9)
    if path.stem == "turned":
        values = np.array([[1.0, 3.0], [2.0, 0.0]])[:, :, None, None] * np.cos(np.deg2rad(gamma))
        write_radiance(path, RadianceTable(edges[::2], edges[::2], np.zeros(1), gamma, values))
        return str(path)
    centres = 0.5 * (edges[1:] + edges[:-1])
    y, x, c, g = np.meshgrid(centres, centres, np.deg2rad(azimuth), np.deg2rad(gamma), indexing="ij")
    kx, ky = np.sin(g) * np.cos(c), np.sin(g) * np.sin(c)
    values = 1.0 + x * kx + y * ky if path.stem == "square" else 1.5 + x * kx + 0.4 * y + 0.3 * ky + 0.1 * x * ky
    values[:, :, -1] = values[:, :, 0]
    write_radiance(path, RadianceTable(edges, edges, azimuth, gamma, np.maximum(values, 0.0)))
    return str(path)


def _with_far_field(fields, folder):
    """The fields, with a far field that is mirrored in x only where they name one."""
    if fields.get("intensity") is not FAR_FIELD:
        return fields
    c, gamma = np.linspace(0.0, 360.0, 25), np.linspace(0.0, 80.0, 17)
    values = 100.0 * (1.5 + np.sin(np.deg2rad(c)))[:, None] * np.cos(np.deg2rad(gamma)) + 5.0
    write_photometric(folder / "far.ldt", PhotometricFile(TabulatedIntensity(c, gamma, values), (LampSet(1000.0),)))
    return {**fields, "intensity": {**FAR_FIELD, "file": str(folder / "far.ldt")}}


def _each(names):
    return pytest.mark.parametrize("source", names, indirect=True, ids=[f"{kind}-{index}" for kind, index in names])


every = _each(NAMED)
at_the_origin = _each([(kind, index) for kind, index in NAMED if not set(PLACE) & set(CASES[kind][index])])


def _emitter_classes():
    """All classes of the package that can be sampled, found by walking it."""
    for module in walk_packages(sources.__path__, f"{sources.__name__}."):
        for _, member in inspect.getmembers(import_module(module.name), inspect.isclass):
            local = member.__module__ == module.name
            samples = hasattr(member, "sample") and hasattr(member, "outline")
            if local and samples and member not in (Source, ChangedSource):
                yield member


def test_every_kind_and_every_emitter_class_has_a_case(tmp_path):
    assert set(EmitterSection.kinds) == set(CASES)
    without_files = [(kind, form) for kind, forms in CASES.items() for form in forms if "far.ldt" not in str(form)]
    built = {
        type(_built({"kind": kind, **form})) for kind, form in without_files if kind not in ("luminance", "radiance")
    }
    radiant = _built({"kind": "radiance", "file": _radiance(tmp_path / "square.npz")})
    classes = set(_emitter_classes())
    assert len(classes) >= 3
    turned = smoothed(_built({"kind": "rayfile", "file": LED, "model": "rays"}))  # made by a search, not by a spec
    several = {SeveralSources, FacetedSource, RefittedSource}  # of these; they have tests of their own
    assert classes == built | several | {type(radiant), type(turned)}
    assert isinstance(turned, Source)


@every
def test_it_is_a_source_of_the_stated_flux_with_unit_directions(source):
    assert isinstance(source, Source)
    for count in (1, 100, 1024):
        rays = source.sample(count, seed=3)
        assert len(rays) == count
        assert rays.origins.shape == rays.directions.shape == (count, 3)
        assert rays.flux.sum() == pytest.approx(source.flux_w, rel=1e-12)
        assert (rays.flux > 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1.0, rtol=0.0, atol=1e-12)
        assert np.isfinite(rays.origins).all()


@every
def test_the_seed_decides(source):
    first, again, other = source.sample(777, seed=5), source.sample(777, seed=5), source.sample(777, seed=6)
    for name in ("origins", "directions", "flux", "wavelengths_nm"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.directions, other.directions)


def _moments(rays, matrix):
    """Flux-weighted means of smooth functions without any symmetry, of the rays mapped by ``matrix``."""
    x, y, z = (rays.origins @ matrix.T).T
    kx, ky, kz = (rays.directions @ matrix.T).T
    values = [x, y, kx, ky, x * y, kx * ky, x * ky, x * x, y * y, kx * kx, ky * ky, np.exp(0.3 * x + 0.7 * ky), kz]
    values += [z, x * z, y * z, kx * kz, ky * kz]
    return np.array([value @ rays.flux for value in values]) / rays.flux.sum()


def _differs(source, name):
    """How far the moments of any mirror image of group ``name`` are from those of the rays themselves."""
    rays = source.sample(min(source.ray_count or 2**14, 2**14), seed=1)
    truth = _moments(rays, np.eye(3))
    return max(np.abs(_moments(rays, mirror) - truth).max() for mirror in group(name))


@every
def test_its_mirror_images_look_the_same(source):
    assert _differs(source, source.symmetry) < 2e-3


@every
def test_no_larger_mirror_group_would_be_true(source):
    """A source that is called less symmetric than it is would cost speed."""
    if source.ray_count is None:
        larger = [name for name in NAMES if name != source.symmetry and contains(name, source.symmetry)]
        assert all(_differs(source, name) > 2e-3 for name in larger)


@every
def test_the_outline_is_a_polygon_around_where_rays_start(source):
    outline = source.outline()
    assert outline.shape[1] == 3
    if source.ray_count is None and not isinstance(source, RefittedSource) and np.ptp(outline) > 0.0:
        middle = outline.mean(axis=0)
        axes = np.linalg.svd(outline - middle)[2]  # two along the polygon, one across
        corners, starts = ((points - middle) @ axes.T for points in (outline, source.sample(2000, seed=2).origins))
        assert np.abs(corners[:, 2]).max() < 1e-12 and np.abs(starts[:, 2]).max() < 1e-12
        equations = ConvexHull(corners[:, :2]).equations
        assert (starts[:, :2] @ equations[:, :2].T + equations[:, 2] < 1e-9).all()


@every
def test_its_place_moves_every_ray_by_one_rotation_and_one_shift(source, request, tmp_path):
    """The placed rays are those of the source at the origin, by scipy's rotations; so is its outline."""
    kind, index = request.node.callspec.params["source"]
    given = _fields(kind, index, tmp_path)
    plain = _built({name: value for name, value in given.items() if name not in PLACE})
    place = {name: given.get(name, 0.0) for name in PLACE}
    turn = Rotation.from_euler("zxy", [place["rotate_z_deg"], *np.broadcast_to(place["tilt_deg"], 2)], degrees=True)
    shift = np.broadcast_to(place["position_mm"], 3)
    still, moved = plain.sample(500, seed=4), source.sample(500, seed=4)
    np.testing.assert_allclose(moved.origins, turn.apply(still.origins) + shift, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(moved.directions, turn.apply(still.directions), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(moved.flux, still.flux)
    np.testing.assert_array_equal(moved.wavelengths_nm, still.wavelengths_nm)
    np.testing.assert_allclose(source.outline(), turn.apply(plain.outline()) + shift, rtol=0.0, atol=1e-9)


@at_the_origin
def test_sampling_converges_faster_than_random_points(source):
    """Scrambled Sobol points in four dimensions: the error falls almost as 1/n; random points have n^-1/2."""
    if source.ray_count is not None:
        everything = source.sample(source.ray_count, 0)
        np.testing.assert_array_equal(everything.origins, source.sample(source.ray_count, 1).origins)
        return
    truth = _moments(source.sample(2**16, seed=99), np.eye(3))
    counts = [2**8, 2**12]
    errors = [
        np.sqrt(np.mean([(_moments(source.sample(count, seed), np.eye(3)) - truth) ** 2 for seed in range(12)]))
        for count in counts
    ]
    order = np.log(errors[0] / errors[1]) / np.log(counts[1] / counts[0])
    assert order > (0.55 if isinstance(source, RefittedSource) else 0.7)  # its stray rays are single ones


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            {"kind": "disc", "diameter_mm": 1.0, "intensity": {**TABLE, "gamma_deg": [0, 0]}},
            "larger than the one before",
        ),
        ({"kind": "disc", "diameter_mm": 1.0, "intensity": {**TABLE, "intensity": [0, 0, 0, 0]}}, "not all zero"),
        ({"kind": "chips", "chips": [{**CHIP, "width_mm": 0}]}, r"source\.chips\.0\.width_mm"),
    ],
)
def test_a_wrong_field_is_named_as_the_user_wrote_it(source, message):
    with pytest.raises(InputError, match=message):
        small_spec(source=source)
