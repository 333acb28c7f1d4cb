"""Files of the photometry: who computed them, and when; other readers find the light within its stated error."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from far_fields import flux
from other_readers import by_element, by_photompy, by_position
from scenes import small_spec
from test_photometry import ROUGH, SYMMETRIC, THROUGH, measured

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.light.light_facts import photometry_facts
from lensforge.light.photometry_result import Photometry

DATED = replace(ROUGH, spec=small_spec(manufacture__date="2026-03-01"))


@pytest.fixture(scope="module")
def cosine(tmp_path_factory):
    """The far field of a point source in concentric spheres, T cos(gamma) / pi, and the folder of its files."""
    folder = tmp_path_factory.mktemp("cosine")
    photometry = measured(replace(SYMMETRIC, spec=small_spec(source__side_mm=0.0)), rays=2**17, lumens=250.0)
    photometry.write(folder)
    return photometry, folder


@pytest.mark.parametrize("suffix", [".ies", ".ldt", ".iesxml"])
def test_other_readers_find_the_light_within_its_stated_error(suffix, cosine):
    """The record's candela to the digits written; the closed form within the standard error of each node."""
    photometry, folder = cosine
    read = by_element if suffix == ".iesxml" else by_photompy
    c, gamma, candela, lumens, _ = read(folder / f"lens{suffix}")
    assert lumens == 250.0
    np.testing.assert_allclose(candela, photometry.candela, rtol=5e-7, atol=1e-9)
    assert (np.abs(candela - photometry.candela) <= photometry.candela_standard_error).all()
    assert flux(c, gamma, candela) == pytest.approx(photometry.exit_lm.value, rel=1e-6)
    truth = 250.0 * THROUGH / np.pi * np.cos(np.deg2rad(gamma))
    assert (np.abs(candela - truth) < 6.0 * photometry.candela_standard_error + 0.004 * truth[0]).all()
    bright = photometry.candela > 0.1 * photometry.candela.max()
    assert np.abs(candela / truth - 1.0)[bright].max() < 6.0 * photometry.node_error.max


def test_the_file_of_a_lamp_holds_the_light_of_all_its_lenses(cosine, tmp_path):
    """They stand beside the files of one lens; both say whose light they hold, and so do the figures."""
    alone, folder = cosine
    spec = small_spec(source__side_mm=0.0, photometry={"lenses": 12})
    photometry = measured(replace(SYMMETRIC, spec=spec), rays=2**12, lumens=250.0)
    photometry.write(tmp_path)
    # in an IES file of each of the 12, in the others of all
    for suffix, read, of_lamp in (
        (".ies", by_photompy, 250.0),
        (".ldt", by_photompy, 3000.0),
        (".iesxml", by_element, 3000.0),
    ):
        _, _, candela, lumens, _ = read(tmp_path / f"luminaire{suffix}")
        assert lumens == of_lamp
        np.testing.assert_allclose(candela, 12.0 * photometry.candela, rtol=5e-7, atol=1e-9)
    for file in (photometry.luminaire.ies, photometry.luminaire.ldt, photometry.luminaire.tm33):
        assert file.lumens == pytest.approx(12.0 * photometry.exit_lm.value, rel=1e-6)
    assert b"12 lenses" in photometry.luminaire_ies and b"12 lenses" not in photometry.ies
    peaks = [_peak(content) for content in (photometry.ies, photometry.luminaire_ies)]
    assert peaks == pytest.approx([photometry.peak_cd.value, 12.0 * photometry.peak_cd.value], rel=1e-4)
    assert [_lamps(content) for content in (photometry.ies, photometry.luminaire_ies)] == [["1", "250"], ["12", "250"]]
    checked = [criterion.key.split()[2] for criterion in photometry.criteria if criterion.holds]
    assert checked[-3:] == ["luminaire.ies", "luminaire.ldt", "luminaire.iesxml"]
    assert Photometry.read(tmp_path) == photometry
    assert not (folder / "luminaire.ies").exists() and alone.luminaire is None
    titles = {group.key: group.title for group in photometry_facts(photometry, spec)}
    assert titles["far_field"] == "Far field, one lens of 12"
    area = small_spec(photometry={"lenses": 12, "use": "area"}, target__distance_mm=1e4, target__receiver_mm=1e4)
    far = measured(replace(SYMMETRIC, spec=area), rays=2**12, lumens=250.0)
    field, lamp, zones = photometry_facts(far, area)
    assert (lamp.title, zones.title) == ("Lamp, all 12 lenses", "Zones, all 12 lenses")
    assert lamp.fact("luminaire").value == "luminaire.ies, .ldt, .iesxml"
    assert field.fact("exit_lm").note.startswith("one lens of 12; ")


def test_a_beam_angle_stands_beside_the_one_that_the_target_wants(cosine):
    """A cosine has 120 degrees in every plane; the target wants 112 along x and 100 along y."""
    beam = {"kind": "beam", "fwhm_deg": [112.0, 100.0], "profile": "cosine", "half_angle_deg": 80.0}
    for turned, wanted in ((0.0, True), (90.0, False)):
        spec = lf.Spec.model_validate(
            small_spec().model_dump(exclude={"target"}) | {"target": {**beam, "rotation_deg": turned}}
        )
        far = photometry_facts(cosine[0], spec)[0]
        facts = [far.fact(f"beam_C {plane}") for plane in (0, 90)]
        assert [fact.value for fact in facts] == [pytest.approx(120.0, rel=0.02)] * 2
        assert [fact.notice for fact in facts] == (["", "the target wants 100°"] if wanted else ["", ""])
        assert facts[0].note.startswith("the target wants 112°; ") == wanted


def _peak(ies: bytes) -> float:
    """The largest intensity (cd) that its remark states."""
    return float(ies.decode("ascii").partition("peak without noise ")[2].split()[0])


def _lamps(ies: bytes) -> list[str]:
    """Number of lamps and lumens of each."""
    return ies.decode("ascii").partition("TILT=NONE\r\n")[2].split()[:2]


def test_the_files_count_the_leds_of_several_lamps():
    """LM-63: number of lamps, and lumens of each of them; EULUMDAT: their number, and lumens of all."""
    spec = small_spec(lamps={"kind": "grid", "columns": 5, "rows": 4, "pitch_mm": 20.0})
    photometry = measured(replace(SYMMETRIC, spec=spec), rays=2**12, lumens=250.0)
    assert _lamps(photometry.ies) == ["20", "250"] and photometry.source_lm == 5000.0
    lines = photometry.ldt.decode("latin-1").split("\r\n")
    assert (lines[26], lines[28]) == ("20", "5000")
    assert photometry.files.ies.lumens == pytest.approx(photometry.exit_lm.value, rel=1e-6)


def test_every_file_says_that_it_is_computed_and_when():
    """The date is that of the spec, and none where the spec has none: the same bits on any day."""
    for lens, date in ((DATED, "2026-03-01"), (ROUGH, "")):
        photometry = measured(lens, rays=2**10, lumens=90.0)
        assert date or photometry.products() == measured(lens, rays=2**10, lumens=90.0).products()
        ies = photometry.ies.decode("ascii").split("\r\n")
        assert ies[0] == "IES:LM-63-2019" and f"[ISSUEDATE] {date or 'not stated'}" in ies
        assert ies[ies.index("TILT=NONE") + 2].split()[1] == "1.00010"
        assert photometry.ldt.decode("ascii").split("\r\n")[11].startswith(date)
        assert f"<ReportDate>{date or '1970-01-01'}</ReportDate>" in photometry.tm33.decode("utf-8")
        assert "<Simulation>true</Simulation>" in photometry.tm33.decode("utf-8")


def test_the_library_and_the_command_write_older_editions(tmp_path):
    old = lf.photometry(ROUGH, rays=2**10, lumens=90.0, ies_version=2002)
    assert old.ies.startswith(b"IESNA:LM-63-2002")
    with pytest.raises(InputError, match="ies_version = 2020: 2002 or 2019"):
        lf.photometry(ROUGH, rays=2**10, ies_version=2020)
    ROUGH.save(tmp_path / "lens.json")
    command = ["photometry", str(tmp_path), "--rays", "1024", "--lumens", "90", "--ies-version", "2002"]
    assert CliRunner().invoke(cli, command).exit_code == 0
    assert (tmp_path / "lens_1024rays.ies").read_bytes().startswith(b"IESNA:LM-63-2002\r\n")
    np.testing.assert_array_equal(by_position(tmp_path / "lens_1024rays.ies")[2].shape, old.candela.shape)
    assert (tmp_path / "lens_1024rays.iesxml").is_file()
    shown = CliRunner().invoke(cli, ["rays", str(tmp_path / "lens_1024rays.iesxml"), "--json"])
    assert json.loads(shown.output)["generated"] == "Computer Simulation"


def test_the_command_writes_and_says_so(tmp_path):
    ROUGH.save(tmp_path / "lens.json")
    result = CliRunner().invoke(cli, ["photometry", str(tmp_path), "--rays", "4096", "--lumens", "90"])
    assert result.exit_code == 0
    assert "for 90 lm of the source\n" in result.stdout and "luminous flux" not in result.stderr
    assert (tmp_path / "lens_4096rays.ldt").read_text(encoding="utf-8").splitlines()[28] == "90"
    assert Photometry.read(tmp_path, "photometry_4096rays").ldt == (tmp_path / "lens_4096rays.ldt").read_bytes()
    relative = CliRunner().invoke(cli, ["photometry", str(tmp_path), "--rays", "1024"])
    assert "warning: luminous flux of the source not known: 1000 lm taken" in relative.stderr
    assert "for 1000 lm of the source, whose flux is not stated" in relative.stdout
