"""The names of the library, and the stages of a result folder in one table.

A verb takes objects and returns one frozen result. A stage is declared once: its verb, what it takes from a folder and
writes there, the options and the help of its command.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from lensforge.addon import addons
from lensforge.cad.part import Part
from lensforge.errors import (
    Cancelled,
    CriterionMissed,
    FileWarning,
    InputError,
    LensforgeError,
    MissingResult,
    SourceWarning,
)
from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate, photometry
from lensforge.light.light_facts import Attainable
from lensforge.light.photometry_result import Photometry
from lensforge.light.receiver_light import Possible
from lensforge.made.part_verbs import sensitivity, tolerance
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.optics.media import Surface
from lensforge.proof.casts import stray_light, verify
from lensforge.proof.proof_result import Proof, StrayLight
from lensforge.report.folder import Run, RunFolder, load, opened
from lensforge.report.pipeline import build, check, run, sweep, tradeoff
from lensforge.report.results import Results, handover, stem_of
from lensforge.report.sweep import Sweep
from lensforge.report.tradeoff import Tradeoff, TradeoffRow
from lensforge.results import Conditions, Fact, Metric, StageResult
from lensforge.results.fact import Change, Group
from lensforge.results.verdict import Verdict
from lensforge.scene.lens import Lens, load_lens
from lensforge.search.design_result import Design, Progress
from lensforge.search.searches import best_design, design, redesign
from lensforge.shop.check_result import Check
from lensforge.shop.handover import Handover
from lensforge.sources.photometric_summary import PhotometricSummary, rays
from lensforge.sources.ray_file_summary import RayFileSummary
from lensforge.spec import (
    BaseSection,
    ConstraintsSection,
    CupSection,
    DrawingSection,
    EvaluateSection,
    ExitFace,
    ExtrudedSection,
    ExtrudedTirSection,
    FaceSection,
    FlangeSection,
    LensSection,
    ManufactureSection,
    OptimiseSection,
    Preset,
    ReceiverSection,
    ReflectorSection,
    Spec,
    TargetSection,
    TirSection,
    Tool,
    load_spec,
)
from lensforge.spec.accuracy import preset_of
from lensforge.spec.bodies_section import BodySection, ShellFace
from lensforge.spec.coating_section import CoatingSection, CoverGlassSection, LayerSection
from lensforge.spec.crosstalk import CrosstalkLimit
from lensforge.spec.cut_off import CutOffLimit
from lensforge.spec.emitter_section import (
    CosineIntensity,
    EmitterSection,
    FileSpectrum,
    GaussianSpectrum,
    LineSpectrum,
    PhotometricIntensity,
    TableIntensity,
    TableSpectrum,
)
from lensforge.spec.fixed_surface import FixedFace
from lensforge.spec.housing_sections import HousingSection
from lensforge.spec.lamps_section import EndlessLamps, GridLamps, HexagonLamps, RingLamps, TableLamps
from lensforge.spec.lens_material import OpticalData
from lensforge.spec.light_field import LightFieldLimit
from lensforge.spec.light_limits import (
    BeamAngleLimit,
    BlockedLimit,
    BodyLimit,
    ColourSection,
    GlareLimit,
    LineLimit,
    LossLimit,
    LuminanceLimit,
    PhotometrySection,
    PointsLimit,
    ZoneLimit,
)
from lensforge.spec.part_section import FeetSection
from lensforge.spec.peak_limit import PeakLimit
from lensforge.spec.plate_section import DrawnOutline, PlateBoss, PlateGate, PlateHole, PlatePin, PlateSection
from lensforge.spec.scatter_section import AbgScatter, GaussianScatter, LambertianScatter, TableScatter
from lensforge.spec.screen_points import ScreenLimit
from lensforge.spec.source_sections import Chip, NamedSource, RayfilePart
from lensforge.spec.state_section import StateSection
from lensforge.spec.tolerances_section import FaceTolerances, PartTolerances, ToleranceSpec, TolerancesSection
from lensforge.version import __version__

__all__ = [
    "AbgScatter",
    "BaseSection",
    "BeamAngleLimit",
    "BlockedLimit",
    "BodyLimit",
    "BodySection",
    "Cancelled",
    "Check",
    "Chip",
    "CoatingSection",
    "ColourSection",
    "Conditions",
    "ConstraintsSection",
    "CosineIntensity",
    "CoverGlassSection",
    "CriterionMissed",
    "CrosstalkLimit",
    "CupSection",
    "CutOffLimit",
    "Design",
    "DrawingSection",
    "DrawnOutline",
    "EndlessLamps",
    "EvaluateSection",
    "ExitFace",
    "ExtrudedSection",
    "ExtrudedTirSection",
    "FaceSection",
    "FaceTolerances",
    "Fact",
    "FeetSection",
    "FileSpectrum",
    "FileWarning",
    "FlangeSection",
    "GaussianScatter",
    "GaussianSpectrum",
    "GlareLimit",
    "GridLamps",
    "Handover",
    "HexagonLamps",
    "HousingSection",
    "InputError",
    "LambertianScatter",
    "LayerSection",
    "Lens",
    "LensSection",
    "LensforgeError",
    "Light",
    "LightFieldLimit",
    "LineLimit",
    "LineSpectrum",
    "LossLimit",
    "LuminanceLimit",
    "ManufactureSection",
    "Metric",
    "MissingResult",
    "NamedSource",
    "OpticalData",
    "OptimiseSection",
    "Part",
    "PartTolerances",
    "PeakLimit",
    "PhotometricIntensity",
    "PhotometricSummary",
    "Photometry",
    "PhotometrySection",
    "PlateBoss",
    "PlateGate",
    "PlateHole",
    "PlatePin",
    "PlateSection",
    "PointsLimit",
    "Possible",
    "Preset",
    "Progress",
    "Proof",
    "RayFileSummary",
    "RayfilePart",
    "ReflectorSection",
    "Results",
    "RingLamps",
    "Run",
    "ScreenLimit",
    "Sensitivity",
    "ShellFace",
    "SourceWarning",
    "Spec",
    "StateSection",
    "StrayLight",
    "Sweep",
    "TableIntensity",
    "TableLamps",
    "TableScatter",
    "TableSpectrum",
    "TirSection",
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
    "design",
    "evaluate",
    "handover",
    "load",
    "load_lens",
    "load_spec",
    "photometry",
    "preset_of",
    "rays",
    "redesign",
    "run",
    "sensitivity",
    "stray_light",
    "sweep",
    "tolerance",
    "tradeoff",
    "verify",
]  # fmt: skip


_OF_KINDS = (EmitterSection, FixedFace, TargetSection, ReceiverSection, HousingSection)
NAMES: dict[str, Any] = {name: globals()[name] for name in __all__} | {
    kind.__name__: kind for base in _OF_KINDS for kind in base.kinds.values()
}


def _beside(names: Mapping[str, object], *further: type) -> dict[str, type]:
    """Classes that ``help`` names beside ``names``: those that they extend, and ``further`` ones, by their names."""
    bases = (base for named in names.values() if isinstance(named, type) for base in named.__mro__)
    return {cls.__name__: cls for cls in (*further, *bases) if cls.__module__ == "lensforge"}


UNLISTED = _beside(NAMES, Attainable, Change, Group, Surface, TradeoffRow)  # fields and methods have these


@cache
def public_names() -> dict[str, Any]:
    """All names of the library, those of add-ons among them, which are loaded here."""
    for addon in addons():
        names = addon.names()
        if taken := sorted(names.keys() & NAMES.keys()):
            raise InputError(f"add-on {addon.name}: {taken[0]} is a name that the library has; take another")
        NAMES.update(names)
        UNLISTED.update(_beside(names))
    return NAMES


Decides = Literal["light", "files", "cutting", ""]
_Result = TypeVar("_Result", bound=StageResult)


@dataclass(frozen=True)
class FolderStage(Generic[_Result]):
    """A stage of a result folder: the verb, what it takes from the folder, and what is written there.

    ``verb``: of the library. ``name``, ``help``, ``options``: of the command; each option is a keyword of the verb.
    ``decides``: part of the verdict by which the command ends well or not. ``inputs``: what the verb takes first, by
    the run and the options. ``settings``: keywords that the folder gives. ``after``: writes further files.
    ``counts``: what the ``progress`` of the verb counts, where it has one. ``keeps``: file of what an interrupted
    verb has done, from which the same command goes on.
    """

    name: str
    verb: Callable[..., _Result]
    help: str
    options: tuple[str, ...] = ()
    decides: Decides = ""
    inputs: Callable[[Results, Mapping[str, Any]], tuple[object, ...]] = lambda run, _: (run.lens,)
    settings: Callable[[RunFolder, Mapping[str, Any]], Mapping[str, Any]] = lambda _folder, _options: {}
    after: Callable[[RunFolder, _Result], object] = lambda _folder, _result: None
    counts: str = ""
    keeps: str = ""

    def run(self, folder: Path, **options: Any) -> _Result:
        """Run the stage in a result folder, and return what it wrote; ``options``: keywords of the verb."""
        with opened(folder) as here:
            return self.run_in(here, **options)

    def run_in(self, here: RunFolder, **options: Any) -> _Result:
        """Run the stage in a folder that is open already; under other conditions the result goes beside the own one."""
        inputs = self.inputs(here.run, options)
        settings = self.settings(here, options)
        result = here.write(self.verb(*inputs, **settings, **options))
        self.after(here, result)
        return result


YIELD_PARTS = "yield_parts.npz"  # parts that an interrupted study has measured


def _write_parts(here: RunFolder, study: Yield) -> None:
    """Write the table of parts beside the record; what was kept of an interrupted study goes."""
    study.save(here.path / f"{stem_of(study)}.csv")
    (here.path / YIELD_PARTS).unlink(missing_ok=True)


EVALUATE = FolderStage(
    "evaluate",
    evaluate,
    """Simulate the finished lens in DIR again.

    With other --rays, --pixels, --source or --temperature than in the design the result is written to
    evaluate_NAME.json beside evaluate.json. It does not change the verdict; the report shows it under other conditions.
    """,
    options=("rays", "threads", "pixels", "source", "temperature_c", "name"),
    decides="light",
)
EXPORT = FolderStage(
    "export",
    build,
    """Write STEP, STL and 3MF of the lens in DIR.

    Each file is verified by reading it back.
    """,
    options=("schema", "extension_deg", "nodes", "form_nm", "normal_mrad", "rings", "date"),
    decides="files",
)
CHECK = FolderStage(
    "check",
    check,
    """Say if the lens in DIR can be made, and what to change.

    Each face, each tool, how much of the face it reaches, and the fields of the spec that change it. --json has all
    measurements: best-fit sphere, curvature, walls, draft. By another --process than the spec's the result is written
    to check_PROCESS.json beside check.json. It does not change the verdict.
    """,
    options=("process",),
    inputs=lambda run, _: (run.part_or_lens,),
    decides="cutting",
)
VERIFY = FolderStage(
    "verify",
    verify,
    """Cast rays through the exported part in DIR.

    The ray cast is independent of the design. With other --rays than the preset's the result is written to
    verify_NUMBERrays.json beside verify.json.
    """,
    options=("rays", "threads"),
    inputs=lambda run, _: (run.part, run.light),
    decides="files",
)
STRAY = FolderStage(
    "stray",
    stray_light,
    "Trace rays through the exported part with reflections, base and absorption: verify --stray.",
    options=("rays", "threads", "base"),
    inputs=lambda run, _: (run.part,),
)
PHOTOMETRY = FolderStage(
    "photometry",
    photometry,
    "Compute lumens, candela and beam angles of the lens in DIR; write IES, EULUMDAT, TM-33 and TM-25 files.",
    options=("rays", "seed", "threads", "lumens", "ies_version"),
)
SENSITIVITY = FolderStage(
    "sensitivity",
    sensitivity,
    """Change each tolerance of the lens in DIR, one at a time.

    Each is set to its amount; the change of the light goes to sensitivity.json.
    """,
    options=("rays", "threads"),
    counts="lenses",
)
YIELD = FolderStage(
    "yield",
    tolerance,
    """Draw parts of the lens in DIR from its tolerances.

    Yield, main causes, and the largest tolerances; writes yield.json and yield.csv, and the report shows them. An
    interrupted study goes on where it was.
    """,
    options=("parts", "rays", "seed", "tolerances", "budget", "threads", "scheduler"),
    settings=lambda here, _: {"checkpoint": here.path / YIELD_PARTS},
    after=_write_parts,
    counts="parts",
    keeps=YIELD_PARTS,
)
STAGES = (EVALUATE, EXPORT, CHECK, VERIFY, PHOTOMETRY, SENSITIVITY, YIELD)  # those of the core with a command
