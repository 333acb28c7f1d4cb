"""The names of the library: every verb, and every class that a verb takes or returns."""

from lensforge.cast_stages import stray_light, verify
from lensforge.corrected_part import correct
from lensforge.criteria import Criterion
from lensforge.drawings.handover import Handover
from lensforge.errors import Cancelled, CriterionMissed, InputError, LensforgeError, MissingResult, SourceWarning
from lensforge.evaluation.light import Light
from lensforge.evaluation.limit_result import LimitResult
from lensforge.evaluation.receiver_light import Possible
from lensforge.far_field.photometry import Photometry
from lensforge.geometry.part import Part
from lensforge.lens import Lens, load_lens
from lensforge.manufacturing.result import Check
from lensforge.measured_part import compare
from lensforge.measurement.comparison import PhotoComparison, SurfaceComparison
from lensforge.measurement.correction_result import Correction
from lensforge.optimisation.design import Design, Progress
from lensforge.pipeline import run
from lensforge.records import Conditions, Metric
from lensforge.results import Results
from lensforge.run_folder import Run, load
from lensforge.sources.photometric.summary import PhotometricSummary
from lensforge.sources.rayfiles.summary import RayFileSummary
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
from lensforge.spec.beams import BatwingTarget, BeamTarget, PhotometricTarget
from lensforge.spec.emission import (
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
    FixedSphere,
    FixedToroid,
    FixedXYPolynomial,
    FixedZernike,
)
from lensforge.spec.given_surface import FixedCadFace, FixedLensFace, FixedPoints
from lensforge.spec.light_limits import BeamAngleLimit, GlareLimit, LineLimit, PointsLimit, ZoneLimit
from lensforge.spec.photometry import PhotometrySection
from lensforge.spec.picture_targets import ArrayTarget, ImageTarget, TableTarget, TextTarget
from lensforge.spec.ray_source import RayfilePart, RayfileSource, RayfilesSource, RaySource
from lensforge.spec.receivers import CylinderReceiver, FarFieldReceiver, PlaneReceiver, SphereReceiver
from lensforge.spec.shapes import (
    CrossTarget,
    DiscTarget,
    EllipseTarget,
    FlatTopTarget,
    PolygonTarget,
    RectangleTarget,
    RingTarget,
    SpotsTarget,
)
from lensforge.spec.source import (
    Chip,
    ChipArraySource,
    ChipsSource,
    DiscSource,
    LuminanceSource,
    RadianceSource,
    RectangleSource,
    SquareSource,
)
from lensforge.spec.tolerances import ToleranceSpec, TolerancesSection
from lensforge.stages import build, check, design, evaluate, photometry
from lensforge.starts import best_design
from lensforge.studies.sweep.table import Sweep
from lensforge.studies.tradeoff.record import Tradeoff
from lensforge.tolerance_stages import sensitivity, tolerance
from lensforge.tolerancing.sensitivity_table import Sensitivity
from lensforge.tolerancing.yield_result import Yield
from lensforge.verbs import handover, rays, sweep, tradeoff
from lensforge.verdict import Verdict
from lensforge.verification.proof import Proof
from lensforge.verification.stray_result import StrayLight
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
    "FixedToroid",
    "FixedXYPolynomial",
    "FixedZernike",
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
