"""Files of a result folder, checked as they are read: whatever is wrong with one is a line that says what to run."""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel, ValidationError

from lensforge.errors import InputError
from lensforge.files import read_json

Arrays = dict[str, Float[np.ndarray, "..."]]

_Record = TypeVar("_Record", bound=BaseModel)
# What writes a record that is not called after its stage.
_WRITERS = {
    "stray": "verify --stray",
    "compare": "compare --on",
    "compare_inner": "compare --points --surface inner",
    "compare_outer": "compare --points --surface outer",
}


def read_content(directory: Path, stage: str) -> dict[str, Any]:
    """The object in a stage's JSON file."""
    path = directory / f"{stage}.json"
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds a {type(content).__name__}, must be an object; {_again(stage)}")
    return content


def parse(model: type[_Record], directory: Path, content: dict[str, Any], stage: str) -> _Record | None:
    """The record of ``stage`` in ``content``; None where the stage has not run."""
    if stage not in content:
        return None
    try:
        return model.model_validate(content[stage])
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{directory / f'{stage}.json'}: {field}: {first['msg']}; {_again(stage)}") from None


def load_pictures(
    directory: Path, content: dict[str, Any], stage: str, names: Sequence[str], rim: bool = False
) -> Arrays | None:
    """The square arrays ``names`` of a stage's npz, all of one size; None where the stage or its npz is absent.

    With ``rim`` they are maps of a face, with gaps outside of it; without, every value is finite.
    """
    arrays = load_arrays(directory, content, stage, names)
    if arrays is None:
        return None
    path = directory / f"{stage}.npz"
    first = arrays[names[0]].shape
    if len(first) != 2 or first[0] != first[1] or first[0] < 2 or any(each.shape != first for each in arrays.values()):
        raise InputError(f"{path}: its arrays must be square and of one size; {_again(stage)}")
    for name, array in arrays.items():
        known = np.isfinite(array)
        if np.isinf(array).any() or not (known.any() or "residual" in name if rim else known.all()):
            raise InputError(f"{path}: {name} holds numbers that are not finite; {_again(stage)}")
    return arrays


def load_arrays(
    directory: Path, content: dict[str, Any], stage: str, names: Sequence[str], optional: bool = False
) -> Arrays | None:
    """The arrays ``names`` of a stage's npz, of any shape; None where the stage or its npz is absent.

    With ``optional``, those that an earlier version did not write are left out.
    """
    path = directory / f"{stage}.npz"
    if stage not in content or not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            wanted = [name for name in names if name in file] if optional else names
            return {name: np.asarray(file[name], dtype=np.float64) for name in wanted}
    except KeyError as error:
        raise InputError(f"{path}: {error.args[0]}; {_again(stage)}") from None
    except (OSError, ValueError, TypeError, EOFError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: damaged ({type(error).__name__}: {error}); {_again(stage)}") from None


def _again(stage: str) -> str:
    return f"run `lensforge {_WRITERS.get(stage, stage)}` again"
