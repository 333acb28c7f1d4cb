"""A result folder as one object, and ``run.json`` with its verdict."""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.results import Conditions, StageResult
from lensforge.results.files import require_writable
from lensforge.results.ownership import require_own
from lensforge.results.validation import its_type
from lensforge.runs.results import Results, load_results, stem_of
from lensforge.runs.run_record import (
    RUN_FILE,
    as_recorded,
    recorded_hashes,
    recorded_seconds,
    require_none_lost,
    require_recorded,
    write_record,
)
from lensforge.runs.verdict import Verdict
from lensforge.scene.lens import Lens

_Result = TypeVar("_Result", bound=StageResult)


@dataclass(frozen=True, eq=False)
class Run(Results):
    """All results in ``folder``; ``others``: those under other conditions than the lens's own, by their file's stem."""

    folder: Path = Path()

    def report(self, path: Path | str) -> Path:
        """Write the report as one page of HTML to ``path``, and return it; a PDF of an earlier page is deleted.

        Raises :class:`InputError` where ``path`` cannot be written, or holds a file that this program did not write.
        """
        from lensforge.report.lens_page import render_report
        from lensforge.report.page import write_page

        path = Path(path)
        require_own(path)
        require_writable(path)
        beside = path.resolve().parent == self.folder.resolve()
        write_page(render_report(self, self.folder, beside=beside), path)
        return path

    def row(self) -> dict[str, float | int | bool | str | None]:
        """Name, verdict and the metrics of all stages: one row for a table."""
        row: dict[str, float | int | bool | str | None] = {"name": self.spec.name, "seed": self.lens.seed}
        row |= {f"verdict.{key}": value for key, value in self.verdict.row().items()}
        for stem, result in self.found.items():
            row |= {f"{stem}.{key}": value for key, value in result.row().items()}
        return row

    def __eq__(self, other: object) -> bool:
        """True where folder, lens and all results are the same, bit for bit."""
        same_folder = isinstance(other, Run) and self.folder.resolve() == other.folder.resolve()
        return same_folder and super().__eq__(other)

    __hash__ = None

    def _repr_html_(self) -> str:
        """HTML for a notebook: verdict, headline numbers, the light and a section."""
        from lensforge.report.lens_page import results_html

        return results_html(self)


def load(folder: Path | str) -> Run:
    """Read a result folder: the object that :func:`run` returned.

    Raises :class:`InputError` for any other folder, and for a record or a file of other content than the hashes say.
    """
    folder = folder_of(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; run `lensforge design` first")
    results = load_results(folder)
    require_recorded(results, folder)
    return _run(results, folder)


def load_to_show(folder: Path) -> Run:
    """Read a result folder for a page or for the shop: as :func:`load`, and no result may have been lost unseen."""
    run = load(folder)
    require_none_lost(run, folder)
    return run


def open_run(folder: Path) -> Run:
    """The run in ``folder``, complete or not, for the command of a stage.

    A record that :func:`load` would refuse counts as not run; its stage writes it anew.
    """
    return _run(as_recorded(load_results(folder, damaged_too=True), recorded_hashes(folder)), folder)


def _run(results: Results, folder: Path) -> Run:
    return Run(
        results.lens, results.found, results.outdated, results.others, seconds=recorded_seconds(folder), folder=folder
    )


def folder_of(folder: object) -> Path:
    """``folder`` as a path. Raises :class:`InputError` where it cannot be a result folder."""
    if not isinstance(folder, Path | str):
        raise InputError(f"{str(folder)[:60]!r} is {its_type(folder)}; give the path of a result folder")
    path = Path(folder)
    try:
        is_file = path.is_file()
        _ = (path / RUN_FILE).exists()  # what is in it can be asked for
    except OSError as error:  # a name that is too long, a folder that the user may not search
        raise InputError(f"{str(path)[:60]}: cannot be read ({error.strerror}); give a result folder") from None
    if is_file:
        raise InputError(f"{path}: a file, must be a result folder")
    return path


def renew(folder: Path, *written: str, seconds: float | None = None) -> Verdict:
    """Write ``run.json`` with the verdict on the results in ``folder``, and return it.

    ``written``: stems of the results that the caller has just written, and vouches for. ``seconds``: that a whole run
    has taken.
    """
    return write_record(load_results(folder, damaged_too=True), folder, written, seconds).verdict


def write_result(result: _Result, folder: Path) -> _Result:
    """Write ``result`` into ``folder``, renew the verdict, and return the result."""
    stem = stem_of(result)
    result.write(folder, stem)
    renew(folder, stem)
    return result


def require_free(folder: Path, lens: Lens, conditions: Conditions) -> None:
    """Raise :class:`InputError` where the light of ``lens`` under other ``conditions`` has the same file."""
    stem = f"{Light.stage}_{conditions.name}"
    try:
        found = Light.read(folder, stem)
    except InputError:
        return  # there is none, or none that can be read
    there = found.conditions
    if there is not None and found.inputs["lens"] == lens.sha256 and not there.same_as(conditions):
        raise InputError(
            f"{folder / stem}.json: holds the light under other conditions of that name ({there}); give another --name,"
            " or delete it"
        )
