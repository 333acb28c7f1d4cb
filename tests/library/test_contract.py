"""Names that scripts rely on, in result folders and in the library."""

import json

import pytest
from addon_rows import has_addon

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
         "photometry", "handover", "sweep", "tradeoff", "rays", "InputError", "RaySource", "ArrayTarget",
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
    assert hasattr(lf, "compare") or not has_addon("measure")
    assert [verb for verb in VERBS if not hasattr(lf, verb)] == []
    assert [name for name in RUN if not hasattr(whole_run, name)] == []
    assert all(callable(getattr(lf, verb)) for verb in VERBS)
