"""The report: one self-contained HTML page and its figures, from the files of a result folder and nothing else.

For notebooks and scripts: ``ResultFolder`` shows itself, ``plot_*`` return matplotlib axes or a pyvista plotter.
The names below load on first use.
"""

from importlib import import_module
from typing import Any

_LAZY = {
    "ResultFolder": "lensforge.report.notebook",
    "build_comparison": "lensforge.report.compare",
    "build_report": "lensforge.report.build",
    "plot_encircled_energy": "lensforge.report.plots",
    "plot_history": "lensforge.report.plots",
    "plot_irradiance": "lensforge.report.plots",
    "plot_outer_surface": "lensforge.report.plots_3d",
    "plot_part": "lensforge.report.plots_3d",
    "plot_section": "lensforge.report.plots",
    "write_pdf": "lensforge.report.pdf",
}

__all__ = list(_LAZY)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'lensforge.report' has no attribute {name!r}")
