"""Usable rays of a file: loaded, or left in it and read when they are needed."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int

from lensforge.sources.blocks import BLOCK_RAYS, block_slices
from lensforge.sources.rayfiles.binary import FileState
from lensforge.sources.rayfiles.rayfile import RayFile, UsableRays, as_usable, usable_rays, usable_rows

LOADED_RAYS = 2**20  # rays of a file that are loaded (60 MB); those of a larger one stay in it


@dataclass(frozen=True, eq=False)
class StoredRays:
    """Rays of ``rayfile`` that can be traced, in its order; ``skipped``: rows of the others, ``dropped``: by cause.

    ``state``: of a file whose numbers are mapped; None where they are copies.
    """

    rayfile: RayFile
    skipped: Int[np.ndarray, " k"]
    dropped: dict[str, int]
    state: FileState | None = None

    @staticmethod
    def of(rayfile: RayFile) -> "StoredRays":
        """Find the rays of a file that can be traced, block by block."""
        state = FileState.of(Path(rayfile.path)) if _is_mapped(rayfile) else None
        skipped, dropped, start = [np.zeros(0, dtype=np.int64)], dict[str, int](), 0
        for block in rayfile.blocks():
            keep, counts = usable_rows(block)
            skipped.append(start + np.flatnonzero(~keep))
            dropped = {cause: dropped.get(cause, 0) + count for cause, count in counts.items()}
            start += len(block)
        return StoredRays(rayfile, np.concatenate(skipped), dropped, state)

    def __len__(self) -> int:
        return len(self.rayfile) - len(self.skipped)

    def blocks(self) -> Iterator[UsableRays]:
        """Yield the rays block by block, in their order."""
        for some in block_slices(len(self)):
            yield self.take(some)

    def take(self, chosen: slice | Int[np.ndarray, " k"]) -> UsableRays:
        """Read some of the rays: from one to another without a step, or any by their numbers.

        Raises :class:`InputError` where the file was written to since it was opened.
        """
        if self.state is not None:
            self.state.require_same()
        if isinstance(chosen, slice):
            chosen = self._rows_between(*chosen.indices(len(self))[:2])
        else:
            chosen = self._rows_of(chosen)
        found = as_usable(self.rayfile.rows(chosen), {})
        if len(found) >= BLOCK_RAYS // 2:  # of so many nearly every page was read
            self.rayfile.release_pages()
        return found

    def _rows_between(self, start: int, stop: int) -> slice | Int[np.ndarray, " k"]:
        first, last = self._rows_of(np.array([start, stop - 1]))
        if last - first == stop - 1 - start:
            return slice(first, last + 1)
        return self._rows_of(np.arange(start, stop))

    def _rows_of(self, numbers: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        """Rows of the file in which the usable rays of these numbers are."""
        if len(self.skipped) == 0:
            return numbers
        before = self.skipped - np.arange(len(self.skipped))  # usable rays in front of each row that is skipped
        return numbers + np.searchsorted(before, numbers, side="right")


def _is_mapped(rayfile: RayFile) -> bool:
    return rayfile.verbatim is not None and np.may_share_memory(rayfile.verbatim, rayfile.directions)


def loaded_or_stored(rayfile: RayFile) -> UsableRays | StoredRays:
    """The usable rays of a file: in memory if they are few."""
    return usable_rays(rayfile) if len(rayfile) <= LOADED_RAYS else StoredRays.of(rayfile)
