"""Checkpoint of a search: its whole state in one file, so that a resumed design ends with the same bits.

The file holds no code: a line that names the format, the SHA-256 of all that follows, a head as one line of JSON, and
an archive of NumPy's with the arrays.
"""

import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lensforge.errors import InputError
from lensforge.results import Count, NotNegative, Record, Sha256, Text
from lensforge.results.files import read_file, replacing
from lensforge.results.json_npz import arrays_in
from lensforge.results.stage_result import validated
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Level
from lensforge.search.schedule import Outcome
from lensforge.spec import Spec
from lensforge.spec.spec_files import input_hashes, section_sha256
from lensforge.spec.tolerances_section import FaceTolerances
from lensforge.version import made_by

if TYPE_CHECKING:
    import torch

CHECKPOINT = "checkpoint.bin"  # its name in a result folder
_FORMAT = b"lensforge checkpoint 4\n"
ANEW = "delete it, or start anew without resume"
_NOT_SEARCHED = ("evaluate", "base", "manufacture", "tolerances")  # what a search does not depend on
_NOT_ROBUST = ("evaluate", "manufacture")  # the same where it is robust: the lens shrinks about its seat
_MOST_BYTES = 2**30  # a million steps, the most there are, leave 150 MB


class CheckpointError(InputError):
    """A checkpoint that cannot be read, written or deleted, or is not of this search: the lens has no part in it."""


@contextmanager
def _of_checkpoint() -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise CheckpointError(str(error)) from error.__cause__


class CheckpointHead(Record):
    """State of a search without its arrays; ``key``: its :func:`fingerprint`; ``made_by``: versions of programs.

    ``outcomes``: of each stage that has ended. ``step``: steps of the stage at hand. ``steps_of_moments``: since the
    optimiser's moments began. ``seconds``: of the search so far.
    """

    key: Sha256
    made_by: dict[Text, Text]
    outcomes: tuple[Outcome, ...]
    step: Count
    steps_of_moments: Count
    seconds: NotNegative
    history: tuple[Level, ...]


def fingerprint(spec: Spec, seed: int, accuracy: str, start: Lens | None, device: "torch.device | None") -> str:
    """Digest of what a search depends on: another spec, seed, preset, start or device must not resume from it.

    The content of every file that the spec names counts, and its name; not its folder.
    """
    of_faces = [f"lens.{face}.{name}" for face in spec.lens.names for name in FaceTolerances.model_fields]
    without = _NOT_ROBUST if spec.optimise.robust else (*_NOT_SEARCHED, *of_faces)
    searched = section_sha256(spec, without=without)
    files = input_hashes(spec)
    text = f"{files}|{searched}|{spec.manufacture.process}|{seed}|{accuracy}|{start.sha256 if start else None}|{device}"
    return hashlib.sha256(text.encode()).hexdigest()


@_of_checkpoint()
def save_checkpoint(path: Path, head: CheckpointHead, arrays: Mapping[str, np.ndarray]) -> None:
    """Write a checkpoint beside ``path`` and rename it. Raises :class:`CheckpointError` where that cannot be done."""
    archive = io.BytesIO()
    np.savez(archive, allow_pickle=False, **arrays)
    content = head.model_dump_json().encode() + b"\n" + archive.getvalue()
    digest = hashlib.sha256(content).hexdigest().encode()
    with replacing(path) as temporary:
        temporary.write_bytes(_FORMAT + digest + b"\n" + content)


@_of_checkpoint()
def load_checkpoint(path: Path, key: str) -> tuple[CheckpointHead, dict[str, np.ndarray]]:
    """Read a checkpoint of this very design. Raises :class:`CheckpointError` for none, a damaged one, or another's."""
    line, _, archive = _content(path).partition(b"\n")
    try:
        fields = json.loads(line)
        arrays = arrays_in(archive, None, _MOST_BYTES)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not the layout of a checkpoint ({type(error).__name__}); {ANEW}") from None
    head = validated(CheckpointHead, fields, path, ANEW)
    for name, here in made_by().items():
        if (then := head.made_by.get(name)) != here:
            raise InputError(
                f"{path}: written with {name} {then}, here is {here}, which may round differently; "
                f"use that version again, or {ANEW}"
            )
    if head.key != key:
        raise InputError(f"{path}: belongs to another spec, file, seed, accuracy, start or device; {ANEW}")
    return head, arrays


_MOST_SEARCHES = 3  # in turn: polished, frosted, of all kinds
MOST_SIZES = 16  # within which the smallest lens is sought


def of_later_search(path: Path, number: int) -> Path:
    """Checkpoint of the search that follows so many others, beside that at ``path`` of the first."""
    return path.with_name(f"{path.stem}_{number}{path.suffix}") if number else path


def of_later_size(path: Path, number: int) -> Path:
    """Checkpoint of the first search within the size that follows so many others."""
    return path.with_name(f"{path.stem}_size_{number}{path.suffix}") if number else path


def delete_checkpoint(path: Path) -> None:
    """Delete the checkpoint at ``path``, where there is one, and those of searches that follow it.

    Raises :class:`CheckpointError` where that cannot be done.
    """
    try:
        for size, number in product(range(MOST_SIZES), range(_MOST_SEARCHES)):
            of_later_search(of_later_size(path, size), number).unlink(missing_ok=True)
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be replaced ({error.strerror}); give another checkpoint") from None


def is_checkpoint(path: Path) -> bool:
    """True where ``path`` is an undamaged checkpoint, of whatever design."""
    try:
        _content(path)
    except InputError:
        return False
    return True


def _content(path: Path) -> bytes:
    content = read_file(path, missing="no checkpoint to resume from; start anew without resume", most_bytes=_MOST_BYTES)
    if not content.startswith(_FORMAT):
        raise InputError(f"{path}: no checkpoint of a search by this version; {ANEW}")
    digest, _, rest = content.removeprefix(_FORMAT).partition(b"\n")
    if hashlib.sha256(rest).hexdigest().encode() != digest:
        raise InputError(f"{path}: damaged checkpoint; {ANEW}")
    return rest
