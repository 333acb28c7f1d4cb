"""lensforge: from an LED and a wanted light pattern to a lens that a machine shop can cut.

Units everywhere: mm, rad, nm, W; float64. The axis of the lens is +z, the source sits at the origin.
A verb takes objects and returns a frozen result; :func:`run` alone writes files, :func:`load` reads them back.

Import it before torch: the wait policy counts only if it is set before torch loads its OpenMP.
"""

import os
from typing import TYPE_CHECKING

# Threads of torch that wait for work sleep: by default they spin, on the cores that trace the rays at that moment.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from lensforge.errors import Cancelled, GateFailed, InputError, LensforgeError, MissingResult
from lensforge.evaluation.light import Light
from lensforge.far_field.photometry import Photometry
from lensforge.gates import Gate
from lensforge.geometry.part import Part
from lensforge.lens import Lens, load_lens
from lensforge.manufacturing.cut import Check
from lensforge.measured_part import compare
from lensforge.measurement.comparison import PhotoComparison, SurfaceComparison
from lensforge.optimisation.design import Design
from lensforge.optimisation.progress import Progress
from lensforge.pipeline import run
from lensforge.records import Metric
from lensforge.results import Results
from lensforge.run_folder import Run, load
from lensforge.spec import (
    ArrayTarget,
    BaseSection,
    ConstraintsSection,
    CrossTarget,
    EvaluateSection,
    FlatTopTarget,
    ImageTarget,
    LensSection,
    ManufactureSection,
    OptimiseSection,
    Spec,
    TextTarget,
    Tool,
    load_spec,
)
from lensforge.spec.fixed import FixedAsphere, FixedSphere
from lensforge.spec.source import (
    Chip,
    ChipArraySource,
    ChipsSource,
    CosineIntensity,
    DiscSource,
    LuminanceSource,
    PhotometricIntensity,
    RadianceSource,
    RayfilePart,
    RayfileSource,
    RayfilesSource,
    RaySource,
    RectangleSource,
    SquareSource,
    TableIntensity,
)
from lensforge.spec.spectrum import FileSpectrum, LineSpectrum, TableSpectrum
from lensforge.stages import build, check, design, evaluate, photometry, sensitivity, stray_light, verify
from lensforge.tolerancing.sensitivity_table import Sensitivity
from lensforge.verbs import handover, rays, sweep, tradeoff
from lensforge.verdict import Verdict
from lensforge.verification.proof import Proof, StrayLight
from lensforge.version import __version__

if TYPE_CHECKING:
    from lensforge.drawings.handover import Handover
    from lensforge.sources.rayfiles.summary import RayFileSummary
    from lensforge.studies.sweep.table import Sweep
    from lensforge.studies.tradeoff.record import Tradeoff
else:

    def __getattr__(name: str) -> object:
        """Load the classes of the seldom verbs when they are asked for."""
        from lensforge.drawings.handover import Handover
        from lensforge.sources.rayfiles.summary import RayFileSummary
        from lensforge.studies.sweep.table import Sweep
        from lensforge.studies.tradeoff.record import Tradeoff

        for kind in (Handover, RayFileSummary, Sweep, Tradeoff):
            if kind.__name__ == name:
                return kind
        raise AttributeError(f"module 'lensforge' has no attribute {name!r}")


__all__ = [
    "ArrayTarget",
    "BaseSection",
    "Cancelled",
    "Check",
    "Chip",
    "ChipArraySource",
    "ChipsSource",
    "ConstraintsSection",
    "CosineIntensity",
    "CrossTarget",
    "Design",
    "DiscSource",
    "EvaluateSection",
    "FileSpectrum",
    "FixedAsphere",
    "FixedSphere",
    "FlatTopTarget",
    "Gate",
    "GateFailed",
    "Handover",
    "ImageTarget",
    "InputError",
    "Lens",
    "LensSection",
    "LensforgeError",
    "Light",
    "LineSpectrum",
    "LuminanceSource",
    "ManufactureSection",
    "Metric",
    "MissingResult",
    "OptimiseSection",
    "Part",
    "PhotoComparison",
    "PhotometricIntensity",
    "Photometry",
    "Progress",
    "Proof",
    "RadianceSource",
    "RayFileSummary",
    "RaySource",
    "RayfilePart",
    "RayfileSource",
    "RayfilesSource",
    "RectangleSource",
    "Results",
    "Run",
    "Sensitivity",
    "Spec",
    "SquareSource",
    "StrayLight",
    "SurfaceComparison",
    "Sweep",
    "TableIntensity",
    "TableSpectrum",
    "TextTarget",
    "Tool",
    "Tradeoff",
    "Verdict",
    "__version__",
    "build",
    "check",
    "compare",
    "design",
    "evaluate",
    "handover",
    "load",
    "load_lens",
    "load_spec",
    "photometry",
    "rays",
    "run",
    "sensitivity",
    "stray_light",
    "sweep",
    "tradeoff",
    "verify",
]
