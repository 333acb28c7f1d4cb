"""Presets of tests: drafts with as little effort as shows what is done, given to verbs as a script gives one."""

from nightly import NIGHTLY

from lensforge.spec.accuracy import PRESETS

# A mesh of 24 equal rings has 8,000 triangles, where a command makes 115,000; such a part passes its verification, too.
# By day splines of smooth faces begin with half as many nodes; a fit still takes as many as its form needs.
_PART = {"mesh_rings": 24, "check_nodes": 61, "spline_nodes": 72 if NIGHTLY else 40}
_STUDIES = {"sensitivity_rays": 512, "part_rays": (256, 1024), "designed_rays": 2**13, "budget_parts": 8}
WITH_TABLE_ERROR = PRESETS["draft"].replace(
    "few_with_table_error", stray_rays=512, part=_PART, studies={**_STUDIES, "worst_rays": 2**12}
)
# The search of a few steps is judged by as few rays: at the end by 65,000 it takes longer than its steps.
FEW = WITH_TABLE_ERROR.replace("few", table_error=False, effort={"validation_rays": 2048})
CHECKED = FEW.replace("checked", part={"check_nodes": 161 if NIGHTLY else 81})  # shares of a face to 2 %
COARSE_SPLINES = PRESETS["draft"].replace("coarse_splines", part={"spline_nodes": _PART["spline_nodes"]})
FAR = FEW.replace("far", effort={"learning_rate": 0.01})  # few steps go far

FEW_STEPS = FEW.replace(
    "few_steps",
    effort={
        "finest": 25, "steps": (4, 6), "rays": (256, 512), "validation_rays": 512, "step_gain": 0.5, "level_gain": 0.05,
    },
)  # fmt: skip
