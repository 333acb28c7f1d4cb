"""Parts measured on demand, by threads or by the workers of a cluster, and stored in one file.

An interrupted study goes on where it was, with the same bits. What all parts share is made once in each process.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock

import numpy as np
from jaxtyping import Float

from lensforge.errors import Cancelled, InputError
from lensforge.kernels.parallel import in_parallel_map
from lensforge.made.part_study import PartStudy, Recipe, Scales
from lensforge.results.cluster import WorkerPool
from lensforge.results.files import MIB, read_file, replacing
from lensforge.results.json_npz import Form, arrays_in, parse_json, require_forms
from lensforge.results.stage_result import require_checksum, with_checksum
from lensforge.version import made_by

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
        """Parts that an earlier run of the same study left in ``file``; empty after another study.

        Raises :class:`InputError` for a damaged file, and for one whose checksum does not match.
        """
        recipe = study.recipe
        identity = [recipe.lens.sha256, recipe.seed, recipe.designed_rays, made_by()]
        key = hashlib.sha256(json.dumps(identity).encode()).hexdigest()  # more parts in all change no part
        if file is None or not (file.exists() or file.is_symlink()):
            return KeptParts(file, key)
        content = read_file(file, missing=_ANEW, most_bytes=_MOST_BYTES)
        try:
            arrays = arrays_in(content, ("head", *_NUMBERS), _MOST_BYTES)
            head = parse_json(arrays["head"].tobytes())
            if not isinstance(head, dict):
                raise ValueError("its head is no object")
            head = require_checksum(head, file, _ANEW)
            if head["sha256"] != _sha256(arrays):
                raise ValueError("its numbers are not those that were written")
            if head["key"] != key:
                return KeptParts(file, key)
            return KeptParts(file, key, _parts(arrays, head["scaled"], len(study.names)))
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{file}: no parts of a study ({str(error)[:80]}); {_ANEW}") from None

    def save(self) -> None:
        """Write all known parts, with a checksum."""
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
    digest = hashlib.sha256()
    for name in _NUMBERS:
        digest.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape} ".encode() + arrays[name].tobytes())
    return digest.hexdigest()


def _parts(
    arrays: Mapping[str, np.ndarray], scaled: Sequence[str], metrics: int
) -> dict[_RaysAndJob, Float[np.ndarray, "m 2"]]:
    """Metrics by rays and job; a scale of 1 is none. Raises :class:`ValueError` for arrays that do not fit."""
    counts = Form(("n",), "int64", least=0.0)
    forms = {"head": Form(("bytes",), "uint8"), "rays": counts, "numbers": counts}
    require_forms(arrays, {**forms, "scales": Form(("n", len(scaled))), "values": Form(("n", metrics, 2))})
    rays, numbers, scales, values = (arrays[name] for name in _NUMBERS)
    jobs = [
        (count, (number, tuple((name, factor) for name, factor in zip(scaled, row, strict=True) if factor != 1.0)))
        for count, number, row in zip(rays.tolist(), numbers.tolist(), scales.tolist(), strict=True)
    ]
    return dict(zip(jobs, values, strict=True))


_SAVE_SECONDS = 5.0
_CHUNK = 8  # parts of one task: a second of work, which a lost worker repeats

Progress = Callable[[int, int], object]  # parts measured, and of those that a stage asks for; False cancels


Chunks = Sequence[tuple[Job, ...]]
MeasuredChunks = Iterator[tuple[int, Float[np.ndarray, "j m 2"]]]  # numbers of chunks, in any order, and their metrics


def prepare(study: PartStudy) -> None:
    """Compute everything that the parts share before several threads need it."""
    _ = study.draws, study.of_design, study.bounds


def measured(study: PartStudy, job: Job) -> Float[np.ndarray, "m 2"]:
    """Metrics of one part."""
    number, scales = job
    return study.measure(number, dict(scales))


@dataclass
class MeasuredParts:
    """Metrics of the parts of ``study``; parts not ``kept`` are measured by ``workers``, or by threads here."""

    study: PartStudy
    workers: WorkerPool | None = None
    kept: KeptParts = field(default_factory=KeptParts)
    progress: Progress | None = None

    def with_rays(self, rays: int) -> "MeasuredParts":
        """The same draws measured with another number of ``rays``; both share one file."""
        return self if rays == self.study.recipe.rays else replace(self, study=self.study.with_rays(rays))

    def of(self, parts: Iterable[int], scales: Scales | None = None) -> Float[np.ndarray, "n m 2"]:
        """Metrics of ``parts`` with some of their deviations scaled."""
        known = self.kept.known
        rays = self.study.recipe.rays
        scaled = tuple(sorted((name, factor) for name, factor in (scales or {}).items() if factor != 1.0))
        jobs = [(number, scaled) for number in parts]
        missing = [job for job in jobs if (rays, job) not in known]
        chunks = [tuple(missing[first : first + _CHUNK]) for first in range(0, len(missing), _CHUNK)]
        saved = time.monotonic()
        done = len(jobs) - len(missing)
        try:
            for number, values in self._measured(chunks) if chunks else ():
                known.update(zip(((rays, job) for job in chunks[number]), values, strict=True))
                done += len(chunks[number])
                if self.progress is not None and self.progress(done, len(jobs)) is False:
                    raise Cancelled("yield: cancelled")
                if time.monotonic() - saved > _SAVE_SECONDS:
                    self.kept.save()
                    saved = time.monotonic()
        finally:
            if chunks:
                self.kept.save()
        return np.stack([known[rays, job] for job in jobs])

    def _measured(self, chunks: Chunks) -> MeasuredChunks:
        """Each chunk as a task of the workers, or in turn, with as many parts at once as kernels may use threads."""
        if self.workers is not None:
            return self.workers.map(measured_chunk, self.study.recipe, chunks)
        prepare(self.study)
        by_threads = (in_parallel_map(lambda job: measured(self.study, job), chunk) for chunk in chunks)
        return enumerate(map(np.stack, by_threads))


_MOST_STUDIES = 2  # in the memory of a worker: of the same lens with fewer rays, and the one at hand
_studies: list[PartStudy] = []
_lock = Lock()


def measured_chunk(recipe: Recipe, chunk: tuple[Job, ...]) -> Float[np.ndarray, "j m 2"]:
    """Metrics of the parts of one task."""
    study = _study(recipe)
    return np.stack([measured(study, job) for job in chunk])


def _study(recipe: Recipe) -> PartStudy:
    with _lock:  # a worker may have several threads
        for study in _studies:
            if _identity(study.recipe) == _identity(recipe):
                return study
        made = PartStudy(recipe)
        for study in _studies:
            if _identity(replace(study.recipe, rays=recipe.rays)) == _identity(recipe):
                made = study.with_rays(recipe.rays)
        prepare(made)
        _studies[:] = [made, *_studies[: _MOST_STUDIES - 1]]
        return made


def _identity(recipe: Recipe) -> tuple[object, ...]:
    return recipe.lens.sha256, recipe.parts, recipe.rays, recipe.seed, recipe.designed_rays
