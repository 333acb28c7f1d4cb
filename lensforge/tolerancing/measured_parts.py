"""Measured parts as they come in, kept in a file: an interrupted study goes on where it was, with the same bits."""

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float

from lensforge.errors import Cancelled, InputError
from lensforge.files import replacing
from lensforge.tolerancing.part_study import PartStudy, Recipe, Scales

_SAVE_SECONDS = 5.0
_CHUNK = 8  # parts of one task: a second of work, which a lost worker repeats

Job = tuple[int, tuple[tuple[str, float], ...]]  # number of the part, and its scales by name
Progress = Callable[[int, int], object]  # parts measured, and of all; False cancels


class Workers(Protocol):
    """Interface of threads or processes that measure parts."""

    def measure(
        self, recipe: Recipe, chunks: Sequence[tuple[Job, ...]]
    ) -> Iterator[tuple[int, Float[np.ndarray, "j m 2"]]]:
        """Measure every chunk, in any order: its number, and the metrics of its parts."""
        ...


@dataclass
class Threads:
    """All cores of this process: as many parts at once as torch may use threads."""

    study: PartStudy

    def measure(
        self, recipe: Recipe, chunks: Sequence[tuple[Job, ...]]
    ) -> Iterator[tuple[int, Float[np.ndarray, "j m 2"]]]:
        """Measure every chunk in its turn."""
        study = self.study
        prepare(study)
        with ThreadPoolExecutor(torch.get_num_threads()) as pool:
            for number, chunk in enumerate(chunks):
                yield number, np.stack(list(pool.map(lambda job: measured(study, job), chunk)))


def prepare(study: PartStudy) -> None:
    """Make all that the parts share, before several threads ask for it at once."""
    _ = study.draws, study.maker, study.designed, study.of_design, study.bounds


def measured(study: PartStudy, job: Job) -> Float[np.ndarray, "m 2"]:
    """Metrics of one part."""
    number, scales = job
    return study.measure(number, dict(scales))


def job_of(number: int, scales: Scales) -> Job:
    """The job of one part; scales of 1 are none."""
    return number, tuple(sorted((name, factor) for name, factor in scales.items() if factor != 1.0))


def study_key(recipe: Recipe) -> str:
    """Hash of all that decides the metrics of a part; more parts in all change none."""
    words = [recipe.lens.sha256, recipe.rays, recipe.seed, recipe.designed_rays]
    return hashlib.sha256(json.dumps(words).encode()).hexdigest()


@dataclass
class MeasuredParts:
    """Metrics of parts by their jobs; those not known are measured by ``workers``, and kept in ``file``.

    ``expected``: jobs of the whole study, as far as known, for ``progress``.
    """

    study: PartStudy
    workers: Workers
    file: Path | None = None
    progress: Progress | None = None
    expected: int = 0
    known: dict[Job, Float[np.ndarray, "m 2"]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.file is not None and self.file.exists():
            self.known = self._read(self.file)

    def of(self, parts: Iterable[int], scales: Scales | None = None) -> Float[np.ndarray, "n m 2"]:
        """Metrics of ``parts`` with some of their deviations scaled."""
        jobs = [job_of(number, scales or {}) for number in parts]
        missing = [job for job in jobs if job not in self.known]
        chunks = [tuple(missing[first : first + _CHUNK]) for first in range(0, len(missing), _CHUNK)]
        saved = time.monotonic()
        try:
            for number, found in self.workers.measure(self.study.recipe, chunks) if chunks else ():
                self.known.update(zip(chunks[number], found, strict=True))
                done = len(self.known)
                if self.progress is not None and self.progress(done, max(self.expected, done)) is False:
                    raise Cancelled("yield: cancelled")
                if time.monotonic() - saved > _SAVE_SECONDS:
                    self.save()
                    saved = time.monotonic()
        finally:
            self.save()
        return np.stack([self.known[job] for job in jobs])

    def save(self) -> None:
        """Write all that is known."""
        if self.file is None or not self.known:
            return
        jobs = json.dumps([[number, scales] for number, scales in self.known])
        with replacing(self.file) as temporary, temporary.open("wb") as stream:
            values = np.stack(list(self.known.values()))
            np.savez(stream, key=study_key(self.study.recipe), jobs=jobs, values=values)

    def _read(self, file: Path) -> dict[Job, Float[np.ndarray, "m 2"]]:
        """Parts that an earlier run of the same study has measured; none where it was another study."""
        try:
            with np.load(file, allow_pickle=False) as content:
                if str(content["key"]) != study_key(self.study.recipe):
                    return {}
                jobs, values = json.loads(str(content["jobs"])), content["values"]
                found = [(number, tuple((name, scale) for name, scale in scales)) for number, scales in jobs]
                return dict(zip(found, values, strict=True))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{file}: cannot be read ({error}); delete it to begin again") from None


def scaled(names: Iterable[str], factor: float) -> Mapping[str, float]:
    """The same scale for all of ``names``."""
    return dict.fromkeys(names, factor)
