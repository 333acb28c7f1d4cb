"""Names that scripts rely on, in result folders and in the library; and a folder of version 0.1.0, whose lens loads."""

import json
from pathlib import Path

import numpy as np
import pytest

import lensforge as lf

METRIC = {"value", "unit", "standard_error"}
NAMES = {
    "design": ("steps", "seconds", "max_radius_mm", "height_mm", "constraints.cavity_clearance_mm",
               "constraints.wall_margin_mm", "constraints.radius_margin_mm"),
    "evaluate": ("nmse*", "efficiency*", "share_in_target*", "uniformity*", "rsd*", "flux", "rays", "pixels", "filter"),
    "export": ("form_error_nm.max", "normal_error_mrad.max", "volume_mm3", "watertight", "genus", "faces"),
    "check": ("inner.best_fit_sphere", "inner.cutter", "outer.best_fit_sphere", "outer.cutter", "inner.draft_deg",
              "outer.draft_deg", "min_wall_mm"),
    "verify": ("rays", "seconds", "nmse_vs_design", "noise_floor_nmse", "efficiency", "deviation_mm.rms"),
    "run": ("verdict.light", "verdict.files", "verdict.cutting"),
}  # fmt: skip
VERBS = ("load_spec", "Spec", "design", "evaluate", "build", "check", "verify", "run", "load", "sensitivity",
         "photometry", "handover", "compare", "sweep", "tradeoff", "rays", "InputError", "RaySource", "ArrayTarget",
         "Metric")  # fmt: skip
RUN = ("spec", "design", "light", "part", "check", "proof", "verdict", "folder")


@pytest.mark.parametrize("stage", NAMES)
def test_the_files_have_the_names_of_the_contract(whole_run: lf.Run, stage: str) -> None:
    record = json.loads((whole_run.folder / f"{stage}.json").read_text(encoding="utf-8"))
    for name in NAMES[stage]:
        value = record
        for part in name.rstrip("*").split("."):
            assert part in value, name
            value = value[part]
        assert set(value) == METRIC if name.endswith("*") else True, name
    if stage == "evaluate":
        assert sum(record["flux"].values()) == pytest.approx(1.0)


def test_the_library_has_the_verbs_of_the_contract(whole_run: lf.Run) -> None:
    assert [verb for verb in VERBS if not hasattr(lf, verb)] == []
    assert [name for name in RUN if not hasattr(whole_run, name)] == []
    assert all(callable(getattr(lf, verb)) for verb in VERBS)


OLD = Path(__file__).parent / "version_0_1_0"


def test_the_lens_of_version_0_1_0_is_the_same_lens() -> None:
    lens = lf.load_lens(OLD / "lens.json")
    stored = json.loads((OLD / "lens.json").read_text(encoding="utf-8"))
    assert lens.version == "0.1.0"
    for side, surface in (("inner", lens.inner), ("outer", lens.outer)):
        assert np.array_equal(surface.weights_mm, stored[side]["weights_mm"])
        assert surface.offset_mm == stored[side]["offset_mm"]
    assert lens.spec.constraints.max_radius_mm == 7.0


def test_a_folder_of_version_0_1_0_loads_and_says_what_to_run() -> None:
    run = lf.load(OLD)
    assert set(run.outdated) == {"design", "evaluate"}
    assert "run `lensforge evaluate` again" in run.outdated["evaluate"]
    with pytest.raises(lf.MissingResult, match=r"before version 0\.2\.0"):
        _ = run.light
    assert not hasattr(run, "light")
    assert run.verdict.light == "undecided"


def test_its_light_is_what_it_was() -> None:
    """Evaluated by this version it has the figures that version 0.1.0 wrote, which had ray noise, as its raw ones.

    Version 0.1.0 left out that the second face sees light that the first has polarised: a few millionths here.
    """
    was = json.loads((OLD / "evaluate.json").read_text(encoding="utf-8"))
    light = lf.evaluate(lf.load_lens(OLD / "lens.json"))
    assert light.raw.nmse == pytest.approx(was["nmse"], rel=1e-6)
    assert light.nmse.value == pytest.approx(was["nmse"] - was["nmse_of_noise"], rel=0.02)
    assert light.efficiency.value == pytest.approx(was["efficiency"], rel=1e-7)
    assert light.raw.uniformity == pytest.approx(was["uniformity"], rel=1e-6)
    with np.load(OLD / "evaluate.npz") as images:
        assert np.allclose(light.map, images["irradiance"], rtol=1e-5, atol=0.0)
    flux = {name: share for name, share in was["flux"].items() if name != "absorbed_fresnel"}
    flux |= {
        "reflected": was["flux"]["absorbed_fresnel"],
        "absorbed": 0.0,
        "cover_glass": 0.0,
        "bodies": 0.0,
    }  # as they are called now
    assert light.flux.model_dump() == pytest.approx(flux, abs=1e-7)
