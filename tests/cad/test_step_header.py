"""Header and tolerances of the STEP file, read back from its bytes."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cadquery import importers
from geometry_lenses import make_lens, off_grid_chart
from nightly import first_by_day

from lensforge.cad import step
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.form_error import face_points, fit_lens
from lensforge.cad.part import Part
from lensforge.cad.part_export import build_part
from lensforge.cad.part_limits import FormTolerance
from lensforge.cad.plan import make_plan
from lensforge.cad.solid import build_solid
from lensforge.cad.step import (
    form_tolerances,
    parse_step,
    parse_surfaces,
    read_tolerances,
    require_written,
    signed_step,
)
from lensforge.errors import InputError
from lensforge.surfaces.surface import to_sphere


def lens_for(base=None, **manufacture):
    lens = make_lens(0.8, 2.45, 0.01, base=base)
    return replaced(lens, manufacture)


def replaced(lens, manufacture):
    return replace(lens, spec=lens.spec.replace({"manufacture": manufacture}))


@pytest.fixture(scope="module")
def signed():
    """A signed part of AP214, whose spec has a tolerance."""
    shop = {"author": "J. O'Neil \\ Zoë", "organisation": "Optik λ", "date": "2026-03-31"}
    return build_part(lens_for(form_tolerance_um=1.0, **shop), rings=16, extension_deg=5.0)


@cache
def tolerated(base_index: int) -> Part:
    """A part of AP242 with a tolerance, on one of ``BASES``."""
    return build_part(lens_for(BASES[base_index][0], form_tolerance_um=1.2345), rings=16, schema="AP242")


def header(content: bytes) -> str:
    """The HEADER section, its lines joined."""
    return content.decode("ascii").split("ENDSEC;")[0].replace("\n", "")


def test_the_header_states_date_author_and_organisation_of_the_spec(signed):
    part = signed
    lens = signed.lens
    for content in (part.step, part.surfaces_step):
        text = header(content)
        assert "'2026-03-31T00:00:00'" in text
        assert "'J. O''Neil \\X2\\005C\\X0\\ Zo\\X2\\00EB\\X0\\'" in re.sub(r"\s{2,}", "", text)
        assert "'Optik \\X2\\03BB\\X0\\'" in text
    assert part.signature.model_dump() == {
        "author": "J. O'Neil \\ Zoë",
        "organisation": "Optik λ",
        "date": "2026-03-31",
    }
    solid = build_solid(make_plan(*fit_lens(lens), base_with_room(lens)))
    assert signed_step(solid, lens.spec, lens.spec.name, "AP214").content == part.step, "no clock in it"


BASES = [
    ({"kind": "none"}, {"RIM"}),
    ({"diameter_mm": 8.0}, {"BASE_TOP"}),
    ({"diameter_mm": 8.0, "relief_step_mm": 0.3}, set()),  # its top is below z = 0
    ({"diameter_mm": 8.0, "relief_step_mm": 0.3, "relief_setback_mm": 0.1}, {"RIM"}),
]


@pytest.mark.parametrize("base", first_by_day(1, [1, 0, *range(2, len(BASES))]))
def test_ap242_carries_the_form_tolerance_on_the_optical_faces(base):
    part = tolerated(base)
    datum = BASES[base][1]
    callouts = read_tolerances(part.step)
    assert {tolerance.face for tolerance in callouts} == {"OPTICAL_OUTER", "OPTICAL_INNER"}
    for callout in callouts:
        assert callout.width_um == pytest.approx(1.2345, rel=1e-12)
        assert {re.sub(r"^BASE_TOP.*", "BASE_TOP", name) for name in callout.datum_faces} == datum
    assert sorted(tolerance.face for tolerance in part.form_tolerances) == sorted(
        tolerance.face for tolerance in callouts
    )
    assert part.criteria and all(criterion.holds for criterion in part.criteria)
    assert set(parse_step(part.step).faces) == set(part.faces.names), "names and faces are kept"


def test_without_a_date_the_time_stamp_is_empty_and_the_kernel_reads_the_file(tmp_path):
    part = tolerated(1)
    path = tmp_path / "undated.step"
    assert part.signature.date is None
    assert re.search(r"FILE_NAME\('[^']*',\s*'',\s*\(", header(part.step))
    path.write_bytes(part.step)
    assert importers.importStep(str(path)).val().Volume() == pytest.approx(part.volume_mm3, rel=1e-6)


def test_the_number_in_the_file_has_the_unit_that_makes_it_micrometres():
    """Read by hand, without the kernel: the number times its own unit, and the face by its reference."""
    part = tolerated(1)
    lines = dict(re.findall(r"#(\d+) = (.*?);", part.step.decode("ascii").replace("\n", ""), flags=re.S))
    profiles = [text for text in lines.values() if "SURFACE_PROFILE_TOLERANCE" in text]
    assert len(profiles) == 2
    for text in profiles:
        measure, aspect = re.search(r"GEOMETRIC_TOLERANCE\('.*?','.*?',#(\d+),#(\d+)\)", text).groups()
        number, unit = re.search(r"LENGTH_MEASURE\((.*?)\),#(\d+)", lines[measure]).groups()
        metres = {"$": 1.0, ".MILLI.": 1e-3}[re.search(r"SI_UNIT\((.*?),\.METRE\.\)", lines[unit]).group(1)]
        assert float(number) * metres == pytest.approx(1.2345e-6, rel=1e-12)
        usage = next(t for t in lines.values() if t.startswith("GEOMETRIC_ITEM_SPECIFIC_USAGE") and f"#{aspect}," in t)
        face = lines[re.findall(r"#(\d+)", usage)[-1]]
        assert re.match(r"ADVANCED_FACE\('OPTICAL_(OUTER|INNER)'", face)


def test_ap214_and_a_spec_without_tolerance_carry_none(signed):
    plain = build_part(make_lens(0.8, 2.45, 0.01), rings=16, schema="AP242")
    for part in (plain, signed):
        assert part.form_tolerances == ()
        assert b"TOLERANCE" not in part.step
        assert b"DATUM" not in part.step


def test_tolerances_that_the_kernel_writes_otherwise_are_refused_in_one_line():
    part = tolerated(1)
    wanted = form_tolerances(parse_step(part.step).faces, 1000.0)
    with pytest.raises(
        InputError, match=r"^manufacture\.form_tolerance_um = 1000: .* writes 1\.2345 um on OPTICAL"
    ) as caught:
        require_written(part.step, wanted)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("faces", [("A", "A", "B"), ("A", "B", "C")])
def test_a_doubled_or_additional_tolerance_is_refused(monkeypatch, faces):
    written = [FormTolerance(face=name, width_um=2.0, datum_faces=()) for name in faces]
    monkeypatch.setattr(step, "read_tolerances", lambda _: written)
    wanted = tuple(FormTolerance(face=name, width_um=2.0, datum_faces=()) for name in "AB")
    with pytest.raises(InputError, match=r"form_tolerance_um = 2: .* writes 3 tolerances for 2; export with AP214"):
        require_written(b"", wanted)


@pytest.mark.parametrize(
    "shrinkage", first_by_day(0, [0.005, 0.1], "two parts; by day the table of the shop is scaled")
)
def test_the_untrimmed_faces_of_an_insert_are_the_lens_s_times_one_plus_shrinkage(shrinkage):
    plain = lens_for(process="moulded")
    shrunk = lens_for(process="moulded", shrinkage=shrinkage)
    part, moulded = (build_part(lens, rings=16, extension_deg=5.0) for lens in (shrunk, plain))
    assert part.step == moulded.step, "the part is the lens, whose light is verified"
    assert (part.stl, part.volume_mm3) == (moulded.stl, moulded.volume_mm3)
    assert part.untrimmed_surfaces.scale == 1.0 + shrinkage
    assert part.untrimmed_surfaces.form_error_nm < 1.0
    assert f"scaled by {1 + shrinkage:.12g}" in header(part.surfaces_step)
    faces = parse_surfaces(part.surfaces_step)
    before = parse_surfaces(moulded.surfaces_step)
    chart = off_grid_chart(500)
    for name, face in faces.items():
        points, normals = face_points(face, chart)
        as_lens, same_normals = face_points(before[name], chart)
        np.testing.assert_allclose(points, (1.0 + shrinkage) * as_lens, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(normals, same_normals, rtol=0.0, atol=1e-10)
        surface = plain.outer if name == "OPTICAL_OUTER" else plain.inner
        radius = np.linalg.norm(points, axis=1)
        np.testing.assert_allclose(radius, (1.0 + shrinkage) * surface.radius(to_sphere(chart)), atol=1e-6)


def test_the_date_that_is_asked_for_goes_before_that_of_the_spec(signed):
    for asked, date in (("2026-11-05", "2026-11-05"), (None, "2026-03-31")):
        step_file = signed_step(parse_step(signed.step), signed.lens.spec, "lens", "AP214", asked)
        assert step_file.signature.date == date
        assert f"'{date}T00:00:00'" in header(step_file.content)
