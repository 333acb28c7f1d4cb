"""A result folder as one object, and ``run.json`` with its verdict."""

from dataclasses import dataclass
from pathlib import Path

from lensforge.errors import InputError
from lensforge.evaluation.light import Light
from lensforge.files import replacing, write_json
from lensforge.lens import Lens
from lensforge.records import Conditions, Count, Record, Sha256, Text
from lensforge.records.result import SCHEMA_VERSION
from lensforge.records.stored import read_object, validated
from lensforge.records.validation import its_type
from lensforge.results import Results, load_results
from lensforge.spec import Accuracy
from lensforge.verdict import Verdict
from lensforge.version import __version__

RUN_FILE, RUN_SCHEMA = "run.json", f"lensforge-run-{SCHEMA_VERSION}"
_RENEW = "run `lensforge report` again"


@dataclass(frozen=True, eq=False)
class Run(Results):
    """All results in ``folder``; ``others``: those under other conditions than the lens's own, by their file's stem."""

    folder: Path = Path()

    def report(self, path: Path | str) -> Path:
        """Write the report as one page of HTML to ``path``, and return it."""
        from lensforge.report.lens_page import render_report

        path = Path(path)
        page = render_report(self, self.folder)
        with replacing(path) as temporary:
            temporary.write_text(page, encoding="utf-8")
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
        from lensforge.report.notebook import results_html

        return results_html(self)


class RunRecord(Record):
    """``run.json``: the verdict, hashes of the results it rests on and of the ``others``, the reasons for ``outdated``.

    ``others``: results under other conditions than the lens's own.
    """

    version: Text = __version__
    name: Text
    accuracy: Accuracy
    seed: Count
    verdict: Verdict
    results: dict[Text, Sha256]
    others: dict[Text, Sha256]
    outdated: dict[Text, Text]


def load(folder: Path | str) -> Run:
    """Read a result folder: the object that :func:`run` returned. Raises :class:`InputError` for any other folder."""
    folder = folder_of(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; run `lensforge design` first")
    _require_verdict_file(folder / RUN_FILE)
    results = load_results(folder)
    return Run(results.lens, results.found, results.outdated, results.others, folder)


def open_run(folder: Path) -> Run:
    """The run in ``folder``, complete or not; a damaged record counts as not run; its stage writes it anew."""
    results = load_results(folder, damaged_too=True)
    return Run(results.lens, results.found, results.outdated, results.others, folder)


def _require_verdict_file(path: Path) -> None:
    """Raise :class:`InputError` for an invalid ``run.json``; a missing one is accepted."""
    if path.exists():
        validated(RunRecord, read_object(path, RUN_SCHEMA, _RENEW), path, _RENEW)


def folder_of(folder: object) -> Path:
    """``folder`` as a path. Raises :class:`InputError` where it cannot be a result folder."""
    if not isinstance(folder, Path | str):
        raise InputError(f"{str(folder)[:60]!r} is {its_type(folder)}; give the path of a result folder")
    path = Path(folder)
    if path.is_file():
        raise InputError(f"{path}: a file, must be a result folder")
    return path


def renew(folder: Path) -> Verdict:
    """Write ``run.json`` with the verdict on the results in ``folder``, and return it."""
    found = load_results(folder, damaged_too=True)
    record = RunRecord(
        name=found.spec.name,
        accuracy=found.lens.accuracy,
        seed=found.lens.seed,
        verdict=found.verdict,
        results={stem: result.sha256 for stem, result in found.found.items()},
        others={stem: result.sha256 for stem, result in found.others.items()},
        outdated=dict(found.outdated),
    )
    write_json(folder / RUN_FILE, {"schema": RUN_SCHEMA, **record.model_dump(mode="json")})
    return found.verdict


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
