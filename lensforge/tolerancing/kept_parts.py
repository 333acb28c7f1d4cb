"""Parts that a study has measured, kept in one file: an interrupted study goes on where it was, with the same bits."""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.npz_file import arrays_in
from lensforge.optimisation.checkpoint import made_by
from lensforge.tolerancing.part_study import Recipe

_MOST_BYTES = 2**30  # unpacked; a hundred thousand parts with a hundred limits take 160 MB
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
    def of(file: Path | None, recipe: Recipe) -> "KeptParts":
        """Parts that an earlier run of the same study has left in ``file``; none where that was another study.

        Raises :class:`InputError` for a damaged file.
        """
        words = [recipe.lens.sha256, recipe.seed, recipe.designed_rays, made_by()]
        key = hashlib.sha256(json.dumps(words).encode()).hexdigest()  # more parts in all change no part
        if file is None or not file.exists():
            return KeptParts(file, key)
        try:
            arrays = arrays_in(file.read_bytes(), ("head", "values"), _MOST_BYTES)
            head: dict[str, Any] = json.loads(arrays["head"].tobytes())
            if head["key"] != key:
                return KeptParts(file, key)
            jobs = [(rays, (number, tuple(map(tuple, scales)))) for rays, number, scales in head["jobs"]]
            return KeptParts(file, key, dict(zip(jobs, arrays["values"], strict=True)))
        except OSError as error:
            raise InputError(f"{file}: cannot be read ({error.strerror}); {_ANEW}") from None
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(f"{file}: no parts of a study ({str(error)[:80]}); {_ANEW}") from None

    def save(self) -> None:
        """Write all that is known."""
        if self.file is None or not self.known:
            return
        head = {"key": self.key, "jobs": [[rays, number, scales] for rays, (number, scales) in self.known]}
        with replacing(self.file) as temporary, temporary.open("wb") as stream:
            np.savez(
                stream,
                head=np.frombuffer(json.dumps(head).encode(), dtype=np.uint8),
                values=np.stack(list(self.known.values())),
            )
