"""What the report needs of the files that not every design has: stray light, a photograph, measured surfaces."""

from lensforge.report.records import Record, Stage


class SpreadRecord(Record):
    """Where on the receiver stray light lands; None where there is none."""

    centroid_mm: tuple[float, float] | None
    rms_radius_mm: float | None
    peak_w_m2: float
    peak_of_mean: float | None


class StrayRecord(Stage):
    """``stray.json``; all fluxes are shares of what is emitted."""

    rays: int
    base: str
    absorption_per_mm: float
    flux: dict[str, float]
    detected_stray_by_cause: dict[str, float]
    misjudged_flux: float
    nmse_vs_sequential: float | None
    stray: SpreadRecord
    efficiency: float
    efficiency_sequential: float


class SimilarityRecord(Record):
    """How alike two pictures are."""

    ssim: float
    nmse: float


class UniformityRecord(Record):
    """In the mask of the spec; None where it has none."""

    uniformity: float | None
    rsd: float | None


class LocatedRecord(Record):
    """How the corners were found that were not given."""

    seen_in: str
    lit: bool
    edge_rms_px: float
    edge_bow_px: float


class PhotoRecord(Stage):
    """``compare.json``: a photograph of the part's light."""

    on: str
    off: str | None
    corners_located: LocatedRecord | None = None
    target_mm: float
    gamma: float
    ssim: float
    nmse: float
    displacement_mm: tuple[float, float]
    aligned: SimilarityRecord
    measured: UniformityRecord
    simulated: UniformityRecord
    clipped: float


class ExtentRecord(Record):
    """The size of a deviation over a surface."""

    pv: float
    rms: float
    min: float
    max: float


class JudgedRecord(Record):
    """What the light of a lens is worth; None where a metric has no meaning."""

    nmse: float | None
    uniformity: float | None
    rsd: float | None
    efficiency: float | None


class SurfaceRecord(Stage):
    """``compare_inner.json`` and ``compare_outer.json``: points measured on a surface."""

    registration: str
    points: int
    used_share: float
    covered_share: float
    form_deviation_um: ExtentRecord
    point_deviation_um: ExtentRecord
    residual_rms_um: float
    rays: int
    design: JudgedRecord
    measured: JudgedRecord
    nmse_between: float
