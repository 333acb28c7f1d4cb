"""Parts that a study has measured, kept in one file: an interrupted study goes on where it was, with the same bits."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.files import MIB, read_file, replacing
from lensforge.json_text import parse_json
from lensforge.npz_file import arrays_in
from lensforge.optimisation.checkpoint import made_by
from lensforge.records.stored import require_checksum, with_checksum
from lensforge.tolerancing.part_study import PartStudy

_MOST_BYTES = 512 * MIB  # a hundred thousand parts with a hundred limits take 160 MB
_NUMBERS = ("rays", "numbers", "scales", "values")
_ANEW = "delete it to begin again"

Job = tuple[int, tuple[tuple[str, float], ...]]  # number of the part, and its scales by name
_RaysAndJob = tuple[int, Job]


@dataclass
class KeptParts:
    """Metrics and their errors of parts, by number of rays and job; ``file``: None for a study that keeps nothing.

    ``key``: of all else that decides the metrics; a study begins with few rays, and may take more.
    """

    file: Path | None = None
    key: str = ""
    known: dict[_RaysAndJob, Float[np.ndarray, "m 2"]] = field(default_factory=dict)

    @staticmethod
    def of(file: Path | None, study: PartStudy) -> "KeptParts":
        """Parts that an earlier run of the same study has left in ``file``; none where that was another study.

        Raises :class:`InputError` for a damaged file, and for one whose numbers are not those that were written.
        """
        recipe = study.recipe
        words = [recipe.lens.sha256, recipe.seed, recipe.designed_rays, made_by()]
        key = hashlib.sha256(json.dumps(words).encode()).hexdigest()  # more parts in all change no part
        if file is None or not (file.exists() or file.is_symlink()):
            return KeptParts(file, key)
        content = read_file(file, missing=_ANEW, most_bytes=_MOST_BYTES)
        try:
            arrays = arrays_in(content, ("head", *_NUMBERS), _MOST_BYTES)
            head = parse_json(arrays["head"].tobytes())
            if not isinstance(head, dict) or set(arrays) != {"head", *_NUMBERS}:
                raise ValueError("other arrays than those of a study")
            head = require_checksum(head, file, _ANEW)
            if head["sha256"] != _sha256(arrays):
                raise ValueError("its numbers are not those that were written")
            if head["key"] != key:
                return KeptParts(file, key)
            return KeptParts(file, key, _parts(arrays, head["scaled"], len(study.names)))
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{file}: no parts of a study ({str(error)[:80]}); {_ANEW}") from None

    def save(self) -> None:
        """Write all that is known, with the hash of its numbers."""
        if self.file is None or not self.known:
            return
        scaled = sorted({name for _, (_, scales) in self.known for name, _ in scales})
        scales = [[dict(scales).get(name, 1.0) for name in scaled] for _, (_, scales) in self.known]
        arrays = {
            "rays": np.array([rays for rays, _ in self.known]),
            "numbers": np.array([number for _, (number, _) in self.known]),
            "scales": np.array(scales, dtype=np.float64).reshape(len(self.known), len(scaled)),
            "values": np.stack(list(self.known.values())),
        }
        head = json.dumps(with_checksum({"key": self.key, "scaled": scaled, "sha256": _sha256(arrays)}))
        with replacing(self.file) as temporary, temporary.open("wb") as stream:
            np.savez(stream, head=np.frombuffer(head.encode(), dtype=np.uint8), **arrays)  # type: ignore[arg-type]


def _sha256(arrays: Mapping[str, np.ndarray]) -> str:
    """Hash of the numbers, their types and shapes."""
    found = hashlib.sha256()
    for name in _NUMBERS:
        found.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape} ".encode() + arrays[name].tobytes())
    return found.hexdigest()


def _parts(
    arrays: Mapping[str, np.ndarray], scaled: Sequence[str], metrics: int
) -> dict[_RaysAndJob, Float[np.ndarray, "m 2"]]:
    """Metrics by rays and job; a scale of 1 is none. Raises :class:`ValueError` for arrays that do not fit."""
    rays, numbers, scales, values = (arrays[name] for name in _NUMBERS)
    shapes_fit = scales.shape == (rays.size, len(scaled)) and values.shape == (rays.size, metrics, 2)
    if not shapes_fit or rays.dtype.kind != "i" or numbers.dtype.kind != "i" or not np.isfinite(values).all():
        raise ValueError("arrays that do not fit each other")
    jobs = [
        (count, (number, tuple((name, factor) for name, factor in zip(scaled, row, strict=True) if factor != 1.0)))
        for count, number, row in zip(rays.tolist(), numbers.tolist(), scales.tolist(), strict=True)
    ]
    return dict(zip(jobs, values, strict=True))
