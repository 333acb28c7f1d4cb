"""Spectra as files: two columns of a vendor, OPTIS/SPEOS, LightTools; refused in one line where they are none."""

import numpy as np
import pytest
from rayfile_samples import SHARED

from lensforge.errors import FileWarning, InputError
from lensforge.sources.source_spectrum import read_spectrum_file, spectrum_of
from lensforge.spec.emitter_section import FileSpectrum

ROWS = [[440.5, 0.0], [450.0, 2.0], [480.25, 1.0]]
TABBED = "440.5\t0\n450\t2\n480.25\t1\n"
OPTIS = "OPTIS - Spectrum file v1.0\nBlue LED, 20 mA\n3\n" + TABBED
LIGHTTOOLS = (
    "# LightTools spectrum file, created 13-Oct-2019\n# name: blue 5\ndfat 1.0\ndataname: 450 nm\ncontinuous\n"
    "radiometric\n" + TABBED
)


def read(folder, content):
    path = folder / "led.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    return read_spectrum_file(path)


@pytest.mark.parametrize(
    ("content", "rows"),
    [
        (TABBED, ROWS),
        (TABBED.replace("\n", "\r\n"), ROWS),
        (TABBED.replace("\n", "\r"), ROWS),
        ("\xef\xbb\xbf" + TABBED, ROWS),
        ("# a comment 1 2 3\n\nwavelength (nm)\tpower\n" + TABBED, ROWS),
        ("Wavelength;Power\n440,5;0\n450,0;2,0\n480,25;1\n", ROWS),
        ("440,5 0\n450 2,0\n480,25 1,0\n", ROWS),
        ("440.5,0\n450,2\n480.25,1.0\n", ROWS),
        ("440.5, 0\n450, 2\n480.25, 1.0\n", ROWS),
        ("480.25 1\n450 2\n440.5 0\n", ROWS),
        (OPTIS, ROWS),
        (OPTIS.replace("file", "fie").replace("v1.0", "v1").replace("Blue LED, 20 mA", ""), ROWS),
        (LIGHTTOOLS.replace("\n", "\r\n"), ROWS),
        ("Power [W/nm];Wavelength [µm];sigma\n0;0,4405;1\n2;0,45;1\n1;0,48025;1\n", ROWS),
        (TABBED.encode("utf-16"), ROWS),
        ('"nm","value"\n"440,5","0"\n"450","2"\n"480,25","1"\n', ROWS),
        ("# 1 2\n450 1\n# 3 4\n460 2\n", [[450.0, 1.0], [460.0, 2.0]]),
        ("450 1\n", [[450.0, 1.0]]),
        ("460 2\n450 1\n470 3\n", [[460.0, 2.0], [450.0, 1.0], [470.0, 3.0]]),  # for the spectrum to refuse
        ("99.9 1\n100 2\n", [[99.9, 1.0], [100.0, 2.0]]),
    ],
)
def test_rows_are_read_from_every_dress_from_blue_to_red(content, rows, tmp_path):
    np.testing.assert_array_equal(np.transpose(read(tmp_path, content)), rows)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "has no row of numbers"),
        ("a b\n", "has no row of numbers; line 1 begins with 'a b'"),
        ("450 1 2\n", "line 1: 3 cells, must be wavelength_nm, power"),
        ("# c\r\n\r\n440 1\r\n450\r\n", "line 4: 1 cells, must be 2 at least"),
        ("450 1\n\n460 x\n", "line 3, column 2: 'x' is no number"),
        ("0.44 0\n0.45 1\n0.46 0\n", "nm are expected, µm"),
        (b"450 1\n\x00460 1", "not a text file"),
        (OPTIS.replace("\n3\n", "\n4\n"), "line 3: 4 rows announced, 3 found"),
        ("OPTIS - Spectrum file v1.0\n", "has no row of numbers; line 1 begins with 'OPTIS - "),
        (LIGHTTOOLS.replace("continuous", "discrete"), "line 5: 'discrete': only continuous, radiometric"),
        (LIGHTTOOLS.replace("radiometric", "photometric"), "'photometric': only continuous"),
        ("OPTIS - Material file v13\n\n1\n1 2", "only continuous, radiometric spectra"),
        ("440 1\n450 1e12\n", r"line 2, column 2: a number of 1e\+12, must be below 1e"),
        ("380 n/a\n390 #DIV/0!\n400 1\n500 2\n", "line 1, column 2: 'n/a' is no number"),
        ("380;abc\n400;1\n500;2\n", "line 1, column 2: 'abc' is no number"),
        ("400;1,200\n500;2.5\n", "line 1, column 2: '1,200' beside numbers with decimal points"),
        ("nm,nm,power\n400,1,2\n", "line 1, column 2: 'nm' is there twice"),
        ("OPTIS - Spectrum file v1.0\nled\n400 1\n500 2\n", "line 3 of an OPTIS spectrum"),
        ("98 1\n99.9 2\n", "wavelengths from 98 to 99.9: nm are expected"),
        ("440 1\n450 -0.0101\n", "power densities from -0.0101 to 1 must lie within 0 and"),
    ],
)
def test_what_is_no_spectrum_is_one_line(content, message, tmp_path):
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, content)
    assert str(caught.value).isprintable() and str(tmp_path / "led.txt") in str(caught.value)


def test_noise_below_zero_is_taken_as_zero_and_said(tmp_path):
    """To a hundredth of the largest, as in photometric files."""
    with pytest.warns(FileWarning, match=r"led.txt: 1 of 3 power densities are below 0, the least -0.01 \(0.01 of the"):
        _, power = read(tmp_path, "440 -0.01\n450 1\n460 0.5\n")
    np.testing.assert_array_equal(power, [0.0, 1.0, 0.5])


def test_the_spec_reads_it_and_names_its_field(tmp_path):
    (tmp_path / "led.spectrum").write_text(OPTIS, encoding="latin-1")
    spectrum = spectrum_of(FileSpectrum(file=tmp_path / "led.spectrum"))
    np.testing.assert_array_equal(spectrum.power_density, [0.0, 2.0, 1.0])
    (tmp_path / "led.spectrum").write_text(OPTIS.replace("\t2\n", "\t-2\n"), encoding="latin-1")
    with pytest.raises(InputError, match=r"led\.spectrum: power densities .*; correct this file of a spectrum"):
        spectrum_of(FileSpectrum(file=tmp_path / "led.spectrum"))


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/rayfiles is not here")
def test_the_published_spectra_of_a_white_led():
    for name, peak_nm in (("blue", 448.9), ("yellow", 554.0)):
        (path,) = (SHARED / "osram").glob(f"*white-{name}*spectrum.txt")
        waves, power = read_spectrum_file(path)
        numbers = [float(word) for word in path.read_text(encoding="latin-1").split()]
        np.testing.assert_array_equal((waves, power), (numbers[::2], numbers[1::2]))
        assert abs(float(waves[np.argmax(power)]) - peak_nm) < 8.0
