"""Settings in the environment that others made for the libraries: a command ignores them, the library what it can."""

import os

import matplotlib as mpl
import numba
import pytest
from matplotlib.figure import Figure
from result_folders import make_light, small_lens

from lensforge.errors import InputError
from lensforge.kernels.compiled import kernel
from lensforge.results.figure_style import in_report_style, new_figure, to_svg
from lensforge.results.notebook_html import plot_file
from lensforge.results.worker import ignore_settings_of_libraries
from lensforge.version import versions_of

FOREIGN = {"text.usetex": True, "lines.linewidth": 20.0, "axes.facecolor": "red", "axes.grid": True, "pdf.fonttype": 42}


def test_a_command_ignores_what_would_change_or_end_its_libraries() -> None:
    foreign = {
        "NUMBA_DISABLE_JIT": "1", "NUMBA_OPT": "zz", "TORCH_LOGS": "garbage", "CSF_STEPDefaults": "/nowhere",
        "OMP_NUM_THREADS": "0", "MKL_NUM_THREADS": "x", "MPLBACKEND": "Qt4Agg", "MATPLOTLIBRC": "/home/x",
    }  # fmt: skip
    kept = {"HOME": "/home/x", "OPENBLAS_NUM_THREADS": "4", "LC_ALL": "C"}
    environ = {**foreign, **kept}
    ignore_settings_of_libraries(environ)
    assert environ == {**kept, "MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull}
    ignore_settings_of_libraries(nothing := dict[str, str]())
    assert nothing["OPENBLAS_NUM_THREADS"] == "1", "where nobody asks for more"


def drawn() -> str:
    @in_report_style
    def curve() -> Figure:
        figure, axes = new_figure(3.0, 2.0)
        axes.plot([0.0, 1.0], [1.0, 3.0], label="a_b $x$ %")
        axes.legend()
        return figure

    return to_svg(curve(), "curve", "a curve")


def test_pictures_have_no_style_from_outside() -> None:
    light = make_light(small_lens())
    before = drawn(), plot_file(light.plot, "svg")
    with mpl.rc_context(FOREIGN):
        assert (drawn(), plot_file(light.plot, "svg")) == before
        assert mpl.rcParams["text.usetex"], "it is the caller's again"


def test_kernels_that_would_not_be_compiled_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    with pytest.raises(InputError, match=r"^NUMBA_DISABLE_JIT = 1: .*; unset it$"):
        kernel(lambda x: x)


def test_versions_are_those_of_all_packages_that_are_installed() -> None:
    """One that is missing, first or between others, hides none behind it; and there is no entry for it."""
    from importlib.metadata import version

    names = ("no-such-package-0", "numpy", "no-such-package-1", "scipy")
    assert versions_of(names) == {"numpy": version("numpy"), "scipy": version("scipy")}
