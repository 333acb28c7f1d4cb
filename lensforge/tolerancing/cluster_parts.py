"""Parts measured by the workers of a cluster; what all parts share is made once in each of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from threading import Lock

import numpy as np
from jaxtyping import Float

from lensforge.tolerancing.kept_parts import Job
from lensforge.tolerancing.measured_parts import measured, prepare
from lensforge.tolerancing.part_study import PartStudy, Recipe
from lensforge.workers.cluster import Cluster

_MOST_STUDIES = 2  # in the memory of a worker: of the same lens with fewer rays, and the one at hand
_studies: list[PartStudy] = []
_lock = Lock()


@dataclass
class ClusterParts:
    """Workers of a cluster that measure parts."""

    cluster: Cluster

    def measure(
        self, study: PartStudy, chunks: Sequence[tuple[Job, ...]]
    ) -> Iterator[tuple[int, Float[np.ndarray, "j m 2"]]]:
        """Measure every chunk, each as one task."""
        return self.cluster.map(measured_chunk, study.recipe, chunks)


def measured_chunk(recipe: Recipe, chunk: tuple[Job, ...]) -> Float[np.ndarray, "j m 2"]:
    """Metrics of the parts of one task."""
    study = _study(recipe)
    return np.stack([measured(study, job) for job in chunk])


def _study(recipe: Recipe) -> PartStudy:
    """The study of ``recipe`` in this process."""
    with _lock:  # a worker may have several threads
        for study in _studies:
            if _words(study.recipe) == _words(recipe):
                return study
        made = PartStudy(recipe)
        for study in _studies:
            if _words(replace(study.recipe, rays=recipe.rays)) == _words(recipe):
                made = study.with_rays(recipe.rays)
        prepare(made)
        _studies[:] = [made, *_studies[: _MOST_STUDIES - 1]]
        return made


def _words(recipe: Recipe) -> tuple[object, ...]:
    return recipe.lens.sha256, recipe.parts, recipe.rays, recipe.seed, recipe.designed_rays
