"""What the report needs of each stage's JSON file, validated as it is read; everything else passes by unseen."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, PositiveFloat


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class GateRecord(_Record):
    """A gate as the stages write it."""

    name: str
    value: float | None
    sense: Literal["<=", ">="]
    limit: float
    unit: str
    remedy: str
    passed: bool


class _Stage(_Record):
    gates: tuple[GateRecord, ...] = ()
    seconds: float | None = None


class Level(_Record):
    """One level's turn in the search: a value for each step; a design of an earlier version has no constraints."""

    level: int
    functions: int
    nmse: tuple[float | None, ...]
    efficiency: tuple[float | None, ...]
    g1_mm: tuple[float, ...] = ()
    g2_mm: tuple[float, ...] = ()
    g3_mm: tuple[float, ...] = ()


class DesignRecord(_Stage):
    """``design.json``."""

    steps: int
    history: tuple[Level, ...]
    constraints: dict[str, float]
    max_radius_mm: float
    height_mm: float
    source_outline_mm: tuple[tuple[float, float, float], ...] | None = None


class EvaluateRecord(_Stage):
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
    rays: int
    pixels: int
    filter: str = ""
    receiver_mm: PositiveFloat
    window_mm: PositiveFloat


class Extremes(_Record):
    """The size of a quantity over a surface or over rays."""

    max: float
    rms: float


class ExportRecord(_Stage):
    """``export.json``."""

    form_error_nm: Extremes
    normal_error_mrad: Extremes
    volume_mm3: float
    watertight: bool
    genus: int


class SphereRecord(_Record):
    """The best-fit sphere of a face."""

    radius_mm: float
    pv_mm: float
    rms_mm: float


class CutterRecord(_Record):
    """How a ball cutter fares on a face; an unbounded number is None."""

    radius_mm: PositiveFloat
    reachable_fraction: float
    largest_radius_mm: float | None
    residual_mm: float | None


class FaceRecord(_Record):
    """One face in ``check.json``."""

    best_fit_sphere: SphereRecord
    cutter: CutterRecord


class VerdictRecord(_Record):
    """What the shop can or cannot do."""

    name: str
    surface: str
    holds: bool
    reason: str


class CheckRecord(_Stage):
    """``check.json``."""

    inner: FaceRecord
    outer: FaceRecord
    min_wall_mm: float
    verdicts: tuple[VerdictRecord, ...] = ()


class VerifyRecord(_Stage):
    """``verify.json``."""

    rays: int
    nmse_vs_design: float | None
    noise_floor_nmse: float | None
    nmse_same_rays: float | None = None
    efficiency: float | None
    deviation_mm: Extremes
    flux: dict[str, float] = {}
    missed_by_cause: dict[str, float] = {}
    referee: dict[str, Any] | None = None
