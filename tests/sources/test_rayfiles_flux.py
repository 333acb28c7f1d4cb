"""Flux and spectrum of a ray file: one scale for summary, picture, conversion and source; nothing lost unsaid."""

from dataclasses import replace

import numpy as np
import pytest
from rayfile_samples import encoded, image, rays, with_spectrum_numbers

from lensforge.errors import InputError
from lensforge.sources.ray_file_statistics import describe
from lensforge.sources.ray_file_summary import Histograms
from lensforge.sources.ray_set_loading import load_ray_set
from lensforge.sources.rayfiles.ray_file_io import FORMATS, convert, decode, read_rayfile
from lensforge.spec.source_sections import RayfileSource

TABLE = {"wavelength_nm": [530.0, 550.0, 570.0], "weight": [0.0, 1.0, 0.0]}
LM_PER_W = 676.0  # about that of the table


def stated(unit, wavelengths="none", table=False):
    """Rays whose fluxes are relative, with both totals in the header: 2.5 W and 1690 lm."""
    header = {"name": "both", **({"spectral_tables": [TABLE]} if table else {})}
    both = replace(rays(40, unit, wavelengths), header_flux_w=2.5, header_flux_lm=2.5 * LM_PER_W, header=header)
    return replace(both, flux=both.flux * np.float32(1e4))


ORIGINALS = {
    f"{unit}, wavelengths {waves}{', table' * table}": stated(unit, waves, table)
    for unit in ("W", "lm")
    for waves in ("none", "one", "each")
    for table in (False, True)
    if not (table and waves != "none")
}


def known(rayfile):
    """Everything that a file says of its light, by the words under which a loss of it is listed."""
    quantities = {f"total flux in {unit}": rayfile.flux_in(unit) for unit in ("W", "lm")}
    if rayfile.wavelengths_nm is not None:
        quantities["wavelengths"] = np.asarray(rayfile.wavelengths_nm, dtype=float)
    if rayfile.spectral_tables:
        quantities["spectral tables"] = np.array([t["weight"] for t in rayfile.header["spectral_tables"]])
    if rayfile.spectrum_numbers is not None:
        quantities["spectral table of each ray"] = np.asarray(rayfile.spectrum_numbers, dtype=float)
    return {name: value for name, value in quantities.items() if value is not None}


def holds(name, rayfile):
    """True where the format can hold the rays; False where it refuses them and names a format that can."""
    try:
        encoded(name, rayfile)
    except InputError as error:
        refused = str(error)
    else:
        return True
    assert "convert to" in refused
    return False


@pytest.mark.parametrize("name", ["speos", "speos_text"])
@pytest.mark.parametrize(
    ("unit", "wavelengths", "have"), [("lm", "each", "lm"), ("lm", "none", "lm"), ("W", "none", "no wavelengths")]
)
def test_speos_says_what_the_rays_have_that_it_cannot_hold(name, unit, wavelengths, have):
    with pytest.raises(InputError, match=f"for each ray, these rays have {have}; convert to tm25 instead"):
        encoded(name, rays(5, unit, wavelengths))


def cannot_hold(name, unit):
    """Facts for which a format has no place, as the guide's table lists them."""
    other = {"W": "total flux in lm", "lm": "total flux in W"}[unit]
    return {
        *([other] if name not in ("tm25", "speos") else []),
        *(["spectral tables", "spectral table of each ray"] if name != "tm25" else []),
    }


@pytest.mark.parametrize("target", list(FORMATS))
@pytest.mark.parametrize("source", list(FORMATS))
def test_rays_totals_and_spectrum_survive_any_conversion_or_are_listed(source, target, tmp_path):
    """Every pair of formats, every kind of rays that the first can hold: a fact is in the new file, or in ``lost``."""
    held = 0
    for original in ORIGINALS.values():
        if not holds(source, original):
            continue
        (tmp_path / "in").write_bytes(encoded(source, original))
        before = read_rayfile(tmp_path / "in")
        if not holds(target, before):
            continue
        report = convert(tmp_path / "in", tmp_path / "out", target)
        held += 1
        assert (report.from_format, report.to_format, report.rays) == (source, target, len(original))
        converted = read_rayfile(tmp_path / "out")
        np.testing.assert_allclose(converted.positions_mm, original.positions_mm, rtol=1e-7)
        np.testing.assert_allclose(converted.directions, original.directions, rtol=1e-7)
        after, facts = known(converted), known(before)
        listed = [entry.split(" (")[0] for entry in report.lost]
        for name, value in facts.items():
            survives = name in after and np.allclose(after[name], value, rtol=1e-5)
            assert survives != (name in listed), (name, report.lost)
        assert set(listed) == set(facts) & (set() if source == target else cannot_hold(target, before.flux_unit))
        total = f"total flux in {before.flux_unit}"
        assert total not in listed and after[total] == pytest.approx(facts[total], rel=1e-5)
    assert held or {source, target} & {"speos", "speos_text"}


def test_the_table_of_each_ray_is_written_again():
    """Not a copy of the bytes: encoded by our writer, spectral identifier 4."""
    numbers = [1, 2, 2, 1, 2]
    back = decode(image(encoded("tm25", decode(image(with_spectrum_numbers(numbers))))))
    assert (back.spectrum_numbers.tolist(), len(back.spectral_tables), back.warnings) == (numbers, 2, ())
    with pytest.raises(InputError, match="only with W"):
        encoded("tm25", replace(back, flux_unit="lm"))


@pytest.mark.parametrize("role", ["total", "scale", "ignored"])
def test_one_flux_in_summary_picture_conversion_and_source(role, tmp_path, monkeypatch):
    """A ray without a direction carries half of the stored flux: nobody counts it, and so nobody disagrees."""
    random = rays(300)
    flux, directions = np.array(random.flux), np.array(random.directions)
    flux[7], directions[7] = flux.sum(dtype=float) - flux[7], 0.0
    stored = replace(
        random, flux=flux, directions=directions, header_flux_w=0.75, header_role=role, positions_mm=random.positions_mm
    )
    usable = float(np.delete(flux, 7).astype(float).sum())
    truth = usable if role == "ignored" else 0.75
    assert describe(stored).flux.total == pytest.approx(truth, rel=1e-9)
    assert Histograms.of(stored).rings.sum() == pytest.approx(truth, rel=1e-9)
    assert stored.total_flux() == pytest.approx(truth, rel=1e-9)
    for name in ("tm25", "zemax_binary", "csv", "lighttools_binary"):
        (tmp_path / "led").write_bytes(encoded(name, stored))
        assert load_ray_set(RayfileSource(file=tmp_path / "led")).flux_w == pytest.approx(truth, rel=1e-6)
        kept = read_rayfile(tmp_path / "led")
        assert kept.flux_factor() * kept.ray_sum() == pytest.approx(truth, rel=1e-6)
