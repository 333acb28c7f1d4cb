"""The names of the library: every verb, and every class that a verb takes or returns."""

from lensforge.cad.part import Part
from lensforge.errors import (
    Cancelled,
    CriterionMissed,
    InputError,
    LensforgeError,
    MissingResult,
    RenamedWarning,
    SourceWarning,
)
from lensforge.light.evaluation_result import Light, LimitResult
from lensforge.light.photometry_result import Photometry
from lensforge.light.receiver_light import Possible
from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import PhotoComparison, SurfaceComparison
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.results import Conditions, Metric
from lensforge.results.criteria import Criterion
from lensforge.runs.cast_stages import stray_light, verify
from lensforge.runs.corrected_part import correct
from lensforge.runs.measured_part import compare
from lensforge.runs.pipeline import run
from lensforge.runs.results import Results
from lensforge.runs.run_folder import Run, load
from lensforge.runs.stages import build, check, design, evaluate, photometry
from lensforge.runs.starts import best_design
from lensforge.runs.sweep import Sweep
from lensforge.runs.tolerance_stages import sensitivity, tolerance
from lensforge.runs.tradeoff_result import Tradeoff
from lensforge.runs.verdict import Verdict
from lensforge.scene.lens import Lens, load_lens
from lensforge.search.design_result import Design, Progress
from lensforge.shop.check_result import Check
from lensforge.shop.handover import Handover
from lensforge.sources.photometric.photometric_summary import PhotometricSummary
from lensforge.sources.rayfiles.ray_file_summary import RayFileSummary
from lensforge.spec import (
    BaseSection,
    ConstraintsSection,
    DrawingSection,
    EvaluateSection,
    LensSection,
    ManufactureSection,
    OptimiseSection,
    Spec,
    Tool,
    load_spec,
)
from lensforge.spec.emitter_section import (
    CosineIntensity,
    FileSpectrum,
    LineSpectrum,
    PhotometricIntensity,
    TableIntensity,
    TableSpectrum,
)
from lensforge.spec.fixed_surface import (
    FixedAsphere,
    FixedBiconic,
    FixedCadFace,
    FixedLensFace,
    FixedPoints,
    FixedSphere,
)
from lensforge.spec.light_limits import BeamAngleLimit, GlareLimit, LineLimit, PhotometrySection, PointsLimit, ZoneLimit
from lensforge.spec.receiver_sections import CylinderReceiver, FarFieldReceiver, PlaneReceiver, SphereReceiver
from lensforge.spec.shape_targets import (
    CrossTarget,
    DiscTarget,
    EllipseTarget,
    FlatTopTarget,
    PolygonTarget,
    RectangleTarget,
    RingTarget,
    SpotsTarget,
)
from lensforge.spec.source_sections import (
    Chip,
    ChipArraySource,
    ChipsSource,
    DiscSource,
    LuminanceSource,
    RadianceSource,
    RayfilePart,
    RayfileSource,
    RayfilesSource,
    RaySource,
    RectangleSource,
    SquareSource,
)
from lensforge.spec.target_sections import (
    ArrayTarget,
    BatwingTarget,
    BeamTarget,
    ImageTarget,
    PhotometricTarget,
    TableTarget,
    TextTarget,
)
from lensforge.spec.tolerances_section import ToleranceSpec, TolerancesSection
from lensforge.verbs import handover, rays, sweep, tradeoff
from lensforge.version import __version__

__all__ = [
    "ArrayTarget",
    "BaseSection",
    "BatwingTarget",
    "BeamAngleLimit",
    "BeamTarget",
    "Cancelled",
    "Check",
    "Chip",
    "ChipArraySource",
    "ChipsSource",
    "Conditions",
    "ConstraintsSection",
    "Correction",
    "CosineIntensity",
    "Criterion",
    "CriterionMissed",
    "CrossTarget",
    "CylinderReceiver",
    "Design",
    "DiscSource",
    "DiscTarget",
    "DrawingSection",
    "EllipseTarget",
    "EvaluateSection",
    "FarFieldReceiver",
    "FileSpectrum",
    "FixedAsphere",
    "FixedBiconic",
    "FixedCadFace",
    "FixedLensFace",
    "FixedPoints",
    "FixedSphere",
    "FlatTopTarget",
    "GlareLimit",
    "Handover",
    "ImageTarget",
    "InputError",
    "Lens",
    "LensSection",
    "LensforgeError",
    "Light",
    "LimitResult",
    "LineLimit",
    "LineSpectrum",
    "LuminanceSource",
    "ManufactureSection",
    "Metric",
    "MissingResult",
    "OptimiseSection",
    "Part",
    "PhotoComparison",
    "PhotometricIntensity",
    "PhotometricSummary",
    "PhotometricTarget",
    "Photometry",
    "PhotometrySection",
    "PlaneReceiver",
    "PointsLimit",
    "PolygonTarget",
    "Possible",
    "Progress",
    "Proof",
    "RadianceSource",
    "RayFileSummary",
    "RaySource",
    "RayfilePart",
    "RayfileSource",
    "RayfilesSource",
    "RectangleSource",
    "RectangleTarget",
    "RenamedWarning",
    "Results",
    "RingTarget",
    "Run",
    "Sensitivity",
    "SourceWarning",
    "Spec",
    "SphereReceiver",
    "SpotsTarget",
    "SquareSource",
    "StrayLight",
    "SurfaceComparison",
    "Sweep",
    "TableIntensity",
    "TableSpectrum",
    "TableTarget",
    "TextTarget",
    "ToleranceSpec",
    "TolerancesSection",
    "Tool",
    "Tradeoff",
    "Verdict",
    "Yield",
    "ZoneLimit",
    "__version__",
    "best_design",
    "build",
    "check",
    "compare",
    "correct",
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
    "tolerance",
    "tradeoff",
    "verify",
]

NAMES = {name: globals()[name] for name in __all__}
