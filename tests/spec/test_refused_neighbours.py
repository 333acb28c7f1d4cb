"""What a section refuses, in its line, beside the nearest spec that it takes."""

import re
from pathlib import Path

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.spec.source_list import read_sources

RISING = {"incidence_deg": [0.0, 40.0], "scattering_deg": [0.0, 10.0, 20.0]}
BSDF = [[1.0, 0.5, 0.1], [1.0, 0.6, 0.2]]
LAMPS = {"kind": "table", "places_mm": [[0.0, 0.0], [40.0, 0.0]]}
LUX = {"kind": "zone", "at_most_mean_w_per_m2": 9.0}
EYES = {"kind": "luminance", "eyes_deg": [[30.0, 0.0]], "spot_mm": 0.58, "at_most": 1e4, "unit": "cd_per_m2"}


def coated(angles: list[float], waves: list[float], rows: list[list[float]]) -> dict[str, object]:
    return {"coating": {"angle_deg": angles, "wavelength_nm": waves, "reflectance": rows}}


@pytest.mark.parametrize(
    ("refused", "taken", "line"),
    [
        (
            {"lens__inner": coated([0.0, 30.0, 30.0], [500.0], [[0.1, 0.1, 0.2]])},
            {"lens__inner": coated([0.0, 30.0, 30.1], [500.0], [[0.1, 0.1, 0.2]])},
            "lens.inner.coating: angle_deg must rise",
        ),
        (
            {"lens__inner": coated([0.0, 30.0], [500.0, 500.0], [[0.1, 0.2]] * 2)},
            {"lens__inner": coated([0.0, 30.0], [500.0, 500.1], [[0.1, 0.2]] * 2)},
            "lens.inner.coating: wavelength_nm must rise",
        ),
        (
            {"lens__material": "PMMA", "lens__refractive_index": 1.6},
            {"lens__material": "PMMA"},
            "lens: refractive_index = 1.6, but PMMA has 1.49253 at 587.562 nm; leave out refractive_index, or name the "
            "material otherwise",
        ),
        (
            {"lens__material": "unobtainium"},
            {"lens__material": "unobtainium", "lens__refractive_index": 1.6},
            "lens: material = 'unobtainium': one of PMMA, PC, PS, N-BK7, fused silica, COP, COC, polyester, silicone, "
            "B270, borosilicate 3.3, or add refractive_index",
        ),
        (
            {"lens__inner": {"scatter": {"kind": "table", **RISING}}},
            {"lens__inner": {"scatter": {"kind": "table", **RISING, "bsdf_per_sr": BSDF}}},
            "lens.inner.scatter: give file, or incidence_deg, scattering_deg and bsdf_per_sr",
        ),
        (
            {"lens__inner": {"scatter": {"kind": "table", **RISING, "bsdf_per_sr": BSDF[:1]}}},
            {"lens__inner": {"scatter": {"kind": "table", **RISING, "bsdf_per_sr": BSDF}}},
            "lens.inner.scatter: bsdf_per_sr: must be 2 rows (incidence_deg) of 3 numbers (scattering_deg)",
        ),
        (
            {"lens__inner": {"scatter": {"kind": "table", **RISING, "bsdf_per_sr": [BSDF[0], BSDF[1][:2]]}}},
            {"lens__inner": {"scatter": {"kind": "table", **RISING, "bsdf_per_sr": BSDF}}},
            "lens.inner.scatter: bsdf_per_sr: must be 2 rows (incidence_deg) of 3 numbers (scattering_deg)",
        ),
        (
            {"lens__levels": []},
            {"lens__levels": [9], "optimise__steps_per_level": [2]},
            "lens: levels is empty: give at least one count",
        ),
        (
            {"target": {"kind": "ring", "inner_diameter_mm": 20.0, "outer_diameter_mm": 20.0, "distance_mm": 30.0}},
            {"target": {"kind": "ring", "inner_diameter_mm": 19.9, "outer_diameter_mm": 20.0, "distance_mm": 30.0}},
            "target: inner_diameter_mm = 20 must be smaller than outer_diameter_mm = 20",
        ),
        (
            {"lamps": {**LAMPS, "turns_deg": [10.0]}},
            {"lamps": {**LAMPS, "turns_deg": [10.0, 20.0]}},
            "lamps: turns_deg has 1 numbers, places_mm 2 places",
        ),
        (
            {"lamps": {**LAMPS, "aims_mm": [[0.0, 0.0, 50.0], [40.0, 0.0, 0.0]]}},
            {"lamps": {**LAMPS, "aims_mm": [[0.0, 0.0, 50.0], [40.0, 0.0, 60.0]]}},
            "lamps: aims_mm.1 = (40.0, 0.0, 0.0): is the place of the lamp; give a point that it shines at",
        ),
        (
            {"limits": [{**EYES, "meter_mm": 5.0}]},
            {"limits": [EYES]},
            "limits.0: meter: eyes see a spot; give spot_mm or spot_deg",
        ),
        (
            {"limits": [{**EYES, "receiver": "light"}]},
            {"limits": [EYES]},
            "limits.0: receiver: eyes see the lens itself; leave it out",
        ),
        (
            {"limits": [{**LUX, "zone": {"kind": "disc", "diameter_deg": 9.0}}]},
            {"limits": [{**LUX, "zone": {"kind": "disc", "diameter_mm": 9.0}}]},
            "limits.0: its places are in deg, on receiver 'light' they are in mm",
        ),
        (
            {"manufacture": {"process": "moulded", "layer_um": 5.0}},
            {"manufacture": {"process": "printed", "layer_um": 5.0}},
            'manufacture: layer_um = 5 goes with process = "printed", not "moulded"; leave it out',
        ),
    ],
    ids=lambda value: value[:30] if isinstance(value, str) else "",
)
def test_a_section_refuses_what_its_neighbour_is_taken_for(
    refused: dict[str, object], taken: dict[str, object], line: str
) -> None:
    with pytest.raises(lf.InputError, match=rf"^small: {re.escape(line)}$"):
        small_spec(**refused)
    small_spec(**taken)


def test_entries_of_a_list_are_changed_by_numbers_from_0() -> None:
    """The second of two is changed, a third is refused."""
    at_most = {"kind": "zone", "zone": {"kind": "ellipse", "width_mm": 20.0, "height_mm": 20.0}, "at_most_mean_lx": 9.0}
    spec = small_spec(source__luminous_efficacy_lm_per_w=300.0, limits=[at_most, {**at_most, "at_most_mean_lx": 8.0}])
    changed = spec.replace({"limits.1.at_most_mean_lx": 7.0})
    assert [limit.at_most_mean_lx for limit in changed.limits] == [9.0, 7.0]
    line = r"^replace: limits\.2\.at_most_mean_lx: limits has 2 entries, by their numbers from 0$"
    with pytest.raises(lf.InputError, match=line):
        spec.replace({"limits.2.at_most_mean_lx": 7.0})


def test_a_pattern_goes_through_all_folders_below_twice_at_most(tmp_path: Path) -> None:
    deep = tmp_path / "a" / "b" / "c"
    deep.mkdir(parents=True)
    (deep / "led.ttr").write_bytes(b"x")
    root = str(tmp_path)
    settings = small_spec().source
    assert [source.name for source in read_sources([f"{root}/**/b/**/*.ttr"], settings)] == ["led"]
    with pytest.raises(lf.InputError, match=r"^sources: .*: \*\* may stand 2 times; name the folders$"):
        read_sources([f"{root}/**/b/**/c/**/*.ttr"], settings)
