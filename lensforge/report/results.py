"""A result folder as the report sees it: what each stage left, or that it left nothing."""

import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel, ValidationError

from lensforge.errors import InputError
from lensforge.files import read_json
from lensforge.lens import Lens, load_lens
from lensforge.report.records import (
    CheckRecord,
    DesignRecord,
    EvaluateRecord,
    ExportRecord,
    GateRecord,
    VerifyRecord,
)

STAGES = ("design", "evaluate", "export", "check", "verify")

_Record = TypeVar("_Record", bound=BaseModel)
_Arrays = dict[str, Float[np.ndarray, "..."]]
_IMAGES = {"evaluate": ("irradiance", "raw", "target"), "verify": ("irradiance", "design_irradiance")}
_MAPS = tuple(f"{face}_{name}" for face in ("inner", "outer") for name in ("sag_mm", "kappa_min", "residual_mm"))


@dataclass(frozen=True)
class Results:
    """The lens, each stage's record and arrays (None where the stage has not run), and the raw JSON by stage."""

    directory: Path
    lens: Lens
    content: dict[str, dict[str, Any]]
    design: DesignRecord | None
    evaluate: EvaluateRecord | None
    export: ExportRecord | None
    check: CheckRecord | None
    verify: VerifyRecord | None
    images: _Arrays | None
    maps: _Arrays | None
    verified: _Arrays | None

    @property
    def missing(self) -> list[str]:
        """Stages that have not run."""
        return [stage for stage in STAGES if stage not in self.content]

    def gates(self) -> Iterator[tuple[str, GateRecord]]:
        """(stage, gate) of all stages that have run."""
        for stage in STAGES:
            record = getattr(self, stage)
            for gate in record.gates if record is not None else ():
                yield stage, gate


def load_results(directory: Path) -> Results:
    """Read all that is in ``directory``; only lens.json must be there. Raises :class:`InputError` for a broken file."""
    directory = Path(directory)
    lens = load_lens(directory / "lens.json")
    content = {stage: _read(directory, stage) for stage in STAGES if (directory / f"{stage}.json").exists()}
    return Results(
        directory=directory,
        lens=lens,
        content={"lens": read_json(directory / "lens.json"), **content},
        design=_parse(DesignRecord, directory, content, "design"),
        evaluate=_parse(EvaluateRecord, directory, content, "evaluate"),
        export=_parse(ExportRecord, directory, content, "export"),
        check=_parse(CheckRecord, directory, content, "check"),
        verify=_parse(VerifyRecord, directory, content, "verify"),
        images=_evaluate_images(directory, content),
        maps=_load_arrays(directory, content, "check", _MAPS),
        verified=_load_arrays(directory, content, "verify", _IMAGES["verify"]),
    )


def _read(directory: Path, stage: str) -> dict[str, Any]:
    path = directory / f"{stage}.json"
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds a {type(content).__name__}, must be an object; run `lensforge {stage}` again")
    return content


def _parse(model: type[_Record], directory: Path, content: dict[str, Any], stage: str) -> _Record | None:
    if stage not in content:
        return None
    try:
        return model.model_validate(content[stage])
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"{directory / f'{stage}.json'}: {field}: {first['msg']}; run `lensforge {stage}` again"
        ) from None


def _evaluate_images(directory: Path, content: dict[str, Any]) -> _Arrays | None:
    images = _load_arrays(directory, content, "evaluate", (*_IMAGES["evaluate"], "axis_mm"))
    if images is not None and images["axis_mm"].shape != images["target"].shape[:1]:
        raise InputError(
            f"{directory / 'evaluate.npz'}: axis_mm does not fit the images; run `lensforge evaluate` again"
        )
    return images


def _load_arrays(directory: Path, content: dict[str, Any], stage: str, names: tuple[str, ...]) -> _Arrays | None:
    """The arrays ``names`` of a stage's npz; None where the stage or its npz is absent."""
    path = directory / f"{stage}.npz"
    if stage not in content or not path.exists():
        return None
    again = f"run `lensforge {stage}` again"
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name], dtype=np.float64) for name in names}
    except KeyError as error:
        raise InputError(f"{path}: {error.args[0]}; {again}") from None
    except (OSError, ValueError, TypeError, EOFError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: damaged ({type(error).__name__}: {error}); {again}") from None
    _require_sound(path, arrays, stage)
    return arrays


def _require_sound(path: Path, arrays: _Arrays, stage: str) -> None:
    """Pictures are square, of one size, and finite; maps have gaps outside the rim, and something inside."""
    again = f"run `lensforge {stage}` again"
    pictures = [array for name, array in arrays.items() if name != "axis_mm"]
    first = pictures[0].shape
    if len(first) != 2 or first[0] != first[1] or first[0] < 2 or any(picture.shape != first for picture in pictures):
        raise InputError(f"{path}: its arrays must be square and of one size; {again}")
    for name, array in arrays.items():
        known = np.isfinite(array)
        if np.isinf(array).any() or not (known.all() if stage != "check" else known.any() or "residual" in name):
            raise InputError(f"{path}: {name} holds numbers that are not finite; {again}")
