"""The plots of results as a user's program calls them: in a process of their own, without the checks of the tests."""

import inspect
import subprocess
import sys

import pytest

import lensforge as lf
from lensforge.results import StageResult

PLOTTED = (
    lf.Design, lf.Light, lf.Part, lf.Check, lf.Proof, lf.StrayLight, lf.Sensitivity, lf.Photometry, lf.PhotoComparison,
    lf.SurfaceComparison, lf.Correction, lf.Sweep, lf.Tradeoff, lf.RayFileSummary, lf.PhotometricSummary, lf.Yield,
)  # fmt: skip

_WRONG = """
import inspect, sys
import numpy as np
import lensforge as lf

def refused(result, *args, **choice):
    try:
        result.plot(*args, **choice)
    except lf.InputError as error:
        return str(error)
    sys.exit(f"{type(result).__name__} plots {args} {choice}")

for cls in (lf.Design, lf.Light, lf.Part, lf.Check, lf.StrayLight, lf.Sensitivity, lf.PhotoComparison, lf.Sweep,
            lf.RayFileSummary):
    for name in set(list(inspect.signature(cls.plot).parameters)[2:]) - {"receiver"}:
        for value in ("foo", None, ["nmse"]):
            message = refused(cls.model_construct(), **{name: value})
            assert message.startswith(f"{name} = {value!r}: must be ") and "\\n" not in message, message
for result in lf.load(sys.argv[1]).found.values():
    for axes in ("map", 3, np.zeros(2)):
        message = refused(result, axes)
        assert message.startswith(f"axes: is of type {type(axes).__name__}, must be a matplotlib Axes"), message
    if "receiver" in inspect.signature(result.plot).parameters:
        assert result.plot(receiver=result.first.name) is not None
        for value in ("foo", 3, ["nmse"]):
            message = refused(result, receiver=value)
            assert message.startswith(f"receiver = {value!r}: must be ") and "\\n" not in message, message
print("all refused")
"""


def test_every_plot_takes_axes_first_and_choices_by_name() -> None:
    def below(cls: type[StageResult]) -> set[type[StageResult]]:
        return {cls}.union(*map(below, cls.__subclasses__()))

    assert {cls for cls in below(StageResult) if hasattr(cls, "plot")} == set(PLOTTED)
    for cls in PLOTTED:
        axes, *choices = list(inspect.signature(cls.plot).parameters.values())[1:]
        assert (axes.name, axes.kind, axes.default) == ("axes", axes.POSITIONAL_OR_KEYWORD, None), cls
        for choice in choices:
            assert choice.kind == choice.KEYWORD_ONLY and choice.default is not choice.empty, (cls, choice)


@pytest.mark.nightly("a process with every result")
def test_what_cannot_be_plotted_is_one_line(whole_run: lf.Run) -> None:
    run = subprocess.run([sys.executable, "-c", _WRONG, str(whole_run.folder)], capture_output=True, encoding="utf-8")
    assert (run.returncode, run.stdout) == (0, "all refused\n"), run.stderr
