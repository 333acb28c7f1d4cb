"""Fresh rays for every step of a search, drawn while the step before is under way."""

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor

from lensforge.sources.bundle import RayBundle, Source


def rays_ahead(source: Source, count: int, seeds: Iterable[int]) -> Iterator[RayBundle]:
    """A sample of ``count`` rays for each of ``seeds``, in their order; one more than is in use is kept in memory."""
    with ThreadPoolExecutor(1) as pool:
        following = None
        for seed in seeds:
            current, following = following, pool.submit(source.sample, count, seed)
            if current is not None:
                yield current.result()
        if following is not None:
            yield following.result()
