"""What a further thing costs: the files that CONTRIBUTING names, and one of each that the package does not know."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Literal

import numpy as np
import pytest
from chains import clear, tables_of, upwards
from presets import FAR
from rayfile_samples import rays as sample_rays
from scenes import small_spec
from undrawn import undrawn

import lensforge as lf
from lensforge.cad.body_export import build_body, prove
from lensforge.kernels.fate import Fate
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.optics.pose import Pose
from lensforge.proof.proof_inputs import independent_rays, optical_of, screens_of
from lensforge.proof.sequential_cast import CastFate
from lensforge.proof.verification import passage_through
from lensforge.results.arguments import threads_of_torch
from lensforge.scene.body import Body, Face
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.receiver_shapes import Plane, receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.sources.build_source import build_source
from lensforge.sources.rayfiles.ray_file_io import convert, read_rayfile, write_rayfile
from lensforge.spec import TargetSection, parse_spec
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid

ROOT = Path(__file__).parents[1]


def test_each_thing_to_add_touches_six_files_at_most_and_they_are_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:3] for line in text.splitlines() if re.match(r"\| an? ", line)]
    most = {"a target": 2, "a source": 3, "a receiver": 4, "a fixed face": 1, "a ray-file format": 1}
    assert {*most, "a kind of face", "a kind of lens", "a body"} <= {row[0].strip() for row in rows}
    for thing, places in rows:
        named = re.findall(r"`((?:lensforge|docs|examples)/[\w./]+)`", places)
        assert len(named) <= most.get(thing.strip(), 6), thing
        assert [place for place in named if not (ROOT / place).exists() and "NAME" not in place] == [], thing


@pytest.fixture(scope="module")
def added() -> Iterator[ModuleType]:
    """Kinds of a user's own, known for the tests of this module."""
    import added_kinds

    with added_kinds.forgotten_at_the_end():
        yield added_kinds


def test_a_face_of_a_kind_of_ones_own_is_traced_exported_and_cast(added: ModuleType) -> None:
    """A flat spheroid crops the shell of a body, all around."""
    body = Body(
        (
            Face("cap", sphere(4.0), CAVITY, BODY),
            Face("shell", sphere(9.0), BODY, OUTSIDE),
            Face("roof", added.Spheroid(40.0, 14.0, 7.0), BODY, OUTSIDE),
        )
    )
    media, rays, grid = clear(), upwards(200, 3, 0.5), TableGrid(401)
    traced = TracedLens.of_body(body, media, 3, 8.0)
    assert set(traced.table_error_nm) == {"cap", "shell", "roof"}
    design = TracedBundle.of(tables_of(body, grid), Scene(media, grid, True, None, body.chain(3)), rays)
    assert {0, 4, 8} <= set((design.met[design.met >= 0] // 4 * 4).tolist())
    built = build_body(body, rings=64)
    files = built.files("roof")
    proof = prove(built, *files)
    assert proof.solid.valid and proof.stl.watertight
    assert max(error.form_max_nm for error in proof.form.values()) < 1.0
    passage = passage_through(files[0], optical_of(body, 3), media, rays)
    left = design.exits.fates == Fate.LEFT_LENS
    assert np.array_equal(passage.fates == CastFate.LANDED, left) and left.sum() > 100
    assert np.linalg.norm(passage.points - design.exits.points, axis=1)[left].max() < 1e-5
    assert passage.flux[left] == pytest.approx(design.exits.flux[left], rel=1e-4)


SPEC = """
name = "added"
[source]
kind = "ring"
inner_mm = 0.5
outer_mm = 1.0
[lens]
levels = [9, 25]
symmetry = "none"
[lens.inner.fixed]
kind = "spheroid"
across_mm = 3.0
up_mm = 2.6
[lens.outer]
offset_mm = 6.0
[constraints]
min_thickness_mm = 1.0
max_radius_mm = 7.0
[[receivers]]
kind = "gable"
ridge_mm = 100.0
width_mm = 200.0
depth_mm = 160.0
pitch_deg = 20.0
[[receivers.targets]]
kind = "star"
radius_mm = 70.0
[optimise]
steps_per_level = [6, 6]
rays = 1024
pixels = 24
[evaluate]
rays = 4096
pixels = 24
[base]
diameter_mm = 16.0
"""


@pytest.fixture(scope="module")
def run(added: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> lf.Run:
    """A whole run of a spec that has one of each."""
    folder = tmp_path_factory.mktemp("added")
    (folder / "added.toml").write_text(SPEC, encoding="utf-8")
    with undrawn(), threads_of_torch(1):
        return lf.run(lf.load_spec(folder / "added.toml"), folder / "run", accuracy=FAR)


def test_one_of_each_goes_through_spec_search_evaluation_files_and_proof(run: lf.Run, tmp_path: Path) -> None:
    again = lf.load(run.folder)
    assert again.spec == run.spec and again.lens == run.lens
    run.spec.save(tmp_path / "again.toml")
    assert lf.load_spec(tmp_path / "again.toml").receivers == run.spec.receivers
    assert run.design.steps == 12 and run.light.nmse.value < 0.95 * lf.evaluate(_begun(run.lens)).nmse.value
    assert sum(run.light.flux.model_dump().values()) == pytest.approx(1.0, abs=1e-9)
    assert run.part.form_error_nm.max < 1.0 and all(criterion.holds for criterion in run.proof.criteria)
    (receiver,) = run.proof.receivers
    assert receiver.against_design.rms < 5e-5 * 100.0
    page = (run.folder / "report.html").read_text(encoding="utf-8")
    assert "1 mm ring source" in page and "star of 5 points, 70 mm long on a gable at 100 mm" in page


def _begun(lens: lf.Lens) -> lf.Lens:
    """The lens from which its search began."""
    return replace(lens, surfaces={**lens.surfaces, "outer": sphere(6.0)})


def test_a_target_of_ones_own_has_its_area_its_receiver_and_its_place_in_messages(added: ModuleType) -> None:
    star = {"kind": "star", "radius_mm": 60.0, "distance_mm": 100.0}
    spec = small_spec(target=star)
    assert spec.target.receiver_mm == 180.0, "1.5 times the square around it"
    receiver = receivers_of(spec, 256)[0]
    light = target_light((spec.target,), receiver)
    area = np.prod(receiver.grid.pixel) / light.max()
    assert area == pytest.approx(3.0 / 8.0 * np.pi * 60.0**2, rel=5e-3)
    x, y = receiver.grid.x(), receiver.grid.y()
    assert light[np.searchsorted(y, 0.0), np.searchsorted(x, 55.0)] > 0.0 == light[128, np.searchsorted(x, -55.0)]
    with pytest.raises(lf.InputError, match=r"target\.kind = 'stars': must be one of .*star; did you mean star\?"):
        small_spec(target={**star, "kind": "stars"})
    with pytest.raises(lf.InputError, match=r"target\.points = 2: .* 3"):
        small_spec(target={**star, "points": 2})
    with pytest.raises(lf.InputError, match=r"target: radius_mm: missing; give it, in mm"):
        small_spec(target={**star, "radius_mm": None})


def test_a_source_of_ones_own_has_its_flux_its_extent_and_rays_of_the_proof(added: ModuleType) -> None:
    ring = {"kind": "ring", "inner_mm": 0.8, "outer_mm": 1.0, "flux_w": 2.0, "position_mm": [0.0, 0.0, 0.1]}
    spec = small_spec(source=ring, constraints={"min_thickness_mm": 1.0, "max_radius_mm": 7.0})
    assert spec.constraints.cavity_radius_mm == 0.6, "1.2 times the circle around it"
    source = build_source(spec.source)
    for rays in (source.sample(2**14, 1), independent_rays(spec, source, 2**14, 2)):
        assert rays.flux.sum() == pytest.approx(2.0) and (rays.origins[:, 2] == 0.1).all()
        radius = np.hypot(*rays.origins[:, :2].T)
        assert radius.min() >= 0.4 and radius.max() <= 0.5
        assert (radius**2).mean() == pytest.approx(0.5 * (0.4**2 + 0.5**2), abs=1e-3)
        assert rays.directions[:, 2].mean() == pytest.approx(2.0 / 3.0, abs=0.01), "Lambert's cosine"


def test_a_receiver_of_ones_own_lands_rays_as_the_planes_of_which_it_is(added: ModuleType) -> None:
    """In light, its adjoint, and the screen of the proof, which has kernels for none of them."""
    spec = parse_spec(tomllib.loads(SPEC), "added")
    (gable,), (screen,) = receivers_of(spec, 24), screens_of(spec)
    random = np.random.default_rng(3)
    ways = random.normal(size=(400, 3)) + np.array([0.0, 0.0, 1.0])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ones, fates = np.ones(400), np.full(400, int(Fate.LEFT_LENS), dtype=np.int8)
    rays = ExitRays(random.uniform(-5.0, 5.0, (400, 3)), ways, ones, 0.0 * ones, fates)
    landings, by_hits = gable.land(rays), random.normal(size=(400, 2))
    by_hits[~landings.landed] = 0.0
    by, pitch = gable.sensitivities(rays, by_hits), np.radians(20.0)
    for side in (1.0, -1.0):
        pose = Pose.facing((side * np.sin(pitch), 0.0, np.cos(pitch)), (0.0, 0.0, 100.0))
        plane, here = Plane(pose, gable.grid), landings.landed & (side * landings.hits[:, 0] > 0.0)
        assert here.sum() > 100
        assert landings.hits[here] == pytest.approx(plane.land(rays).hits[here], abs=1e-9)
        for gradient, known in zip(by, plane.sensitivities(rays, by_hits), strict=True):
            assert gradient[here] == pytest.approx(known[here], abs=1e-9)
    assert np.where(landings.landed[:, None], landings.hits, np.nan) == pytest.approx(
        screen.land(rays.points, ways), abs=1e-9, nan_ok=True
    )
    with pytest.raises(lf.InputError, match=r"the gable leaves 6\.578 mm around the lens origin"):
        parse_spec(tomllib.loads(SPEC.replace("ridge_mm = 100.0", "ridge_mm = 7.0")), "added")


def test_a_fixed_face_of_ones_own_is_its_formula_and_its_record(added: ModuleType, tmp_path: Path) -> None:
    face = {"kind": "spheroid", "across_mm": 3.0, "up_mm": 2.0}
    lens = small_spec(lens={"levels": [9, 25], "inner": {"fixed": face}, "outer": {"offset_mm": 6.0}}).lens
    slant = np.array([[np.sqrt(0.5), 0.0, np.sqrt(0.5)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    surface = lens.inner.fixed.surface
    assert surface.radius(slant) == pytest.approx([1.0 / np.sqrt(0.5 / 9.0 + 0.5 / 4.0), 3.0, 2.0], rel=1e-12)
    tilt = np.array([1.0 / 9.0, 0.0, 1.0 / 4.0])
    assert surface.normal(slant)[0] == pytest.approx(tilt / np.linalg.norm(tilt), rel=1e-12)
    made = lf.Lens.double(surface, sphere(6.0), small_spec(), 0, "draft")
    made.save(tmp_path / "lens.json")
    assert lf.load_lens(tmp_path / "lens.json").inner == surface
    given = {"kind": "lens", "file": str(tmp_path), "face": "inner"}
    assert small_spec(lens={"levels": [9, 25], "inner": {"fixed": given}}).lens.inner.fixed.surface == surface
    with pytest.raises(lf.InputError, match=r"lens\.inner\.fixed\.up_mm = 0.*: "):
        small_spec(lens={"levels": [9, 25], "inner": {"fixed": {**face, "up_mm": 0.0}}})


def test_a_ray_file_format_of_ones_own_is_written_recognised_and_traced(added: ModuleType, tmp_path: Path) -> None:
    rays = sample_rays(40)
    write_rayfile(tmp_path / "led.csv", rays)
    assert convert(tmp_path / "led.csv", tmp_path / "led.sevens").to_format == "sevens"
    (tmp_path / "led.sevens").rename(tmp_path / "led.txt")
    back = read_rayfile(tmp_path / "led.txt")
    assert back.format == "sevens" and back.directions == pytest.approx(rays.directions, abs=1e-7)
    source = build_source(small_spec(source={"kind": "rayfile", "file": str(tmp_path / "led.txt")}).source)
    assert source.flux_w == pytest.approx(float(rays.flux.sum(dtype=np.float64)), rel=1e-6)
    (tmp_path / "none.txt").write_text("EIGHTS\n", encoding="utf-8")
    with pytest.raises(lf.InputError, match=r"none of the known formats \(.*, seven numbers\)"):
        read_rayfile(tmp_path / "none.txt")


def test_kinds_are_known_for_as_long_as_they_are_there() -> None:
    """Also where the classes that hold them are built already; afterwards they are refused as ever."""
    target = {"kind": "dot", "distance_mm": 100.0, "receiver_mm": 9.0}
    with pytest.raises(lf.InputError, match=r"target\.kind = 'dot': must be one of .*photometric"):
        small_spec(target=target)

    class DotTarget(TargetSection):
        kind: Literal["dot"] = "dot"

    class SmallDot(DotTarget):
        """The same kind in a script's own words, which no spec makes."""

    assert type(small_spec(target=target).target) is DotTarget
    with pytest.raises(lf.InputError, match=r"^OtherDot: kind = 'dot' is that of DotTarget; take another name$"):

        class OtherDot(TargetSection):
            kind: Literal["dot"] = "dot"

    del TargetSection.kinds["dot"]
    TargetSection.build_holders_again()
    with pytest.raises(lf.InputError, match=r"target\.kind = 'dot': must be one of .*photometric"):
        small_spec(target=target)
