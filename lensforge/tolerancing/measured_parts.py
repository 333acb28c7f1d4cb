"""Parts measured as they are asked for, by the threads of this process or by other workers."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Float

from lensforge.errors import Cancelled
from lensforge.tolerancing.kept_parts import Job, KeptParts
from lensforge.tolerancing.part_study import PartStudy, Scales

_SAVE_SECONDS = 5.0
_CHUNK = 8  # parts of one task: a second of work, which a lost worker repeats

Progress = Callable[[int, int], object]  # parts measured, and of those that a stage asks for; False cancels


class Workers(Protocol):
    """Interface of threads or processes that measure parts."""

    def measure(
        self, study: PartStudy, chunks: Sequence[tuple[Job, ...]]
    ) -> Iterator[tuple[int, Float[np.ndarray, "j m 2"]]]:
        """Measure every chunk, in any order: its number, and the metrics of its parts."""
        ...


class Threads:
    """All cores of this process: as many parts at once as torch may use threads."""

    def measure(
        self, study: PartStudy, chunks: Sequence[tuple[Job, ...]]
    ) -> Iterator[tuple[int, Float[np.ndarray, "j m 2"]]]:
        """Measure every chunk in its turn."""
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


@dataclass
class MeasuredParts:
    """Metrics of the parts of ``study``; those that are not ``kept`` are measured by ``workers``."""

    study: PartStudy
    workers: Workers = field(default_factory=Threads)
    kept: KeptParts = field(default_factory=KeptParts)
    progress: Progress | None = None

    def with_rays(self, rays: int) -> "MeasuredParts":
        """The same parts by other ``rays`` each, kept beside those of these rays."""
        return self if rays == self.study.recipe.rays else replace(self, study=self.study.with_rays(rays))

    def of(self, parts: Iterable[int], scales: Scales | None = None) -> Float[np.ndarray, "n m 2"]:
        """Metrics of ``parts`` with some of their deviations scaled."""
        known, rays = self.kept.known, self.study.recipe.rays
        jobs = [job_of(number, scales or {}) for number in parts]
        missing = [job for job in jobs if (rays, job) not in known]
        chunks = [tuple(missing[first : first + _CHUNK]) for first in range(0, len(missing), _CHUNK)]
        saved, done = time.monotonic(), len(jobs) - len(missing)
        try:
            for number, found in self.workers.measure(self.study, chunks) if chunks else ():
                known.update(zip(((rays, job) for job in chunks[number]), found, strict=True))
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
