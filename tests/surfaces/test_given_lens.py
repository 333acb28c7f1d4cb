"""A lens whose inner face was written as STEP and given back: the same light, and the same face to a nanometre."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cad_shapes import write

import lensforge as lf
from lensforge.cad.form_error import chart_samples, fit_to_form
from lensforge.cad.solid import untrimmed_faces
from lensforge.scene.lens import load_lens
from lensforge.spec.fixed_surface import FixedCadFace

LENSES = Path(__file__).parents[1] / "definitions" / "lenses"


@pytest.mark.nightly("half a minute; by day a smoother face, in test_given_faces.py")
def test_the_inner_face_of_the_pi_given_back(tmp_path: Path) -> None:
    lens = load_lens(LENSES / "pi.json")
    patch = fit_to_form(lens.inner)
    path = write(untrimmed_faces({"OPTICAL_INNER": patch})["OPTICAL_INNER"], tmp_path / "inner.step")
    given = FixedCadFace(file=path).resolved()
    assert given.form_error_nm < 1.0
    chart = chart_samples(4096)
    again = fit_to_form(given.surface)
    # nearest distance: the difference along the normal
    apart = np.abs(np.sum((again.points(chart) - patch.points(chart)) * patch.normals(chart), axis=1)).max() * 1e6
    assert apart < 1.0
    before, after = (lf.evaluate(each, rays=2**18) for each in (lens, replace(lens, inner=given.surface)))
    for name in ("nmse", "efficiency", "share_in_target"):
        one, other = getattr(before, name), getattr(after, name)
        assert abs(one.value - other.value) < one.standard_error, name
