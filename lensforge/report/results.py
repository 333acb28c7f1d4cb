"""A result folder as the report sees it: what each stage left, or that it left nothing."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.files import read_json
from lensforge.lens import Lens, load_lens
from lensforge.report.part_records import PhotoRecord, StrayRecord, SurfaceRecord
from lensforge.report.reading import Arrays, load_arrays, load_pictures, parse, read_content
from lensforge.report.records import (
    CheckRecord,
    DesignRecord,
    EvaluateRecord,
    ExportRecord,
    GateRecord,
    VerifyRecord,
)

STAGES = ("design", "evaluate", "export", "check", "verify")
SIDES = ("inner", "outer")
# Written on request or when there is a part to measure; nobody misses them.
EXTRAS = ("stray", "compare", *(f"compare_{side}" for side in SIDES))

_LIGHT = ("irradiance", "raw", "target")
_MAPS = tuple(f"{side}_{name}" for side in SIDES for name in ("sag_mm", "kappa_min", "residual_mm"))
_GAPS = tuple(f"gaps_{name}_mm" for name in ("mesh", "step", "mitsuba"))


@dataclass(frozen=True)
class MeasuredSurface:
    """Points measured on one surface: the record, its deviation map, and the light before and after it."""

    record: SurfaceRecord
    form: Arrays | None
    light: Arrays | None


@dataclass(frozen=True)
class Results:
    """The lens, each stage's record and arrays (None where the stage has not run), and the raw JSON by stage.

    ``gaps``: quantiles of the landing gaps (mm) by referee. ``photo``: the photograph of the part's light;
    ``surfaces``: what was measured of it, by side.
    """

    directory: Path
    lens: Lens
    content: dict[str, dict[str, Any]]
    design: DesignRecord | None
    evaluate: EvaluateRecord | None
    export: ExportRecord | None
    check: CheckRecord | None
    verify: VerifyRecord | None
    stray: StrayRecord | None
    photo: PhotoRecord | None
    surfaces: dict[str, MeasuredSurface]
    images: Arrays | None
    maps: Arrays | None
    verified: Arrays | None
    gaps: Arrays | None
    stray_images: Arrays | None
    photo_images: Arrays | None

    @property
    def missing(self) -> list[str]:
        """Stages that have not run."""
        return [stage for stage in STAGES if stage not in self.content]

    def gates(self) -> Iterator[tuple[str, GateRecord]]:
        """(stage, gate) of all that has run."""
        records = {stage: getattr(self, stage) for stage in STAGES}
        records |= {"stray light": self.stray, "photograph": self.photo}
        records |= {f"{side} surface": surface.record for side, surface in self.surfaces.items()}
        for stage, record in records.items():
            for gate in record.gates if record is not None else ():
                yield stage, gate


def load_results(directory: Path) -> Results:
    """Read all that is in ``directory``; only lens.json must be there. Raises :class:`InputError` for a broken file."""
    directory = Path(directory)
    lens = load_lens(directory / "lens.json")
    present = (stage for stage in (*STAGES, *EXTRAS) if (directory / f"{stage}.json").exists())
    content = {stage: read_content(directory, stage) for stage in present}
    return Results(
        directory=directory,
        lens=lens,
        content={"lens": read_json(directory / "lens.json"), **content},
        design=parse(DesignRecord, directory, content, "design"),
        evaluate=parse(EvaluateRecord, directory, content, "evaluate"),
        export=parse(ExportRecord, directory, content, "export"),
        check=parse(CheckRecord, directory, content, "check"),
        verify=parse(VerifyRecord, directory, content, "verify"),
        stray=parse(StrayRecord, directory, content, "stray"),
        photo=parse(PhotoRecord, directory, content, "compare"),
        surfaces=_surfaces(directory, content),
        images=_evaluate_images(directory, content),
        maps=load_pictures(directory, content, "check", _MAPS, rim=True),
        verified=load_pictures(directory, content, "verify", ("irradiance", "design_irradiance")),
        gaps=load_arrays(directory, content, "verify", _GAPS, optional=True),
        stray_images=load_pictures(directory, content, "stray", ("sequential", "direct", "stray")),
        photo_images=load_pictures(directory, content, "compare", ("measured", "simulated")),
    )


def _evaluate_images(directory: Path, content: dict[str, Any]) -> Arrays | None:
    images = load_pictures(directory, content, "evaluate", _LIGHT)
    axis = load_arrays(directory, content, "evaluate", ("axis_mm",))
    if images is None or axis is None:
        return None
    if axis["axis_mm"].shape != images["target"].shape[:1]:
        raise InputError(
            f"{directory / 'evaluate.npz'}: axis_mm does not fit the images; run `lensforge evaluate` again"
        )
    return images


def _surfaces(directory: Path, content: dict[str, Any]) -> dict[str, MeasuredSurface]:
    found = {}
    for side in SIDES:
        stage = f"compare_{side}"
        record = parse(SurfaceRecord, directory, content, stage)
        if record is not None:
            form = load_pictures(directory, content, stage, ("deviation_um",), rim=True)
            light = load_pictures(directory, content, stage, ("irradiance_design", "irradiance_measured"))
            found[side] = MeasuredSurface(record, form, light)
    return found
