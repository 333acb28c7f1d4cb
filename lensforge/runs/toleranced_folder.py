"""Studies of tolerances in a result folder: each writes its files there."""

from collections.abc import Callable
from pathlib import Path

from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.results.folder_lock import in_locked_folder
from lensforge.results.ownership import require_own
from lensforge.runs import tolerance_stages
from lensforge.runs.results import stem_of
from lensforge.runs.run_folder import open_run, write_result
from lensforge.scene.lens import load_lens
from lensforge.spec.tolerances_section import TolerancesSection
from lensforge.surfaces.imported_face import LENS_FILE

YIELD_PARTS = "yield_parts.npz"  # parts that an interrupted study has measured


@in_locked_folder
def run_sensitivity(
    folder: Path, *, rays: int | None = None, progress: Callable[[int, int], object] | None = None
) -> Sensitivity:
    """Compute the effect of each tolerance, at its end, on the light."""
    lens = load_lens(folder / LENS_FILE)
    return write_result(tolerance_stages.sensitivity(lens, rays=rays, progress=progress), folder)


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
    """Draw parts from the tolerances, and write the record, the table of parts (CSV) and the page.

    Arguments are those of ``tolerance``. Measured parts are kept in the folder until the study is done: an interrupted
    one goes on where it was. With other ``tolerances`` than the spec's the files are ``yield_<name>.json`` and so on.
    """
    if tolerances is None:
        require_own(folder / f"{Yield.stage}.html")  # said before the study, not after it
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
    _write_page(result, folder)
    kept.unlink(missing_ok=True)
    return result


def _write_page(result: Yield, folder: Path) -> None:
    """Write the table of parts, and the page, beside the record."""
    from lensforge.report.page import write_page
    from lensforge.report.yield_page import render_yield

    stem = stem_of(result)
    result.save(folder / f"{stem}.csv")
    write_page(render_yield(result, open_run(folder), f"{stem}.csv"), folder / f"{stem}.html")
