"""What the report needs of each stage's JSON file, validated as it is read; everything else passes by unseen."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, PositiveFloat


class Record(BaseModel):
    """Frozen; what it does not know passes by."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class GateRecord(Record):
    """A gate as the stages write it."""

    name: str
    value: float | None
    sense: Literal["<=", ">="]
    limit: float
    unit: str
    remedy: str
    passed: bool


class Stage(Record):
    """What every stage writes."""

    gates: tuple[GateRecord, ...] = ()
    seconds: float | None = None


class Level(Record):
    """One level's turn in the search: a value for each step; designs of earlier versions lack constraints or loss."""

    level: int
    functions: int
    nmse: tuple[float | None, ...]
    efficiency: tuple[float | None, ...]
    loss: tuple[float | None, ...] = ()
    g1_mm: tuple[float, ...] = ()
    g2_mm: tuple[float, ...] = ()
    g3_mm: tuple[float, ...] = ()


class DesignRecord(Stage):
    """``design.json``."""

    steps: int
    history: tuple[Level, ...]
    constraints: dict[str, float]
    max_radius_mm: float
    height_mm: float
    source_outline_mm: tuple[tuple[float, float, float], ...] | None = None


class TablesError(Record):
    """What the tables of a stage leave against the exact surfaces."""

    hit_mm: float
    irradiance_nmse: float
    irradiance_nmse_standard_error: float | None = None


class PresetErrorRecord(Record):
    """What the accuracy preset was measured to leave on this scene."""

    design: TablesError
    evaluation: TablesError


class EvaluateRecord(Stage):
    """``evaluate.json``; metrics that have no meaning for a design are None."""

    nmse: float | None
    nmse_standard_error: float | None = None
    efficiency: float | None
    efficiency_standard_error: float | None = None
    uniformity: float | None = None
    uniformity_standard_error: float | None = None
    rsd: float | None = None
    rsd_standard_error: float | None = None
    flux: dict[str, float]
    missed_by_cause: dict[str, float] = {}
    preset_error: PresetErrorRecord | None = None
    nmse_of_noise: float | None = None
    rays: int
    pixels: int
    filter: str = ""
    receiver_mm: PositiveFloat
    window_mm: PositiveFloat


class Extremes(Record):
    """The size of a quantity over a surface or over rays."""

    max: float
    rms: float


class ExportRecord(Stage):
    """``export.json``."""

    form_error_nm: Extremes
    normal_error_mrad: Extremes
    volume_mm3: float
    watertight: bool
    genus: int


class SphereRecord(Record):
    """The best-fit sphere of a face."""

    radius_mm: float
    pv_mm: float
    rms_mm: float


class CutterRecord(Record):
    """How a ball cutter fares on a face; an unbounded number is None."""

    radius_mm: PositiveFloat
    reachable_fraction: float
    largest_radius_mm: float | None
    residual_mm: float | None


class FaceRecord(Record):
    """One face in ``check.json``."""

    best_fit_sphere: SphereRecord
    cutter: CutterRecord


class VerdictRecord(Record):
    """What the shop can or cannot do."""

    name: str
    surface: str
    holds: bool
    reason: str


class CheckRecord(Stage):
    """``check.json``."""

    inner: FaceRecord
    outer: FaceRecord
    min_wall_mm: float
    verdicts: tuple[VerdictRecord, ...] = ()


class DeviationRecord(Extremes):
    """How far from the design rays land."""

    p99: float | None = None


class AgreementRecord(Record):
    """How far from the design rays land (mm), how much their flux differs, and how many have another fate."""

    compared: int
    rms: float
    p99: float
    max: float
    flux: float
    fates: int


class RefereeRecord(Record):
    """trimesh's plain path against the quick cast."""

    rays: int
    casts: int
    disagreements: int


class BrepRecord(Record):
    """The STEP under rays."""

    rays: int
    against_design: AgreementRecord
    against_mesh: AgreementRecord


class MitsubaRecord(Record):
    """The mesh under Mitsuba."""

    version: str
    rays: int
    nmse_vs_design: float
    noise_floor_nmse: float
    against_design: AgreementRecord


class VerifyRecord(Stage):
    """``verify.json``."""

    rays: int
    nmse_vs_design: float | None
    noise_floor_nmse: float | None
    nmse_same_rays: float | None = None
    efficiency: float | None
    deviation_mm: DeviationRecord
    flux: dict[str, float] = {}
    missed_by_cause: dict[str, float] = {}
    flux_deviation: float | None = None
    fate_disagreements: int | None = None
    referee: RefereeRecord | None = None
    brep: BrepRecord | None = None
    mitsuba: MitsubaRecord | None = None
