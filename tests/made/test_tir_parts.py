"""Parts of a lens for total internal reflection: faces out of place against bodies in closed form, names, refusals."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from chains import REACH, clear, upwards
from known_shapes import sphere as ball
from tir_lenses import TIR, spot, spot_lens

import lensforge as lf
from lensforge.errors import InputError
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import trace_tables
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.made.sensitivity import measure_sensitivity, single_errors
from lensforge.scene.body import Body, nearest
from lensforge.scene.made_part import PartMaker
from lensforge.spec import TirSection
from lensforge.spec.tolerances_section import factors_of, read_tolerances
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import evaluate_table
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

TURN = 2e-3
STEP = 0.02
ALONG = (0.0, -np.sin(TURN), np.cos(TURN))  # the axis of a face tilted about x by the right hand
CONIC = ConicFace(REACH, 5.0, 0.8)
BALL = ball(9.0, (0.0, 0.0, 2.0))
# Deviations, the wall as designed, and what is moved: a conic about the origin stays one as it is tilted about it.
MOVED = {
    "wall_tilt_deg": ([TURN, 0.0], CONIC, {"wall": ConicFace(REACH, 5.0, 0.8, ALONG)}),
    "wall_shift_mm": ([STEP, -STEP], BALL, {"wall": ball(9.0, (STEP, -STEP, 2.0))}),
    "wall_gap_mm": ([STEP], BALL, {"wall": ball(9.0, (0.0, 0.0, 2.0 + STEP))}),
    "exit_tilt_deg": ([TURN, 0.0], CONIC, {"exit": PlaneFace(REACH, 8.0 / np.cos(TURN), ALONG)}),
    "exit_gap_mm": ([STEP], CONIC, {"exit": PlaneFace(REACH, 8.0 + STEP)}),
}


def faces_with(wall: Surface) -> dict[str, Surface]:
    return {"cap": sphere(4.0), "side": ConeFace(REACH, 3.2, 0.02), "wall": wall, "exit": PlaneFace(REACH, 8.0)}


@cache
def traced(wall: Surface) -> TracedLens:
    return TracedLens.of_body(Body.of(faces_with(wall), TirSection.roles), clear(), 6, 12.0)


@pytest.mark.parametrize("name", MOVED)
def test_the_light_of_a_face_out_of_place_is_that_of_the_moved_body(name: str) -> None:
    deviation, wall, moved = MOVED[name]
    faces = faces_with(wall)
    rays = upwards(2000, 1, 0.5)
    spec = spot()
    designed = traced(wall)
    other = TracedLens.of_body(Body.of({**faces, **moved}, TirSection.roles), clear(), 6, 12.0)
    factors = tuple(factor for factor in factors_of(spec.part_tolerances) if factor.name == name)
    part = PartMaker.of(spec, faces, designed.scene.grid, factors).part({name: np.array(deviation)})
    exits = trace_tables(part.tables(designed.tables), replace(designed.scene, made=part.made), rays)
    before = designed.trace(rays)
    wanted = other.trace(rays)
    same = wanted.left_lens & exits.left_lens & before.left_lens
    same &= (exits.met == wanted.met).all(axis=1) & (exits.met == before.met).all(axis=1)
    assert same.mean() > 0.7
    for kind in ("points", "directions"):
        off, effect = (
            np.sqrt(np.mean((getattr(ends, kind) - getattr(wanted, kind))[same] ** 2)) for ends in (exits, before)
        )
        assert off < 0.01 * effect or (name == "exit_gap_mm" and kind == "directions" and off < 2e-6)


def test_a_part_has_the_tolerances_of_its_faces_by_their_names() -> None:
    spec = spot(wall={"waviness_um": 0.3, "gap_mm": 0.0}, exit={"shift_mm": 0.01})
    factors = {factor.name: factor for factor in factors_of(spec.part_tolerances)}
    assert factors["wall_waviness_um"].amount == 0.3 and factors["cap_waviness_um"].amount == 0.1
    assert factors["exit_shift_mm"].phrase == "exit face against cap, decentre" and "wall_gap_mm" not in factors
    assert not {"cap_shift_mm", "side_shift_mm", "gap_mm", "side_tilt_deg"} & factors.keys()
    assert {f"{name}_form_um" for name in TIR} <= factors.keys()


def test_a_form_error_has_its_rms_over_the_part_of_the_face_that_light_meets() -> None:
    lens = spot_lens()
    study = PartStudy(Recipe(lens, 1, 256, 0, 256))
    u = fibonacci_hemisphere(20_000)
    factors = {factor.name: factor for factor in study.factors}
    for number, name in enumerate(TIR):
        (error,) = single_errors(study, factors[f"{name}_form_um"])
        table = study.leds[0].made(error.deviations)[0].errors[name]
        beside = lens.body.cavity if number < 2 else lens.body.envelope
        directions = u[nearest(beside, u) == number % 2]
        normal = lens.surfaces[name].normal(directions)
        along = evaluate_table(study.leds[0].light.nominal.scene.grid, table, directions) * np.sum(
            normal * directions, axis=1
        )
        assert np.sqrt(np.mean(along**2)) == pytest.approx(1e-3, rel=0.03), name


def test_sensitivity_and_yield_know_every_face() -> None:
    smooth = {name: {"waviness_um": 0.0, "ripple_um": 0.0, "form_um": 0.0} for name in ("cap", "side", "exit")}
    lens = spot_lens(spot(**smooth))
    rows = {row.name for row in measure_sensitivity(lens, rays=64).rows}
    assert {"wall face against cap, tilt about y", "exit face against cap, gap", "waviness, wall face"} <= rows
    assert {"roughness, side face", "refractive index"} <= rows and "waviness, cap face" not in rows
    result = lf.tolerance(lens, parts=40, rays=64, budget=False)
    assert [bound.metric for bound in result.bounds] == ["limits.0: share of the flux"]
    assert {"wall_shift_mm 2", "cap_roughness_mrad", "wall_waviness_um 32", "exit_tilt_deg 1"} <= set(result.columns)


@pytest.mark.parametrize(("face", "field"), [("side", "shift_mm"), ("cap", "tilt_deg")])
def test_a_place_of_the_cavity_is_refused(face: str, field: str) -> None:
    message = rf"{face}\.{field}: this face is what the next is placed against; give wall\.{field}"
    with pytest.raises(InputError, match=message):
        spot(**{face: {field: 0.1}})


def test_tolerances_of_other_faces_are_refused(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("[lens.wall]\nform_um = 0.4\n", encoding="utf-8")
    tolerances = read_tolerances(str(tmp_path / "own.toml"), TirSection.roles)
    assert spot().with_tolerances(tolerances).part_tolerances.amount("wall", "form_um") == 0.4
    with pytest.raises(InputError, match=r"own\.toml: lens\.wall: the faces of this lens are inner, outer; give these"):
        read_tolerances(str(tmp_path / "own.toml"))
    with pytest.raises(InputError, match="tolerances of the faces outer: this lens has cap, side, wall, exit"):
        lf.tolerance(spot_lens(), tolerances=lf.PartTolerances(faces={"outer": {"gap_mm": 0.1}}))
