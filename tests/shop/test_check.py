import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_shapes import exported, random_surface
from presets import FEW
from scenes import hemisphere_directions, sphere
from scipy.spatial import cKDTree
from shop_lenses import small_lens

import lensforge as lf
from lensforge.cad.face_tolerance import CHECKED
from lensforge.cad.part_export import build_part
from lensforge.cad.plan import INNER, OUTER, lay_out
from lensforge.cad.step import parse_step
from lensforge.scene.lens import Lens
from lensforge.shop.ball_clearance import check_ball_clearance
from lensforge.shop.check import check_lens
from lensforge.shop.check_result import Check
from lensforge.shop.face_check import milled_face
from lensforge.shop.face_samples import AirSide
from lensforge.shop.findings import clearance_findings
from lensforge.spec import BaseSection
from lensforge.surfaces import surface as chart

INNER_MM = 0.8
OUTER_MM = 2.45


def lens(inner, outer, cutter_mm=1.0, wall_mm=0.5, base="cylinder"):
    limits = {"cavity_height_mm": 0.5, "cavity_radius_mm": 0.5, "min_thickness_mm": wall_mm, "max_radius_mm": 3.0}
    offsets = {"inner": {"offset_mm": INNER_MM}, "outer": {"offset_mm": OUTER_MM}, "levels": [9, 25]}
    made = small_lens({"kind": base}, {"cutter_radius_mm": cutter_mm}, lens=offsets, constraints=limits)
    return Lens.double(inner, outer, made.spec, seed=0, accuracy=FEW)


@pytest.fixture(scope="module")
def rough():
    part = lens(random_surface(INNER_MM, 0.04, 1), random_surface(OUTER_MM, 0.04, 2), cutter_mm=0.6)
    return part, check_lens(part)


@pytest.fixture(scope="module")
def plain():
    """Two hemispheres, without a base."""
    return check_lens(lens(sphere(INNER_MM), sphere(OUTER_MM), wall_mm=2.0, base="none"))


def verdict(check, name, surface):
    return next(v for v in check.verdicts if (v.key, v.place) == (name, surface))


def test_the_faces_measured_are_those_of_the_step_file(rough):
    """By the CAD kernel, on a file within 0.5 nm as read back; the exact surfaces are further off than is allowed."""
    from OCP.BRep import BRep_Tool
    from OCP.GeomLProp import GeomLProp_SLProps

    part = build_part(rough[0], tolerance=CHECKED, rings=16)
    check = check_lens(part.lens)
    solid = parse_step(part.step)
    axis = check.chart_axis
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    places = rng.permutation(np.argwhere(np.hypot(x, y) <= 1.0))[:200]
    for name, surface, air in ((INNER, "inner", -1.0), (OUTER, "outer", 1.0)):
        kernel = BRep_Tool.Surface_s(solid.faces[name])
        sphere = check.faces[surface].best_fit_sphere
        away = []
        for i, j in places:
            at = GeomLProp_SLProps(kernel, axis[i], axis[j], 2, 1e-9)
            point = np.array(at.Value().Coord())
            # The kernel's normal points outwards, its curvature is positive where the face bends towards the normal.
            kappa = np.sort([-air * at.MinCurvature(), -air * at.MaxCurvature()])
            assert np.abs(check.faces[surface].xyz[i, j] - point).max() < 1e-11
            measured = [getattr(check.faces[surface], f"kappa_{end}")[i, j] for end in ("min", "max")]
            np.testing.assert_allclose(measured, kappa, rtol=0.0, atol=1e-8)
            away.append(np.linalg.norm(point - sphere.centre_mm) - sphere.radius_mm)
        sag_mm = check.faces[surface].sag_mm[tuple(places.T)]
        np.testing.assert_allclose(sag_mm, away, rtol=0.0, atol=1e-11)
        lens_surface = part.lens.surfaces[surface]
        u = chart.to_sphere(np.stack([axis[places[:, 0]], axis[places[:, 1]]], axis=-1))
        exact = lens_surface.radius(u)[:, None] * u
        assert np.abs(check.faces[surface].xyz[tuple(places.T)] - exact).max() > 1e-10


def test_the_numbers_of_two_hemispheres(plain):
    for name, radius, sign in (("inner", INNER_MM, -1.0), ("outer", OUTER_MM, 1.0)):
        face = getattr(plain, name)
        assert abs(face.best_fit_sphere.radius_mm - radius) < 1e-8
        assert face.best_fit_sphere.pv_mm < 1e-7
        assert abs(face.curvature.kappa_min_per_mm - sign / radius) < 1e-5
        assert face.undercut_fraction == 0.0
        assert abs(face.area_mm2 / (2.0 * np.pi * radius**2) - 1.0) < 1e-8
        assert face.largest_tilt_deg == pytest.approx(0.0, abs=1e-4) and abs(face.draft_deg.min) < 1e-4
    assert abs(plain.min_wall_mm - (OUTER_MM - INNER_MM)) < 1e-7
    assert abs(plain.inner.cutter.largest_radius_mm - INNER_MM) < 1e-5
    assert plain.inner.cutter.reachable_fraction == 0.0
    assert plain.inner.cutter.residual_mm is None
    assert plain.outer.cutter.reachable_fraction == 1.0
    assert plain.outer.cutter.largest_radius_mm is None
    assert plain.outer.curvature.smallest_concave_radius_mm is None
    assert plain.relief.faces == {}
    assert plain.relief.note == "there is no base"


def test_the_criterion_is_the_wall_that_the_spec_promises(plain, rough):
    (failed,) = plain.criteria
    assert not failed.holds  # 1.65 mm where 2 mm was asked for
    assert abs(failed.value - (OUTER_MM - INNER_MM)) < 1e-7
    part, check = rough
    (held,) = check.criteria
    assert held.holds
    u = hemisphere_directions(20_000)
    inner = part.inner.radius(u)
    outer = part.outer.radius(u)
    shortest = cKDTree(outer[:, None] * u).query((inner[:, None] * u)[::8])[0].min()
    assert shortest - 5e-3 < held.value <= shortest
    assert check.min_wall_mm == check.walls.thinnest.thickness_mm == held.value < (outer - inner).min()


def test_the_maps_belong_to_the_exact_surfaces(rough):
    part, check = rough
    axis = check.chart_axis
    x, y = np.meshgrid(axis, axis, indexing="ij")
    inside = np.hypot(x, y) <= 1.0 + 1e-12
    u = chart.to_sphere(np.stack([x, y], axis=-1)[inside])
    for name, surface in (("inner", part.inner), ("outer", part.outer)):
        face = getattr(check, name)
        xyz, sag_mm, kappa_min, kappa_max, left = (
            getattr(face, key) for key in ("xyz", "sag_mm", "kappa_min", "kappa_max", "residual_mm")
        )
        assert xyz.shape == (len(axis), len(axis), 3)
        assert np.abs(xyz[inside] - surface.radius(u)[:, None] * u).max() < 1e-6
        assert np.isnan(xyz[~inside]).all()
        sag = np.linalg.norm(xyz[inside] - face.best_fit_sphere.centre_mm, axis=1) - face.best_fit_sphere.radius_mm
        assert np.abs(sag_mm[inside] - sag).max() < 1e-12
        assert np.nanmin(kappa_min) >= face.curvature.kappa_min_per_mm - 1e-12
        assert (kappa_max >= kappa_min)[inside].all()
        assert np.nanmax(left) <= face.cutter.residual_mm
        steepest = np.degrees(np.arccos(surface.normal(u)[:, 2].min()))
        assert face.largest_tilt_deg == pytest.approx(steepest - 90.0, abs=1.0) and steepest > 92.0


def test_what_the_verdict_asks_for_is_enough(rough):
    # An undercut dome on a flush base wants a step and a set-back wall; with both, the verdict holds.
    part, _ = rough
    inner = milled_face(exported(part.inner, AirSide.INSIDE), 0.6, 61)
    outer = milled_face(exported(part.outer, AirSide.OUTSIDE), 0.6, 61)
    base = {"height_mm": 6.0}
    for _ in range(3):
        plan = lay_out(inner.samples.face.patch, outer.samples.face.patch, BaseSection(**base))
        finding = clearance_findings(check_ball_clearance(plan, None, {"inner": inner, "outer": outer}), plan.base)[1]
        if finding.holds:
            break
        base |= {key: float(value) for key, value in re.findall(r"base\.(\w+) = ([\d.]+)", finding.remedy)}
    assert finding.holds
    assert set(base) == {"height_mm", "relief_step_mm", "relief_setback_mm"}


@pytest.mark.parametrize("process", ["moulded", "printed", "turned"])
def test_a_part_is_judged_by_another_process_as_if_its_spec_named_it(process: str, tmp_path: Path) -> None:
    """And the record is read back beside the lens's own, which alone decides."""
    made = lens(sphere(INNER_MM), random_surface(OUTER_MM, 0.04, 2))
    made = replace(made, spec=made.spec.replace({"manufacture.layer_um": 9.0, "manufacture.process": "printed"}))
    of_process = {"process": process} if process == "printed" else {"process": process, "layer_um": None}
    stated = check_lens(replace(made, spec=made.spec.replace(manufacture=of_process)))
    result = lf.check(made, process=process)
    if process == "printed":
        assert result.conditions is None, "it is the spec's own"
        return
    assert result.inputs == {"lens": made.sha256} and str(result.conditions) == process
    fields = {"lens": stated.lens, "inputs": stated.inputs, "seconds": stated.seconds}
    assert result.changed(conditions=None, **fields) == stated
    made.save(tmp_path / "lens.json")
    result.save(tmp_path / f"check_{process}.json")
    run = lf.load(tmp_path)
    assert run.find(Check) is None and run.others[f"check_{process}"] == result
    labels = [fact.label for group in run.facts(result) for fact in group.facts]
    assert ("Parting line" in labels) == (process == "moulded")
