"""IES files that lie: refused in one line, or read with a warning that names the contradiction."""

import pytest
from refusals import one_line

import lensforge as lf
from lensforge.errors import InputError
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.photometric import read_photometric
from lensforge.sources.photometric_summary import rays


def _ies(head="1 1000 1 3 1 1 2 0 0 0 1 1 10", angles="0 45 90 0", candela="300 200 0", tilt="NONE") -> str:
    return f"IESNA:LM-63-2002\nTILT={tilt}\n{head}\n{angles}\n{candela}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (_ies(head="1 1000 1 1000000 1 1 2 0 0 0 1 1 10"), "truncated"),
        (_ies(head="1 1000 1 2 5000 1 2 0 0 0 1 1 10", angles="0 90 " + " ".join(map(str, range(5000))),
              candela="1 " * 10_000), "5000 angles of one kind, at most 3601"),
        (_ies(candela="3_00 200 0"), "not all that follows TILT= are numbers"),
        (_ies(candela="1e-320 1e-320 0"), "intensities from"),
        (_ies(angles="0 0.00001 90 0"), "must rise, by 0.0001"),
        (_ies(angles="179.9998 179.9999 180 0", candela="0 0 1e-25"), "hold no flux"),
    ],
)  # fmt: skip
def test_lm_63_that_lies_is_refused(text, message, tmp_path):
    (tmp_path / "x.ies").write_text(text)
    with pytest.raises(InputError, match=message) as refusal:
        read_photometric(tmp_path / "x.ies")
    one_line(refusal)


@pytest.mark.parametrize(
    ("text", "phrase"),
    [
        (_ies(head="0 1000 1 3 1 1 2 0 0 0 1 1 10"), "0 lamps of 1000 lm: taken as absolute"),
        (_ies(head="1 10 1 3 1 1 2 0 0 0 1 1 10"), "its lamps only 10 lm"),
        (_ies(head="1 1000 1 3 1 1 2 0 0 0 1 1 0.01"), "no light has more than 683"),
        (_ies(angles="0 45 90 30"), "only half-plane is C 30"),
        (_ies(head="1 1000 1 3 3 1 2 0 0 0 1 1 10", angles="0 45 90 0 180 360", candela="3 2 0 3 2 0 3 1 0"),
         "C 0 and C 360, which are one, differ by 0.33"),
        (_ies(candela="300 200 -1"), "below 0"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_told_in_a_summary_and_in_a_design(text, phrase, tmp_path):
    (tmp_path / "x.ies").write_text(text)
    section = lf.DiscSource(diameter_mm=1.0, intensity={"kind": "photometric", "file": tmp_path / "x.ies"})
    placed = section.model_copy(update={"position_mm": (0.0, 0.0, -1.0)})
    for warnings in (
        rays(tmp_path / "x.ies").warnings,
        summarise(build_source(section), section).warnings,
        summarise(build_source(placed), placed).warnings,
    ):
        assert any(phrase in warning for warning in warnings), warnings


def test_one_half_plane_at_0_and_360_is_light_of_revolution(tmp_path):
    text = _ies(head="1 1000 1 3 2 1 2 0 0 0 1 1 10", angles="0 45 90 0 360", candela="300 200 0 300 200 0")
    (tmp_path / "x.ies").write_text(text)
    assert read_photometric(tmp_path / "x.ies").intensity.c_deg.tolist() == [0.0]
