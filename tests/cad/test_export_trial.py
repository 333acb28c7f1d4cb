"""What an export is to keep before it is made: displacements of known errors, and files that use half of a limit."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_lenses import ALL_LEVELS, make_lens

from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.face_tolerance import FaceTolerance
from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh import build_mesh
from lensforge.cad.plan import make_plan
from lensforge.light.simulation import TracedLens, design_landings
from lensforge.proof import export_trial
from lensforge.proof.acceptance import BREP_DEVIATION_RAD
from lensforge.proof.export_trial import Fineness, _Trial, fineness
from lensforge.scene.lens import Lens
from lensforge.surfaces.surface import ScaledSurface

FINE = FaceTolerance(form_nm=1.0, normal_mrad=0.02)
COARSE = FaceTolerance(form_nm=5e3, normal_mrad=5.0)
FAR_MM = 100.0


@pytest.fixture(scope="module")
def lens() -> Lens:
    return make_lens(3.0, 7.0, 0.02, seed=5, levels=(9, 25), base={"kind": "none"})


@pytest.fixture(scope="module")
def trial(lens: Lens) -> _Trial:
    return _Trial(lens)


def test_faces_of_another_size_use_what_their_light_is_displaced(lens: Lens, trial: _Trial) -> None:
    """A cavity that is larger by 1e-4, traced by itself: rms of its landings over 5e-5 rad at the same distance."""
    pair = fit_lens(lens, tolerance=FINE)
    grown = pair[0].of([replace(face.shape, control=1.0001 * face.shape.control) for face in pair[0].faces])
    rays = trial._rays
    surfaces = {**lens.surfaces, "inner": ScaledSurface(lens.surfaces["inner"], 1.0001)}
    landed = [
        design_landings(TracedLens._of_one(design, 12.0), lens.spec, rays)[0].hits
        for design in (lens, Lens(surfaces, lens.spec, lens.seed, lens.accuracy))
    ]
    half = 0.5 * lens.spec.all_receivers[0].width_mm
    both = (np.abs(landed[0]) < half).all(axis=1) & (np.abs(landed[1]) < half).all(axis=1)
    rms = np.sqrt(np.mean(np.sum((landed[0][both] - landed[1][both]) ** 2, axis=1)))
    light = trial._expected[0]
    reach_mm = light.screen.reach_mm(light.irradiance)
    assert FAR_MM < reach_mm < 1.5 * FAR_MM
    assert trial.used_by_faces((grown, pair[1])) == pytest.approx(rms / (BREP_DEVIATION_RAD * reach_mm), rel=0.03)
    assert trial.used_by_faces(pair) < 0.1


def test_normals_and_rings_are_as_fine_as_half_of_what_verification_allows() -> None:
    """From a tolerance with which the faces use more than all of it; rings that are given stay as they are."""
    lens = make_lens(3.0, 7.0, 0.05, seed=5, levels=ALL_LEVELS, base={"kind": "none"})
    trial = _Trial(lens)
    assert trial.used_by_faces(fit_lens(lens, tolerance=COARSE)) > 1.0
    resolution = fineness(lens, COARSE)
    pair = fit_lens(lens, tolerance=resolution.tolerance)
    assert resolution.tolerance.normal_mrad < COARSE.normal_mrad and resolution.tolerance.form_nm == COARSE.form_nm
    assert trial.used_by_faces(pair) <= 0.5
    plan = make_plan(*pair, base_with_room(lens))
    assert trial.used_by_mesh(build_mesh(plan, resolution.rings, 2e-3)) <= 0.5
    assert trial.used_by_mesh(build_mesh(plan, 12)) > 1.0
    assert fineness(lens, resolution.tolerance, rings=12) == Fineness(resolution.tolerance)


def test_a_trial_ends_and_tells_what_its_facets_use(monkeypatch: pytest.MonkeyPatch) -> None:
    """With so few triangles no finer mesh is tried; the first one uses more than all, and is told, not refused."""
    lens = make_lens(3.0, 7.0, 0.05, seed=5, levels=ALL_LEVELS, base={"kind": "none"})
    monkeypatch.setattr(export_trial, "rings_for", lambda *_: 12)
    coarse = make_plan(*fit_lens(lens, tolerance=FINE), base_with_room(lens))
    monkeypatch.setattr(export_trial, "_MOST_TRIANGLES", len(build_mesh(coarse, 12, 1.0).triangles))
    monkeypatch.setattr(export_trial, "CHORD_MM", 1.0)
    built = []
    monkeypatch.setattr(export_trial, "build_mesh", lambda *given: built.append(given[1]) or build_mesh(*given))
    with pytest.warns(UserWarning, match=r"with 12 rings the facets of lens.stl use [1-9][.0-9]* times what"):
        assert fineness(lens, FINE).rings == 12
    assert built == [12], "others are known to be too large before they are made"


def test_a_step_beyond_the_most_triangles_goes_as_far_as_they_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first mesh uses so much that 2.5 times its rings are wanted: 30, where triangles allow 22."""
    lens = make_lens(3.0, 7.0, 0.05, seed=5, levels=ALL_LEVELS, base={"kind": "none"})
    monkeypatch.setattr(export_trial, "rings_for", lambda *_: 12)
    monkeypatch.setattr(export_trial, "CHORD_MM", 1.0)
    plan = make_plan(*fit_lens(lens, tolerance=FINE), base_with_room(lens))
    most = len(build_mesh(plan, 23, 1.0).triangles)
    monkeypatch.setattr(export_trial, "_MOST_TRIANGLES", most)
    with pytest.warns(UserWarning, match="what verification allows"):
        assert fineness(lens, FINE).rings in (21, 22, 23)


def test_a_mesh_that_its_detail_makes_finer_than_any_on_trial_is_not_cast(
    lens: Lens, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export_trial, "rings_for", lambda *_: 12)
    monkeypatch.setattr(export_trial, "_MOST_TRIANGLES", 100)
    monkeypatch.setattr(_Trial, "used_by_mesh", lambda *_: pytest.fail("cast"))
    assert fineness(lens, FINE).rings == 12


def test_nodes_that_are_given_are_kept(lens: Lens) -> None:
    assert fineness(lens, COARSE, nodes=20, rings=12).tolerance == COARSE
