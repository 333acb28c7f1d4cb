"""The check against a ball that is tried at every contact: against all points of the mesh of the part."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from nightly import NIGHTLY, first_by_day
from presets import CHECKED
from scenes import small_spec
from scipy.spatial import cKDTree

import lensforge as lf
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh import build_mesh
from lensforge.cad.plan import make_plan
from lensforge.scene.lens import Lens
from lensforge.shop.check import check_lens
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.surface import to_sphere

BALL = 1.0
# 0.05 mm apart: a ball of 1 mm that touches between them is taken to be clear by 0.4 um; by day 0.08 mm and 1 um.
OBSTACLES = 500_000 if NIGHTLY else 200_000
GOUGE = 5e-4  # mm: the error of the facets, and more
EXAMPLES = Path(__file__).parents[2] / "examples"


def _required(path: Path) -> bool:
    """Whether the spec asks for a lens that can be cut, by its text: to read a whole spec takes up to 4 s."""
    required: bool = tomllib.loads(path.read_text(encoding="utf-8")).get("manufacture", {}).get("required", False)
    return required


CUT = [path for path in sorted(EXAMPLES.glob("*.toml")) if _required(path)]


def designed_for_the_ball(**base: float) -> Lens:
    """A cavity that narrows upwards, and a dome that overhangs its rim a little: both rims need room."""
    inner = sphere(1.6, -0.35)
    outer = sphere(2.7, 0.15)
    spec = small_spec(
        lens__inner={"offset_mm": 1.4, "concave_radius_mm": BALL},
        lens__outer={"offset_mm": 3.0, "concave_radius_mm": BALL},
        constraints__cavity_height_mm=0.2,
        constraints__cavity_radius_mm=0.5,
        constraints__min_thickness_mm=0.3,
        base={"height_mm": 3.0, **base},
        manufacture={"cutter_radius_mm": BALL},
    )
    return Lens.double(inner, outer, spec, 0, CHECKED)


def tried(lens: Lens, mesh: trimesh.Trimesh) -> dict[str, float]:
    """Share of each face at which a ball on the exact surface is clear of the whole part; rings of equal area."""
    points = np.concatenate([mesh.vertices, trimesh.sample.sample_surface(mesh, OBSTACLES, seed=0)[0]])
    tree = cKDTree(points[np.hypot(points[:, 0], points[:, 1]) < 6.0])
    reached = {}
    for name, surface, side in (("inner", lens.inner, -1.0), ("outer", lens.outer, 1.0)):
        polar, turn = np.meshgrid(np.linspace(0.0, np.pi / 2.0, 61)[1:], np.linspace(0.0, 2.0 * np.pi, 73)[:-1])
        directions = to_sphere(
            (np.tan(polar / 2.0)[..., None] * np.stack([np.cos(turn), np.sin(turn)], -1)).reshape(-1, 2)
        )
        radius = surface.radius(directions)
        normals = surface.normal(directions)
        area = radius**2 * np.sin(polar).ravel() / np.sum(normals * directions, axis=1)
        area[np.isclose(polar.ravel(), np.pi / 2.0)] *= 0.5  # the last ring is half a ring
        clear = tree.query(radius[:, None] * directions + side * BALL * normals)[0] > BALL - GOUGE
        reached[name] = float(area[clear].sum() / area.sum())
    return reached


def part_mesh(lens: Lens) -> trimesh.Trimesh:
    mesh = build_mesh(make_plan(*fit_lens(lens), base_with_room(lens)), 96)
    return trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)


@pytest.mark.parametrize(
    "base",
    first_by_day(
        1,
        [
            {"pocket_diameter_mm": 4.0, "pocket_depth_mm": 2.9},
            {},
            {"pocket_diameter_mm": 8.0, "pocket_depth_mm": 1.5, "flange_diameter_mm": 28.0},
        ],
    ),
)
def test_a_base_that_says_nothing_gives_the_cutter_room(base: dict[str, float]) -> None:
    lens = designed_for_the_ball(**base)
    check = check_lens(lens)
    findings = {(verdict.key, verdict.place): verdict.holds for verdict in check.verdicts}
    assert findings[("relief", "inner")] and findings[("relief", "outer")] and findings[("cutter", "inner")]
    assert tried(lens, part_mesh(lens)) == {"inner": 1.0, "outer": 1.0}


@pytest.mark.parametrize(
    "base",
    first_by_day(
        1,
        [
            {"relief_step_mm": 0.6, "relief_setback_mm": 0.0, "bore_setback_mm": 0.05},
            {"bore_setback_mm": 0.0, "pocket_diameter_mm": 4.0, "pocket_depth_mm": 2.9},
            {"relief_step_mm": 0.0, "bore_setback_mm": 0.0},
            {"bore_setback_mm": 0.0, "pocket_diameter_mm": 3.2, "pocket_depth_mm": 2.5},
        ],
    ),
)
def test_a_base_in_the_way_costs_as_much_as_the_check_says(base: dict[str, float]) -> None:
    lens = designed_for_the_ball(**base)
    relief = check_lens(lens).relief
    shares = tried(lens, part_mesh(lens))
    assert min(shares.values()) < 0.99, "a case in which nothing is in the way"
    assert {name: face.flush_fraction for name, face in relief.faces.items()} == pytest.approx(shares, abs=0.02)


@pytest.mark.nightly("designs every shipped lens that is to be cut: minutes each")
@pytest.mark.parametrize("path", CUT, ids=lambda path: path.stem)
def test_every_shipped_lens_that_claims_to_be_cut_is_cut(path: Path, tmp_path: Path) -> None:
    spec = lf.load_spec(path)
    run = lf.run(spec, tmp_path / path.stem, accuracy="draft")
    assert run.verdict.cutting == "pass", run.verdict.reasons.cutting
    assert run.lens is not None and run.part is not None
    assert tried(run.lens, run.part.mesh) == {"inner": 1.0, "outer": 1.0}
