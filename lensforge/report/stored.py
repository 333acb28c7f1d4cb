"""The records of a result folder, which of them count for its lens, and ``run.json``: the verdict and their hashes.

A command vouches only for what it wrote itself: the hashes of all other results stay as they were recorded, so that a
file that somebody changed is not taken over with the next command.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from heapq import nsmallest
from pathlib import Path

from lensforge.cad.part import Part
from lensforge.errors import InputError, OutdatedResult
from lensforge.proof.proof_result import Proof
from lensforge.report.own_judgements import require_own_judgements
from lensforge.report.results import Results, conditions_of, own_stems, stem_of, unjudged_files
from lensforge.results import Count, NotNegative, Record, Sha256, SimulatedResult, StageResult, Text
from lensforge.results.files import write_json
from lensforge.results.stage_result import SCHEMA_VERSION, read_object, validated, with_checksum
from lensforge.results.verdict import Verdict
from lensforge.scene.lens import Lens, load_lens
from lensforge.search.checkpoint import CHECKPOINT, is_checkpoint
from lensforge.search.design_result import Design
from lensforge.spec import AnyAccuracy
from lensforge.surfaces.imported_face import LENS_FILE
from lensforge.version import __version__

_MOST_OTHERS = 1000  # records of one stage under other conditions


@dataclass(frozen=True)
class Stored:
    """Content of a result folder: its lens, every record that could be read, and why another could not, by stem."""

    lens: Lens
    records: dict[str, StageResult]
    unreadable: dict[str, InputError]

    @staticmethod
    def read(folder: Path, lens: Lens | None = None) -> "Stored":
        """Read each file of ``folder`` once; ``lens``: where it is known already. Raises :class:`InputError`."""
        lens = _lens_in(folder) if lens is None else lens
        records: dict[str, StageResult] = {}
        unreadable: dict[str, InputError] = {}
        for stem, kind in _files_in(folder, own_stems(lens.surfaces)):
            try:
                records[stem] = kind.read(folder, stem, **({"lens": lens} if "lens" in kind.model_fields else {}))
                require_own_judgements(records[stem], lens, folder / f"{stem}.json")
            except InputError as error:
                unreadable[stem] = error
        return Stored(lens, records, unreadable)

    def with_result(self, result: StageResult) -> "Stored":
        """Records of the folder after ``result`` was written; a design brings another lens."""
        lens = result.lens if isinstance(result, Design) else self.lens
        stem = stem_of(result)
        unreadable = {name: error for name, error in self.unreadable.items() if name != stem}
        return Stored(lens, {**self.records, stem: result}, unreadable)

    def require_readable(self) -> None:
        """Raise the error of the first damaged record; one of another version of the program only counts as not run."""
        for error in self.unreadable.values():
            if not isinstance(error, OutdatedResult):
                raise error

    def results(self, doubt: Callable[[str, StageResult], str] = lambda _stem, _result: "") -> Results:
        """The results of this lens, of a part and light that count; ``doubt``: a reason why one does not, or empty."""
        accepted: dict[str, StageResult] = {}
        others: dict[str, SimulatedResult] = {}
        outdated = {stem: str(error) for stem, error in self.unreadable.items()}
        stems = list(own_stems(self.lens.surfaces))  # each after those that it is made from
        for stem in sorted(self.records, key=lambda stem: (stems.index(stem) if stem in stems else len(stems), stem)):
            result = self.records[stem]
            is_own = stem in stems
            why = _mismatch(result, self.lens, accepted, outdated) or _foreign_conditions(result, stem, is_own)
            why = why or doubt(stem, result)
            if why:
                outdated[stem] = f"{why}; {type(result).rebuild_command()}"
            elif is_own:
                accepted[stem] = result
            elif isinstance(result, SimulatedResult):
                others[stem] = result
        return Results(self.lens, accepted, outdated, others)


def load_results(folder: Path) -> Results:
    """Read all results in ``folder``; only lens.json is required. Raises :class:`InputError` for a damaged file."""
    stored = Stored.read(Path(folder))
    stored.require_readable()
    return stored.results()


def load_kinds(folder: Path) -> list[Results]:
    """Results of each kind of lens of the design in ``folder``, the first one's first; of all lamps of one, its own."""
    first = load_results(folder)
    return [first, *(load_results(Path(folder) / lens.kind) for lens in first.lens.kinds[1:])]


def _lens_in(folder: Path) -> Lens:
    path = folder / LENS_FILE
    if not path.exists() and is_checkpoint(folder / CHECKPOINT):
        raise InputError(f"{path}: no such file: the search was interrupted; design with --resume continues it")
    return load_lens(path)


def _files_in(folder: Path, kind_by_stem: Mapping[str, type[StageResult]]) -> Iterator[tuple[str, type[StageResult]]]:
    """Stem and class of each record in ``folder``: the lens's own first, then those under other conditions."""
    for stem, kind in kind_by_stem.items():
        if (folder / f"{stem}.json").exists():
            yield stem, kind
    for stem, kind in kind_by_stem.items():
        if issubclass(kind, SimulatedResult):
            files = nsmallest(_MOST_OTHERS + 1, folder.glob(f"{stem}_*.json"))
            if len(files) > _MOST_OTHERS:
                raise InputError(f"{folder}: more than {_MOST_OTHERS} files {stem}_*.json are not read; move some away")
            yield from ((path.stem, kind) for path in files)


def _foreign_conditions(result: StageResult, stem: str, is_own: bool) -> str:
    """Reason why the file name does not fit its content: nominal, of a surface, or under conditions; "" if it does."""
    conditions = conditions_of(result)
    if is_own and conditions is not None:
        return f"it was made under other than nominal conditions ({conditions})"
    if not is_own and conditions is None:
        return "it was made under nominal conditions, so another file holds it"
    return "" if stem_of(result) == stem else f"it belongs into {stem_of(result)}.json"


def _mismatch(result: StageResult, lens: Lens, accepted: Mapping[str, StageResult], outdated: Mapping[str, str]) -> str:
    """The reason why ``result`` belongs to another lens, part or light; empty if it does not."""
    for name in result.made_from:
        if name in accepted and accepted[name].sha256 != result.inputs[name]:
            return f"it was made from another {name}"
        if name == "lens" and lens.sha256 != result.inputs[name]:
            return "it was made from another lens"
        if name in ("export", "evaluate") and name not in accepted:
            return f"the {name} that it was made from {'is out of date' if name in outdated else 'is missing'}"
    return ""


RUN_FILE = "run.json"
RUN_SCHEMA = f"lensforge-run-{SCHEMA_VERSION}"
_RENEW = "delete it, and run `lensforge report` again"


class RunRecord(Record):
    """``run.json``: the verdict, hashes of the results as their commands wrote them, the reasons for ``outdated``.

    ``others``: results under other than nominal conditions. ``seconds``: of the command that made a whole run,
    up to its report; None before, and where each stage had a command of its own.
    """

    version: Text = __version__
    name: Text
    accuracy: AnyAccuracy
    seed: Count
    verdict: Verdict
    results: dict[Text, Sha256]
    others: dict[Text, Sha256]
    outdated: dict[Text, Text]
    seconds: NotNegative | None = None

    @property
    def hashes(self) -> dict[str, str]:
        """Hash of every result, by the stem of its file."""
        return {**self.results, **self.others}

    @staticmethod
    def read(folder: Path) -> "RunRecord | None":
        """The record of ``folder``; None without one, as in version 0.1.0. Raises :class:`InputError` for any other."""
        path = folder / RUN_FILE
        if not (path.exists() or path.is_symlink()):
            return None
        return validated(RunRecord, read_object(path, RUN_SCHEMA, _RENEW), path, _RENEW)

    @staticmethod
    def of(results: Results, stored: Stored, hashes: Mapping[str, str], seconds: float | None) -> "RunRecord":
        """The record of ``results``, those of ``stored`` that count; ``hashes`` may be of files that are gone.

        ``seconds`` less than one stage took are not those of a whole run: it was resumed, or the stage ran again.
        """
        kept = [stem for stem in (*stored.records, *stored.unreadable) if stem in hashes]
        own_kinds = own_stems(stored.lens.surfaces)
        return RunRecord(
            name=results.spec.name,
            accuracy=results.lens.accuracy,
            seed=results.lens.seed,
            verdict=results.verdict,
            results={stem: hashes[stem] for stem in kept if stem in own_kinds},
            others={stem: hashes[stem] for stem in kept if stem not in own_kinds},
            outdated=dict(results.outdated),
            seconds=None if seconds is None or seconds < _longest_s(results) else seconds,
        )

    def write(self, folder: Path) -> None:
        """Write ``run.json``."""
        write_json(folder / RUN_FILE, with_checksum({"schema": RUN_SCHEMA, **self.model_dump(mode="json")}))


def verdicts_of_kinds(folder: Path, lens: Lens) -> dict[str, Verdict]:
    """Verdicts on the lenses of further kinds, each in a folder of its own; none where ``lens`` is not the first.

    A folder that is missing, or of another lens, leaves files and cutting of its kind undecided.
    """
    verdicts = dict[str, Verdict]()
    for kind in lens.kinds[1:] if lens.kind == lens.kinds[0].kind else ():
        why = f"the folder {kind.kind} has no part of this lens; run `lensforge design` again, or with --resume"
        verdicts[kind.kind] = Verdict.of([], [("undecided", why)], [("undecided", why)])
        with suppress(InputError):
            record = RunRecord.read(folder / kind.kind)
            if record is not None and load_lens(folder / kind.kind / LENS_FILE) == kind:
                verdicts[kind.kind] = record.verdict
    return verdicts


def unrecorded(hashes: Mapping[str, str] | None, stem: str, result: StageResult) -> str:
    """The reason why ``result`` is not that of the recorded ``hashes``; empty if it is. None: nothing is recorded.

    A part whose files were altered stays: casts of its files judge it, and until then its files fail.
    """
    if hashes is None or (isinstance(result, Part) and result.altered):
        return ""
    if stem not in hashes:
        return "run.json does not state its hash: its command was interrupted, or the file is from elsewhere"
    if hashes[stem] != result.sha256:
        return "not the result whose hash run.json states: it was changed, or its command was interrupted"
    return ""


def require_recorded(results: Results, record: RunRecord | None, folder: Path) -> None:
    """Raise :class:`InputError` where ``results`` are not those that the ``record`` of ``folder`` states.

    Other files than export.json's are refused even without ``run.json``, unless verified as they are.
    """
    part = results.find(Part)
    unjudged = () if part is None else unjudged_files(part, results.find(Proof))
    if unjudged:
        verify = ", or `lensforge verify` to have it judged as it is"
        raise InputError(
            f"{folder / unjudged[0]}: not the file that export.json describes; {Part.rebuild_command()}{verify}"
        )
    if record is None:
        return
    for stem, result in {**results.found, **results.others}.items():
        if why := unrecorded(record.hashes, stem, result):
            raise InputError(f"{folder / stem}.json: {why}; {type(result).rebuild_command()}")


def require_stated(results: Results, record: RunRecord | None, folder: Path) -> None:
    """Raise :class:`InputError` where the ``record`` of ``folder`` contradicts its lens and ``results``.

    Its checksum may have been made anew. A verdict is compared where all of its results are there. Where none of the
    results is of this lens, neither is the record, which then vouches for nothing.
    """
    if record is None or record.version != __version__ or not results.found:
        return
    lens = results.lens
    path = folder / RUN_FILE
    for name, stated, there in (
        ("name", record.name, results.spec.name),
        ("seed", record.seed, lens.seed),
        ("accuracy", record.accuracy, lens.accuracy),
    ):
        if stated != there:
            raise InputError(f"{path}: {name} = {stated!r:.80}, {LENS_FILE} has {there!r:.80}; {_RENEW}")
    longest = _longest_s(results)
    if record.seconds is not None and record.seconds < longest:
        raise InputError(f"{path}: seconds = {record.seconds:g}, one of its stages took {longest:g} s; {_RENEW}")
    whole = set(record.hashes) == set(results.found) | set(results.others)
    if whole and len(lens.kinds) == 1 and record.verdict.states != results.verdict.states:  # words may change
        raise InputError(f"{path}: its verdict is not that of the results beside it; {_RENEW}")


def _longest_s(results: Results) -> float:
    """Seconds of the longest stage: a command that made all of them took no less."""
    return max((float(getattr(result, "seconds", 0.0)) for result in results.found.values()), default=0.0)


def require_none_lost(results: Results, record: RunRecord | None, folder: Path) -> None:
    """Raise :class:`InputError` where a result that ``run.json`` states is out of date.

    Every command renews ``run.json``, and with it the reasons for what is outdated: another reason comes from outside.
    """
    if record is None or record.version != __version__:
        return
    for stem, why in results.outdated.items():
        if stem in record.hashes and stem not in record.outdated:
            raise InputError(f"{folder}: run.json states the result of {stem}, which is out of date and ignored: {why}")
