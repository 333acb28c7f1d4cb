"""Studies of tolerances in a result folder: each writes its files there."""

from collections.abc import Callable
from pathlib import Path

from lensforge import tolerance_stages
from lensforge.folder_lock import in_locked_folder
from lensforge.given_faces.lens_face import LENS_FILE
from lensforge.lens import load_lens
from lensforge.run_folder import write_result
from lensforge.spec.tolerances import TolerancesSection
from lensforge.tolerancing.sensitivity_table import Sensitivity
from lensforge.tolerancing.yield_result import Yield

YIELD_PARTS = "yield_parts.npz"  # parts that an interrupted study has measured


@in_locked_folder
def run_sensitivity(folder: Path, *, rays: int | None = None) -> Sensitivity:
    """Compute the effect of manufacturing and alignment errors on the light."""
    return write_result(tolerance_stages.sensitivity(load_lens(folder / LENS_FILE), rays=rays), folder)


@in_locked_folder
def run_yield(
    folder: Path,
    *,
    parts: int = 1000,
    rays: int | None = None,
    seed: int = 0,
    tolerances: TolerancesSection | None = None,
    budget: bool = True,
    scheduler: str | None = None,
    progress: Callable[[int, int], object] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Yield:
    """Draw parts from the tolerances, and write the distribution of their light; arguments as of ``tolerance``.

    Measured parts are kept in the folder until the study is done: an interrupted one goes on where it was. Other
    ``tolerances`` than the spec's go to ``yield_<preset>.json``.
    """
    kept = folder / YIELD_PARTS
    found = tolerance_stages.tolerance(
        load_lens(folder / LENS_FILE),
        parts=parts,
        rays=rays,
        seed=seed,
        tolerances=tolerances,
        budget=budget,
        checkpoint=kept,
        scheduler=scheduler,
        progress=progress,
        announce=announce,
    )
    result = write_result(found, folder)
    kept.unlink(missing_ok=True)
    return result
