"""``rays`` on photometric files: beam, flux and peak by closed forms; conversion there and back; one-line refusals."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from rayfile_samples import SHARED

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric import PhotometricFile, write_photometric
from lensforge.sources.photometric.photometric_file import LampSet
from lensforge.sources.photometric.photometric_io import convert_photometric
from lensforge.sources.photometric_summary import PhotometricSummary

GAMMA = np.linspace(0.0, 180.0, 361)


def saved(path: Path, profile, lamp_lumens=None, c_deg=(0.0,), gamma=GAMMA, watts=0.0, **fields) -> Path:
    """A file of ``profile(c, gamma)`` in cd, both in rad; by default a body of revolution."""
    c = np.array(c_deg)
    values = np.stack([profile(turn, np.deg2rad(gamma)) for turn in np.deg2rad(c)])
    write_photometric(
        path, PhotometricFile(TabulatedIntensity(c, gamma, values), (LampSet(lamp_lumens, watts),), **fields)
    )
    return path


def lambertian(c, gamma):
    return 1000.0 * np.maximum(np.cos(gamma), 0.0)


@pytest.mark.parametrize("suffix", [".ies", ".ldt", ".iesxml"])
def test_a_lambertian_emitter_has_its_closed_forms(suffix, tmp_path):
    path = saved(tmp_path / f"led{suffix}", lambertian, 4000.0, title="Lambert", maker="Johann", watts=40.0)
    summary = lf.rays(path)
    assert isinstance(summary, PhotometricSummary)
    assert summary.lumens == pytest.approx(1000.0 * np.pi, rel=1e-4)
    assert (summary.luminaire, summary.maker, summary.watts, summary.lamp_lumens) == ("Lambert", "Johann", 40.0, 4000.0)
    assert summary.lumens_per_electric_watt == pytest.approx(25.0 * np.pi, rel=1e-4)
    assert (summary.peak.intensity_cd, summary.peak.gamma_deg, summary.axis_cd) == (
        pytest.approx(1000.0),
        0.0,
        summary.axis_cd,
    )
    for beam in (summary.beam_c0, summary.beam_c90):
        assert beam.beam_angle_deg == pytest.approx(120.0, abs=1e-4)
        assert beam.field_angle_deg == pytest.approx(2.0 * np.rad2deg(np.arccos(0.1)), abs=1e-3)
    assert (summary.symmetry, summary.angles.planes, summary.angles.gammas) == ("revolution", 1, 361)
    assert (summary.photometric_type, summary.share_above_90, summary.warnings) == ("C", 0.0, ())


def test_a_narrow_wide_beam_has_an_angle_in_each_plane(tmp_path):
    """Half at 10 degrees in C 0 and at 30 degrees in C 90; a quarter of the sphere's flux upwards."""

    def beam(c, gamma):
        half = np.deg2rad(10.0) * np.cos(c) ** 2 + np.deg2rad(30.0) * np.sin(c) ** 2
        return 500.0 * 2.0 ** (-((gamma / half) ** 2))

    summary = lf.rays(
        saved(tmp_path / "x.ies", beam, c_deg=np.linspace(0.0, 360.0, 73), gamma=np.linspace(0, 180, 721))
    )
    assert summary.beam_c0.beam_angle_deg == pytest.approx(20.0, abs=0.01)
    assert summary.beam_c90.beam_angle_deg == pytest.approx(60.0, abs=0.01)
    assert summary.beam_c90.field_angle_deg == pytest.approx(60.0 * np.sqrt(np.log2(10.0)), abs=0.02)
    assert (summary.symmetry, summary.lamp_lumens, summary.watts) == ("rectangle", None, None)
    uniform = lf.rays(saved(tmp_path / "y.ies", lambda c, gamma: np.where(gamma > np.pi / 2, 3.0, 1.0)))
    assert uniform.share_above_90 == pytest.approx(0.75, abs=0.005)
    assert uniform.lumens == pytest.approx(8.0 * np.pi, rel=0.005)


def test_an_off_axis_beam_is_measured_between_its_outermost_directions(tmp_path):
    """Wings at 40 degrees, dark in the middle: the beam reaches from -45 to 45 degrees, not from the axis."""
    wings = np.interp(GAMMA, [30.0, 40.0, 50.0], [0.0, 1.0, 0.0])
    summary = lf.rays(saved(tmp_path / "x.ies", lambda c, gamma: wings))
    assert summary.beam_c0.beam_angle_deg == pytest.approx(90.0)
    assert summary.beam_c0.field_angle_deg == pytest.approx(98.0)
    assert (summary.axis_cd, summary.peak.gamma_deg) == (0.0, 40.0)


def test_the_angles_of_a_plane_are_shares_of_its_own_peak(tmp_path):
    """In C 0 100 cd at 30 degrees; in C 90 20 cd on the axis, falling to none at 60 degrees."""
    ring = np.interp(GAMMA, [0.0, 30.0, 60.0], [20.0, 100.0, 0.0])
    cone = np.interp(GAMMA, [0.0, 60.0], [20.0, 0.0])
    planes = np.linspace(0.0, 360.0, 5)

    def two_beams(c, gamma):
        return ring if abs(np.cos(c)) > 0.5 else cone

    summary = lf.rays(saved(tmp_path / "x.ies", two_beams, c_deg=planes))
    beams = [summary.beam_c0, summary.beam_c90]
    assert [beam.peak_cd for beam in beams] == [100.0, 20.0]
    assert [beam.beam_angle_deg for beam in beams] == pytest.approx([90.0, 60.0])
    assert [beam.field_angle_deg for beam in beams] == pytest.approx([114.0, 108.0])


def test_odd_files_are_warned_of(tmp_path):
    cut_deg = np.linspace(0.0, 60.0, 61)
    cut = lf.rays(saved(tmp_path / "x.ies", lambertian, gamma=cut_deg))
    assert "its last gamma is 60 degrees, with 50 % of the largest intensity" in cut.warnings[0]
    assert cut.beam_c0.field_angle_deg == pytest.approx(120.0)  # from end to end of the table
    around = np.linspace(0.0, 360.0, 5)
    aside = saved(tmp_path / "x.ies", lambda c, g: lambertian(c, g) * (1.0 - np.cos(c)), gamma=cut_deg, c_deg=around)
    messages = lf.rays(aside).warnings
    assert any("its last gamma is 60 degrees, with 50 % of the largest" in message for message in messages), (
        "none of it in C 0"
    )
    bright = lf.rays(saved(tmp_path / "x.ies", lambertian, 2000.0, watts=2.0))
    assert [note.split(":")[-1].strip() for note in bright.warnings] == [
        "check its factors",
        "check its lumens and watts",
    ]
    text = saved(tmp_path / "x.ldt", lambertian, 4000.0).read_text(encoding="latin-1").split("\n")
    text[22] = "50\r"
    (tmp_path / "x.ldt").write_text("\n".join(text), encoding="latin-1", newline="")
    (warning,) = lf.rays(tmp_path / "x.ldt").warnings
    assert warning.startswith("its intensities integrate to 3141.") and warning.endswith("the file states 2000 lm")


def invoked(*arguments):
    return CliRunner().invoke(cli, ["rays", *map(str, arguments)])


def test_the_command_summarises_draws_and_converts(tmp_path):
    path = saved(tmp_path / "led.ies", lambertian)
    (tmp_path / "misleading.ray").write_bytes(path.read_bytes())
    for name in ("led.ies", "misleading.ray"):
        plain = invoked(tmp_path / name)
        assert plain.exit_code == 0 and re.search(r"beam c0 beam angle +120°", plain.output)
    assert json.loads(invoked(path, "--json").output)["peak"]["intensity_cd"] == 1000.0
    assert invoked(path, "--plot", tmp_path / "polar.png").exit_code == 0
    with Image.open(tmp_path / "polar.png") as picture:
        assert len(picture.convert("RGB").getcolors(10**6)) > 10
    assert json.loads(invoked(path, "--to", tmp_path / "led.ldt", "--json").output)["to_format"] == "eulumdat"


def test_a_summary_is_saved_and_read_back_without_its_intensities(tmp_path):
    summary = lf.rays(saved(tmp_path / "led.ies", lambertian))
    summary.save(tmp_path / "led.json")
    back = PhotometricSummary.read(tmp_path, "led")
    assert back == summary and "<img" in summary._repr_html_() and "<img" not in back._repr_html_()
    with pytest.raises(InputError, match="read the photometric file again"):
        back.plot()
    curves = {line.get_label(): line.get_ydata() for line in summary.plot().lines}
    assert curves["C0 - C180"].min() == pytest.approx(-1000.0)


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/rayfiles is not here")
@pytest.mark.parametrize("target", [".ies", ".ldt", ".iesxml"])
def test_real_files_keep_their_light(target, tmp_path):
    for path in sorted((SHARED / "photometry").iterdir()):
        before = lf.rays(path)
        convert_photometric(path, tmp_path / f"out{target}")
        after = lf.rays(tmp_path / f"out{target}")
        assert after.lumens == pytest.approx(before.lumens, rel=1e-6)
        assert after.beam_c0.beam_angle_deg == pytest.approx(before.beam_c0.beam_angle_deg, abs=1e-3)
        assert (after.watts, after.luminaire) == (before.watts, before.luminaire)
        if before.stated_lumens:
            assert before.lumens == pytest.approx(before.stated_lumens, rel=0.01)
