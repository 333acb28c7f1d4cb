"""Light of shipped lenses by lensforge, and by a tracer that was written from docs/definitions.md alone.

The lenses are drafts of examples/NAME.toml (`lensforge design --accuracy draft`); their sources, materials and
conditions of evaluation are below. ``tir`` and ``cup`` are searches of a few steps, for an LED beside the axis that is
turned and tilted, without any symmetry.
"""

import ast
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import page_chain
import page_light
import page_tracer
import pytest
from nightly import first_by_day

import lensforge as lf
from lensforge.kernels.fate import Fate
from lensforge.light.simulation import TracedLens
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.asphere import Biconic
from lensforge.surfaces.chart_spline import ChartSpline
from lensforge.surfaces.grooved_face import GroovedFace
from lensforge.surfaces.profile import FormedFace, ProfileFace
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace
from lensforge.surfaces.srbf import SrbfBasis
from lensforge.surfaces.surface import surface_record

ALONE = {name: preset.replace(f"{name}_alone", table_error=False) for name, preset in PRESETS.items()}
HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"
LENSES = ["fixed_outer", "flat_top", "fixed_inner", "image", "pi"]
WIDE = {"kind": "table", "gamma_deg": [0, 40, 120, 150], "intensity": [1.0, 0.8, 0.6, 0.2]}

# A source inside the cavity, turned and tilted: a third of its light goes downwards, and some of that meets the lens.
ABOVE = {"kind": "disc", "diameter_mm": 1.5, "position_mm": [0.1, -0.1, 0.45], "tilt_deg": [25, -40], "intensity": WIDE}
# White light from a cup below the plane z = 0, some of which misses the cavity's opening.
IN_CUP = {
    "kind": "rectangle", "width_mm": 3.0, "height_mm": 1.2, "position_mm": [0.6, -0.3, -1.2], "tilt_deg": [-25.0, 30.0],
    "rotate_z_deg": 30.0, "flux_w": 2.5, "intensity": {"kind": "cosine", "power": 1.5},
    "spectrum": {"kind": "table", "wavelength_nm": [430.0, 460.0, 560.0, 680.0], "weight": [0.0, 1.0, 0.7, 0.1]},
}  # fmt: skip
ABBE = {"material": "", "abbe_number": 30.0, "refractive_index": 1.55, "absorption_per_mm": 0.02}
GLASS = {"refractive_index": 1.5, "thickness_mm": 6.0, "distance_mm": 20.0, "absorption_per_mm": 0.01}
ABBE |= {"cavity_index": 1.1, "outside_index": 1.05, "cover_glass": GLASS}

# A table of the inner face, layers on the outer one and on the glass; the numbers are large, so that they tell.
BY_TABLE = {
    "angle_deg": [0, 25, 50, 75],
    "wavelength_nm": [430, 560, 690],
    "reflectance": [[0.01, 0.02, 0.1, 0.3], [0.08, 0.07, 0.12, 0.4], [0.02, 0.03, 0.05, 0.3]],
}
LAYERS = {"layers": [{"refractive_index": 1.38, "thickness_nm": 95.0}, {"refractive_index": 2.1, "thickness_nm": 40.0}]}
COATINGS = {"inner": {"coating": BY_TABLE}, "outer": {"coating": LAYERS}}
COATED = ABBE | COATINGS | {"cover_glass": GLASS | {"coating": LAYERS}}


@dataclass(frozen=True)
class Scene:
    lens: lf.Lens
    record: dict[str, Any]  # as read from lens.json
    pair: list[Any]


@cache
def scene(folder: Path, name: str, source: str = "{}", material: str = "{}", conditions: str = "{}") -> Scene:
    """A lens of the given name with another source, material and evaluation, and its lens.json, written anew."""
    record = json.loads((HERE / "lenses" / f"{name}.json").read_text(encoding="utf-8"))
    section = record["spec"]["lens"]
    section |= json.loads(material) | {"symmetry": "none"}  # that of the surfaces counts
    if section["refractive_index"] is None:
        del section["refractive_index"]
    record["spec"]["evaluate"] |= json.loads(conditions)
    if replaced := json.loads(source):
        record["spec"]["source"] = replaced
    if record["spec"]["target"].get("file"):
        record["spec"]["target"]["file"] = str(EXAMPLES / record["spec"]["target"]["file"])
    path = folder / f"{name}.json"
    path.write_text(json.dumps(record), encoding="utf-8")
    lens = lf.load_lens(path)
    lens.save(path)
    record = json.loads(path.read_text(encoding="utf-8"))
    return Scene(lens, record, surfaces(name))


@cache
def surfaces(name: str) -> list[Any]:
    lens = json.loads((HERE / "lenses" / f"{name}.json").read_text(encoding="utf-8"))
    return page_chain.chain_faces(lens) if name in ("tir", "cup") else page_tracer.surfaces(lens)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("definitions")


def page_rays(record: dict[str, Any], count: int, seed: int) -> tuple[Any, Any, Any]:
    source = record["spec"]["source"]
    p, d, nm = page_tracer.emitted(source, count, seed)
    return *page_tracer.placed(source, p, d), nm


def library_shares(light: lf.Light) -> dict[str, float]:
    shares = light.flux.model_dump() | light.missed_by_cause.model_dump()
    assert shares.pop("missed") == pytest.approx(sum(light.missed_by_cause.model_dump().values()), abs=1e-12)
    assert shares.pop("not_converged") == 0
    return shares


def pixel_flux(light: lf.Light, flux_w: float) -> Any:
    """Share of the emitted flux in each pixel, unfiltered."""
    return light.raw_map * (light.first.width / light.pixels / 1000) ** 2 / flux_w


def test_tracer_shares_no_code() -> None:
    for module in ("page_tracer", "page_chain", "page_light"):
        tree = ast.parse((HERE / f"{module}.py").read_text(encoding="utf-8"))
        imported = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
        imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        tops = {name.split(".")[0] for name in imported}
        outside = {"dataclasses", "functools", "itertools", "json", "pathlib", "matplotlib", "numpy", "PIL", "scipy"}
        assert tops <= outside | {"page_tracer", "page_chain"}
        assert not [n for n in ast.walk(tree) if isinstance(n, ast.Name) and n.id in ("__import__", "exec", "eval")]


def test_numbers_on_the_page() -> None:
    record = {
        "levels": [1, 3], "sigma_c": 1.5, "symmetry": "mirror_x", "offset_mm": 5, "weights_mm": [0.5, -0.2, 0.3, 0.1],
    }  # fmt: skip
    surface = page_tracer.Freeform(record)
    rho, n = surface.exact(np.array([[0.6, 0, 0.8], [0.48, 0.64, 0.6]]))
    np.testing.assert_allclose(rho, [5.427007220494703, 5.481504438491289], rtol=1e-14)
    np.testing.assert_allclose(n[0], [0.601881077792, -0.014425176209, 0.798455435505], atol=1e-12)
    np.testing.assert_allclose(n[1], [0.489691564674, 0.632988064351, 0.599606772707], atol=1e-12)


def test_numbers_of_a_formed_face_on_the_page() -> None:
    profile = {
        "kind": "profile", "reach_mm": 30, "low": 0.15, "high": 0.75,
        "coefficients": [0.11, 0.14, 0.1, 0.16, 0.13, 0.17, 0.12, 0.15],
    }  # fmt: skip
    functions = {"levels": [1, 3], "sigma_c": 1.5, "symmetry": "mirror_x", "weights": [0.02, -0.01, 0.03, 0.005]}
    face = page_chain.Face("wall", {"kind": "formed", "profile": profile, "functions": functions})
    rho, n = face.exact(np.array([[0.48, 0.64, 0.6], [0.6, 0, 0.8], [0.6, -0.8, 0]]))
    np.testing.assert_allclose(rho, [5.64098293466976, 5.786312896723715, 7.091385918024297], rtol=1e-14)
    np.testing.assert_allclose(n[0], [0.376978117758, 0.558402592657, 0.738968228847], atol=1e-12)
    np.testing.assert_allclose(n[1], [0.748841427009, 0.058128529846, 0.660195116018], atol=1e-12)
    np.testing.assert_allclose(n[2], [0.561189988832, -0.742873940959, -0.364971374601], atol=1e-12)


@pytest.mark.parametrize("name", first_by_day(2, LENSES))
def test_radius_and_normal(folder: Path, name: str) -> None:
    lens = scene(folder, name)
    rng = np.random.default_rng(1)
    z = rng.random(200)
    phi = 2 * np.pi * rng.random(200)
    u = np.column_stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z])
    for page, library in zip(lens.pair, (lens.lens.inner, lens.lens.outer), strict=True):
        rho, n = page.exact(u)
        np.testing.assert_allclose(rho, library.radius(u), rtol=0, atol=1e-12)
        np.testing.assert_allclose(n, library.normal(u), rtol=0, atol=1e-11)
        # The interpolation that the many rays use: far finer than the ray noise.
        assert abs(page.radius(u) - rho).max() < 2e-6 and abs(page.normal(u) - n).max() < 1e-5


AXIS = np.tan(np.linspace(-0.9, 0.9, 60))
KINDS = {
    "biconic": Biconic(8.0, -7.0, -9.0, -0.5, 0.2),
    "spline": ChartSpline.through(AXIS, 6.0 + 0.3 * np.add.outer(AXIS**3, AXIS) ** 2),
}


@pytest.mark.parametrize("kind", KINDS)
def test_radius_and_normal_of_every_kind_of_fixed_surface(kind: str) -> None:
    library = KINDS[kind]
    page = page_tracer.surface(json.loads(surface_record(library).model_dump_json()))
    rng = np.random.default_rng(1)
    z = 0.01 + 0.98 * rng.random(200)
    phi = 2 * np.pi * rng.random(200)
    u = np.column_stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z])
    rho, n = page.exact(u)
    np.testing.assert_allclose(rho, library.radius(u), rtol=0, atol=1e-12)
    np.testing.assert_allclose(n, library.normal(u), rtol=0, atol=1e-8)


# Parts of each face lie beyond its reach, and of a profile beyond both of its ends.
WAVY = (0.11, 0.14, 0.1, 0.16, 0.13, 0.17, 0.12, 0.15)
LENS = (0.2, 0.18, 0.165, 0.15, 0.14, 0.135, 0.132)
RING = (0.09, 0.105, 0.12, 0.14, 0.16, 0.175, 0.19)
RECIPROCALS = {
    "plane": PlaneFace(11.0, 6.0, (0.3, -0.2, 1.4)),
    "cone": ConeFace(5.0, 3.2, -0.04),
    "conic": ConicFace(9.0, 4.0, 0.8, (0.2, 0.1, 1.3)),
    "profile": ProfileFace(7.2, 0.15, 0.75, WAVY),
    "formed": FormedFace(7.2, 0.15, 0.75, WAVY, SrbfBasis((2, 5), 1.3, "diagonal"), 0.01 * np.sin(np.arange(7.0))),
    "grooved": GroovedFace(8.4, ProfileFace(9.0, 0.3, 1.0, LENS), ProfileFace(9.0, 0.2, 0.9, RING), 0.013),
}


@pytest.mark.parametrize("kind", RECIPROCALS)
def test_radius_and_normal_of_every_face_by_its_reciprocal_radius(kind: str) -> None:
    library = RECIPROCALS[kind]
    page = page_chain.Face("wall", json.loads(surface_record(library).model_dump_json()))
    rng = np.random.default_rng(1)
    z = 1.1 * rng.random(400) - 0.1
    phi = 2 * np.pi * rng.random(400)
    u = np.column_stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z])
    rho, n = page.exact(u)
    np.testing.assert_allclose(rho, library.radius(u), rtol=1e-13)
    np.testing.assert_allclose(n, library.normal(u), rtol=0, atol=1e-13)
    assert (rho > page.reach).sum() > 20 < (rho < page.reach).sum()


SAME_RAYS = {
    "from a cup, dispersive": ("fixed_outer", IN_CUP, ABBE),
    "from a cup, coated": ("fixed_outer", IN_CUP, COATED),
    "above the plane": ("pi", ABOVE, {}),
}


@pytest.mark.parametrize("case", first_by_day(1, SAME_RAYS))
def test_same_rays(folder: Path, case: str) -> None:
    """Every ray has the same fate and pixel; the tables of lensforge move a few over the border of one."""
    name, source, material = SAME_RAYS[case]
    count = 2**12
    at = scene(folder, name, json.dumps(source), json.dumps(material))
    rays = page_rays(at.record, count, 5)
    assert _same_light(at, rays, "draft", SEEN[case], least=0.005).rays == count
    assert (rays[1][:, 2] < 0).mean() > 0.25 or case != "above the plane"


def _same_light(at: Any, rays: Any, accuracy: str, seen: tuple[str, ...], least: float) -> lf.Light:
    """The light of the library, of the same flux by cause, picture and figures as the page; ``seen`` are causes."""
    p, d, nm = rays
    mine = page_light.light(at.record, at.pair, [rays], EXAMPLES)
    given = lf.RaySource(positions_mm=p, directions=d, wavelengths_nm=nm, flux_w=1.0)
    light = lf.evaluate(at.lens, accuracy=ALONE[accuracy], source=given, rays=len(p))
    for cause, share in library_shares(light).items():
        assert share == pytest.approx(mine["figures"][cause][0], abs=2e-5), cause
    for cause in seen:
        assert mine["figures"][cause][0] > least, cause
    assert abs(mine["bins"][0] - pixel_flux(light, 1.0)).sum() < 4e-3 * mine["bins"][0].sum()
    assert light.raw.nmse == pytest.approx(page_light.raw_nmse(mine["images"][0], mine["target"]), rel=1e-3)
    assert light.share_in_target.value == pytest.approx(mine["figures"]["share_in_target"][0], abs=1e-4)
    return light


# A source inside the cavity of a reflector, far beside the axis: some of its light meets the mirror three times.
IN_REFLECTOR = ABOVE | {"position_mm": [1.0, -0.6, 0.3], "tilt_deg": [10, 80]}
COATED_FACES = {"cap": {"coating": BY_TABLE}, "exit": {"coating": LAYERS}, "wall": {"mirror": 0.87}}
IN_GEL = COATED_FACES | ABBE | {"events": 4}
MIRRORED_BESIDE = {"events": 3, "wall": {}, "side": {"mirror": 0.4}, "exit": {"coating": LAYERS}}
CHAINS = {
    "tir": ("tir", {}, {"events": 5} | COATED_FACES),
    "reflector": ("cup", IN_REFLECTOR, {"events": 3, "cover_glass": GLASS}),
    "tir, mirrored beside": ("tir", ABOVE, MIRRORED_BESIDE),
    "tir in a gel": ("tir", IN_CUP, IN_GEL),
    "reflector from below": ("cup", IN_CUP, {"events": 4}),
}
SEEN = {
    "from a cup, dispersive": ("outside_cavity", "absorbed", "cover_glass"),
    "above the plane": ("backward", "base"),
    "from a cup, coated": ("outside_cavity", "absorbed", "cover_glass", "reflected"),
    "tir": ("flange", "reflected", "absorbed", "detected"),
    "reflector": ("backward", "outside_cavity", "cover_glass", "absorbed", "event_limit"),
    "tir, mirrored beside": ("backward", "total_reflection", "absorbed", "event_limit"),
    "tir in a gel": ("outside_cavity", "absorbed", "cover_glass", "reflected"),
    "reflector from below": ("outside_cavity", "absorbed"),
}


@pytest.mark.parametrize("case", first_by_day(1, sorted(CHAINS, key="tir, mirrored beside".__ne__)))
def test_same_rays_through_more_than_two_faces(folder: Path, case: str) -> None:
    """The same flux by cause, picture and figures; by day those of other chains are of the crooked designs."""
    name, source, material = CHAINS[case]
    count = 2**10
    at = scene(folder, name, json.dumps(source), json.dumps(material))
    light = _same_light(at, page_rays(at.record, count, 7), "reference", SEEN[case], least=0.002)
    assert sum(library_shares(light).values()) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("case", first_by_day(3, CHAINS))
def test_every_ray_through_more_than_two_faces(folder: Path, case: str) -> None:
    name, source, material = CHAINS[case]
    at = scene(folder, name, json.dumps(source), json.dumps(material))
    p, d, nm = page_rays(at.record, 2**8, 11)
    fate, place, flux, absorbed, in_glass = page_chain.trace_chain(at.record, at.pair, p, d, nm)
    fine = TracedLens.of(at.lens, PRESETS["reference"].evaluate_nodes_per_sigma)
    exits = fine.trace(RayBundle(p, d, np.ones(len(p)), nm))
    left = {"landed": Fate.LEFT_LENS, "missed_receiver": Fate.LEFT_LENS}
    codes = np.array([left[fate] if fate in left else Fate[fate.upper()] for fate in page_tracer.FATES])
    np.testing.assert_array_equal(codes[fate], exits.fates)
    np.testing.assert_allclose(flux, exits.flux, atol=1e-4)
    for by_page, library in ((absorbed, exits.absorbed), (in_glass, exits.lost_in_glass)):
        np.testing.assert_allclose(by_page, 0.0 if library is None else library, atol=1e-4)
    landed = fate == page_tracer.LANDED
    points = exits.points[landed]
    ways = exits.directions[landed]
    steps = (at.record["spec"]["target"]["distance_mm"] - points[:, 2]) / ways[:, 2]
    away = np.linalg.norm((points + steps[:, None] * ways)[:, :2] - place[landed], axis=1)
    assert np.median(away) < 1e-3 and np.quantile(away, 0.9) < 1e-2  # three reflections enlarge the error of a table
