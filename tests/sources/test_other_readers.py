"""Our photometric files as others read them: the same nodes, candela to the digits written, the same lumens."""

import numpy as np
import pytest
from far_fields import far_field, flux
from other_readers import by_element, by_photompy, by_position

from lensforge.sources.photometric import write_photometric

KINDS = pytest.mark.parametrize("kind", ["revolution", "rectangle", "none"])
LUMENS = pytest.mark.parametrize("lumens", [None, 417.25], ids=["absolute", "relative"])
DIGITS = 5e-7  # relative: seven digits are written


def holds(file, c, gamma, candela):
    """The same nodes, the same candela to the digits written, the same lumens."""
    table = file.intensity
    np.testing.assert_allclose(c, table.c_deg, rtol=DIGITS, atol=1e-9)
    np.testing.assert_allclose(gamma, table.gamma_deg, rtol=DIGITS, atol=1e-9)
    np.testing.assert_allclose(candela, table.values, rtol=DIGITS)
    assert flux(c, gamma, candela) == pytest.approx(table.flux(), rel=1e-6)


@KINDS
@LUMENS
@pytest.mark.parametrize("version", [1995, 2002, 2019])
def test_photompy_reads_lm_63(kind, lumens, version, tmp_path):
    file = far_field(kind, lumens)
    write_photometric(tmp_path / "lens.ies", file, ies_version=version)
    c, gamma, candela, stated, read = by_photompy(tmp_path / "lens.ies")
    holds(file, c, gamma, candela)
    assert stated == (lumens or -1.0)
    assert read.header.version == f"LM-63-{version}"
    assert read.header.future_use == (1.0001 if version == 2019 else 1.0)
    assert (read.header.keywords["MANUFAC"], read.header.keywords["LUMCAT"]) == ("lensforge", "L 1")
    assert read.photometry.total_optical_power() == pytest.approx(file.intensity.flux(), rel=3e-3)  # by its own rule


@KINDS
@LUMENS
def test_photompy_reads_eulumdat(kind, lumens, tmp_path):
    file = far_field(kind, lumens)
    write_photometric(tmp_path / "lens.ldt", file)
    c, gamma, candela, stated, read = by_photompy(tmp_path / "lens.ldt")
    holds(file, c, gamma, candela)
    assert stated == pytest.approx(lumens or file.intensity.flux(), rel=DIGITS)
    assert read.header.lamps[0].num_lamps == (-1 if lumens is None else 1)
    assert read.header.luminaire_type == (1 if kind == "revolution" else 3)
    assert stated * read.header.lorl / 100.0 == pytest.approx(file.intensity.flux(), rel=1e-5)


@KINDS
@LUMENS
@pytest.mark.parametrize("version", [1986, 1991])
def test_the_numbers_of_the_oldest_editions_stand_in_their_order(kind, lumens, version, tmp_path):
    file = far_field(kind, lumens)
    write_photometric(tmp_path / "lens.ies", file, ies_version=version)
    *table, stated = by_position(tmp_path / "lens.ies")
    holds(file, *table)
    assert stated == (lumens or -1.0)


@KINDS
@LUMENS
def test_the_intensities_of_tm_33_by_their_elements(kind, lumens, tmp_path):
    file = far_field(kind, lumens)
    write_photometric(tmp_path / "lens.iesxml", file)
    *table, rated, stated = by_element(tmp_path / "lens.iesxml")
    holds(file, *table)
    assert (rated, stated) == (lumens or -1.0, pytest.approx(file.intensity.flux(), rel=DIGITS))
