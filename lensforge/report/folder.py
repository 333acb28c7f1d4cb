"""A result folder: read as one object, or worked in under its lock, where each file is read once.

``run.json`` is renewed with every result that is written, so that a kill takes none from what was written before it.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TypeVar

from lensforge.errors import InputError, refused
from lensforge.public import public
from lensforge.report.headline import further_facts, headline, required_facts
from lensforge.report.results import REPORT_FILE, Results, conditions_of, stem_of
from lensforge.report.stored import (
    RUN_FILE,
    RunRecord,
    Stored,
    require_none_lost,
    require_recorded,
    require_stated,
    unrecorded,
    verdicts_of_kinds,
)
from lensforge.results import StageResult
from lensforge.results.arguments import with_known_names
from lensforge.results.files import is_free_or_own, require_own, require_writable
from lensforge.results.folder_lock import locked
from lensforge.results.notebook_html import table_text
from lensforge.results.validation import its_type
from lensforge.results.verdict import Verdict
from lensforge.search.design_result import Design
from lensforge.surfaces.imported_face import LENS_FILE

_Result = TypeVar("_Result", bound=StageResult)


@public
@dataclass(frozen=True, eq=False)
class Run(Results):
    """All results in a folder.

    Fields:
        lens (Lens): The lens.
        found (mapping of str to StageResult): Results by the stem of their files.
        outdated (mapping of str): The reason for each stage whose files belong to another lens, part or version;
            such a stage counts as not run.
        others (mapping of str to SimulatedResult): Results under other conditions than the nominal, by the stem
            of their files; neither verdict nor any stage uses them.
        seconds (float or None, s): Of the whole command that has made them, where one has, up to its report.
        folder (Path): Result folder.
    """

    folder: Path = Path()

    @property
    def verdict(self) -> Verdict:
        """Verdict on light, files and cutting; of several kinds on the lenses in the folders beside it, too."""
        kinds = verdicts_of_kinds(self.folder, self.lens)
        return super().verdict.with_parts(kinds) if kinds else super().verdict

    def report(self, path: Path | str) -> Path:
        """Write the report as one page of HTML to ``path``, and return it.

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

    def __repr__(self) -> str:
        """Verdict and main facts, as the notebook has them."""
        facts = [*required_facts(self), *further_facts(self)]
        title = f"Run {self.spec.name} in {self.folder}: {headline(self).sentence}"
        return table_text(title, {fact.label: fact.sentence for fact in facts})

    def _repr_html_(self) -> str:
        """HTML for a notebook: verdict, headline numbers, the light and a section."""
        from lensforge.report.lens_page import results_html

        return results_html(self)


@public
@with_known_names
def load(folder: Path | str) -> Run:
    """Read a result folder: the object that :func:`run` returned.

    Args:
        folder: result folder.
    Returns: All results; a stage whose files belong to another lens, part or version counts as not run.
    Raises: :class:`InputError` for any other folder, and for a file of other content than the hashes say.
    Example:
        >>> run = lf.load("cad_out/quickstart")
        >>> print(run.verdict.light, run.missing)
    """
    return existing(folder).trusted()


def existing(folder: Path | str) -> "RunFolder":
    """The result folder ``folder``, to be read. Raises :class:`InputError` where there is none."""
    path = folder_of(folder)
    if not path.is_dir():
        raise InputError(f"{path}: no such folder; run `lensforge design` first")
    return RunFolder(path)


def folder_of(folder: object) -> Path:
    """``folder`` as a path. Raises :class:`InputError` where it cannot be a result folder."""
    if not isinstance(folder, Path | str):
        raise InputError(f"{str(folder)[:60]!r} is {its_type(folder)}; give the path of a result folder")
    path = Path(folder)
    # A name may be too long, or a folder one that the user may not search: what is in it can be asked for.
    with refused(str(path)[:60], "cannot be read (…); give a result folder", OSError):
        is_file = path.is_file()
        _ = (path / RUN_FILE).exists()
    if is_file:
        raise InputError(f"{path}: a file, must be a result folder, such as cad_out/NAME that `lensforge design` wrote")
    return path


@contextmanager
def opened(folder: Path, *, create: bool = False) -> "Iterator[RunFolder]":
    """A folder locked inside the block; ``create``: where it is missing. Raises :class:`InputError` if it is in use."""
    with locked(folder_of(folder), create=create):
        yield RunFolder(folder)


class RunFolder:
    """The result folder ``path`` in memory: each file is read once, when the first of them is asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._results: Results | None = None  # those that count, until the next is written

    @cached_property
    def _stored(self) -> Stored:
        return Stored.read(self.path)

    @cached_property
    def _record(self) -> RunRecord | InputError | None:
        try:
            return RunRecord.read(self.path)
        except InputError as error:
            return error

    @property
    def _known(self) -> RunRecord | None:
        return self._record if isinstance(self._record, RunRecord) else None

    @property
    def run(self) -> Run:
        """The run, complete or not; a record that :func:`load` would refuse counts as not run."""
        if self._results is None:
            hashes = None if self._known is None else self._known.hashes
            self._results = self._stored.results(partial(unrecorded, hashes))
        return self._run(self._results)

    def _run(self, results: Results) -> Run:
        given = results.lens, results.found, results.outdated, results.others
        return Run(*given, seconds=self._seconds, folder=self.path)

    def trusted(self) -> Run:
        """The run, as :func:`load` gives it. Raises :class:`InputError` for what the hashes do not cover."""
        self._stored.require_readable()
        results = self._stored.results()
        if isinstance(self._record, InputError):
            raise self._record
        require_recorded(results, self._record, self.path)
        run = self._run(results)
        require_stated(run, self._record, self.path)
        return run

    def to_show(self) -> Run:
        """The run for a page or for the shop: as :meth:`trusted`, and no result may have been lost unseen."""
        run = self.trusted()
        require_none_lost(run, self._known, self.path)
        return run

    def write(self, result: _Result) -> _Result:
        """Write ``result`` and renew the verdict; return the result. A design is written with its lens.

        Raises :class:`InputError` where the name of its conditions stands for others.
        """
        stem = stem_of(result)
        if isinstance(result, Design):
            self._write_lens(result)
        self._require_free(stem, result)
        result.write(self.path, stem)
        self._stored = self._stored.with_result(result)
        self._renew({**self._hashes(), stem: result.sha256}, None if stem == Design.stage else self._seconds)
        return result

    @property
    def _seconds(self) -> float | None:
        return None if self._known is None else self._known.seconds

    def _hashes(self) -> dict[str, str]:
        if self._known is not None:
            return self._known.hashes
        return {stem: result.sha256 for stem, result in self._stored.records.items()}

    def _write_lens(self, design: Design) -> None:
        design.lens.save(self.path / LENS_FILE)
        if "_stored" not in vars(self):  # what there is of an earlier run may still be of the same lens
            self._stored = Stored.read(self.path, design.lens)

    def _require_free(self, stem: str, result: StageResult) -> None:
        """Refuse to write over the record of other conditions that have the same name."""
        there = self._stored.records.get(stem)
        conditions = conditions_of(result)
        known = None if there is None else conditions_of(there)
        if there is None or known is None or conditions is None or known.same_as(conditions):
            return
        if there.inputs["lens"] == result.inputs["lens"]:
            raise InputError(
                f"{self.path / stem}.json: holds a result under other conditions of that name ({known}); "
                "give another --name, or delete it"
            )

    def renew(self, *, seconds: float | None = None) -> Run:
        """Write ``run.json`` on what there is, and return the run; ``seconds``: that a whole run has taken."""
        self._renew(self._hashes(), self._seconds if seconds is None else seconds)
        return self.run

    def _renew(self, hashes: Mapping[str, str], seconds: float | None) -> None:
        self._results = self._stored.results(partial(unrecorded, hashes))
        self._record = RunRecord.of(self._run(self._results), self._stored, hashes, seconds)
        self._record.write(self.path)

    def write_report(self, *, seconds: float | None = None) -> Path:
        """Write ``report.html`` on what counts, and return its path."""
        run = self.renew(seconds=seconds)  # before the page is written: it states the hash of every file
        return run.report(self.path / REPORT_FILE)

    def refresh_report(self) -> None:
        """Write the report again where there is one that this program wrote."""
        page = self.path / REPORT_FILE
        if page.exists() and is_free_or_own(page):
            self.write_report()
