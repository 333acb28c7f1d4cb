"""``run.json``: the verdict on a result folder, and the hashes of the results that its commands have written.

A command vouches only for what it wrote itself: the hashes of all other results stay as they were recorded, so that a
file that somebody changed is not taken over with the next command.
"""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.proof.proof_result import JUDGED_FILES, Proof
from lensforge.results import Count, NotNegative, Record, Sha256, StageResult, Text
from lensforge.results.files import write_json
from lensforge.results.stage_result import SCHEMA_VERSION, read_object, require_checksum, validated, with_checksum
from lensforge.runs.results import Results, is_own, unjudged_files
from lensforge.runs.verdict import Verdict
from lensforge.search.design_result import Design
from lensforge.spec import Accuracy
from lensforge.version import __version__

RUN_FILE, RUN_SCHEMA = "run.json", f"lensforge-run-{SCHEMA_VERSION}"
_RENEW = "delete it, and run `lensforge report` again"


class RunRecord(Record):
    """``run.json``: the verdict, hashes of the results as their commands wrote them, the reasons for ``outdated``.

    ``others``: results under other conditions than the lens's own. ``seconds``: of the command that made a whole run,
    up to its report; None before, and where each stage had a command of its own.
    """

    version: Text = __version__
    name: Text
    accuracy: Accuracy
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


def read_record(folder: Path) -> RunRecord | None:
    """``run.json`` of ``folder``; None without one, as in version 0.1.0. Raises :class:`InputError` for any other."""
    path = folder / RUN_FILE
    if not (path.exists() or path.is_symlink()):
        return None
    content = read_object(path, RUN_SCHEMA, _RENEW)
    stated = {key: value for key, value in content.items() if key != "content_sha256"}
    record = validated(RunRecord, stated, path, _RENEW)
    require_checksum({"schema": RUN_SCHEMA, **content}, path, _RENEW)
    return record


def recorded_hashes(folder: Path) -> dict[str, str] | None:
    """Hashes by stem; None where ``run.json`` is missing or cannot be read."""
    record = _readable_record(folder)
    return None if record is None else record.hashes


def recorded_seconds(folder: Path) -> float | None:
    """Seconds of the command that made a whole run; None where ``run.json`` does not tell."""
    record = _readable_record(folder)
    return None if record is None else record.seconds


def _readable_record(folder: Path) -> RunRecord | None:
    try:
        return read_record(folder)
    except InputError:
        return None


def require_recorded(results: Results, folder: Path) -> None:
    """Raise :class:`InputError` where ``results`` are not those that ``run.json`` states.

    A file of the part that is not the one in export.json is refused with or without ``run.json``, unless it has been
    verified as it is.
    """
    part = results.find(Part)
    unjudged = () if part is None else unjudged_files(part, results.find(Proof))
    if unjudged:
        verify = ", or `lensforge verify` to have it judged as it is" if unjudged[0] in JUDGED_FILES else ""
        raise InputError(f"{folder / unjudged[0]}: not the file that export.json describes; {Part.again()}{verify}")
    record = read_record(folder)
    if record is None:
        return
    for stem, result in _all(results):
        why = _unrecorded(stem, result, record.hashes)
        if why and not _is_altered(result):
            raise InputError(f"{folder / stem}.json: {why}; {type(result).again()}")


def require_none_lost(results: Results, folder: Path) -> None:
    """Raise :class:`InputError` where a result that ``run.json`` states does not count any more.

    Every command renews ``run.json``, and with it the reasons for what is outdated: another reason comes from outside.
    """
    record = read_record(folder)
    if record is None or record.version != __version__:
        return
    for stem, why in results.outdated.items():
        if stem in record.hashes and stem not in record.outdated:
            raise InputError(f"{folder}: run.json states the result of {stem}, which does not count any more: {why}")


def _all(results: Results) -> Iterator[tuple[str, StageResult]]:
    yield from {**results.found, **results.others}.items()


def _unrecorded(stem: str, result: StageResult, hashes: Mapping[str, str]) -> str:
    """The reason why ``result`` is not as recorded; empty where it is."""
    if stem not in hashes:
        return "run.json does not state its hash: its command was interrupted, or the file is from elsewhere"
    if hashes[stem] != result.sha256:
        return "not the result whose hash run.json states: it was changed, or its command was interrupted"
    return ""


def _is_altered(result: StageResult) -> bool:
    """True for a part whose files have been changed: its hash is no longer the one recorded."""
    return isinstance(result, Part) and bool(result.altered)


def as_recorded(results: Results, hashes: Mapping[str, str] | None) -> Results:
    """``results`` without those that are not as recorded by ``hashes``, nor made from such; None: nothing is known.

    A part whose files were altered stays: casts of its files judge it, and until then its files fail.
    """
    if hashes is None:
        return results
    outdated = dict(results.outdated)
    for stem, result in _all(results):
        source = next((name for name in result.made_from if name in outdated and is_own(name)), "")
        why = "" if _is_altered(result) else _unrecorded(stem, result, hashes)
        if why or source:
            outdated[stem] = f"{why or f'the {source} that it was made from does not count'}; {type(result).again()}"
    found = {stem: result for stem, result in results.found.items() if stem not in outdated}
    others = {stem: result for stem, result in results.others.items() if stem not in outdated}
    return Results(results.lens, found, outdated, others)


def write_record(results: Results, folder: Path, written: Collection[str], seconds: float | None = None) -> Results:
    """Write ``run.json`` on ``results``, of which those in ``written`` are new; return those that count.

    ``seconds``: of the whole command; by default those that were recorded, until there is a new design.
    """
    known_seconds = None if Design.stage in written else recorded_seconds(folder)
    before, stems = recorded_hashes(folder), [stem for stem, _ in _all(results)]
    known = {stem: result.sha256 for stem, result in _all(results) if before is None or stem in written}
    hashes = {**(before or {}), **known}
    counted = as_recorded(results, hashes)
    kept = [stem for stem in (*stems, *results.outdated) if stem in hashes]
    record = RunRecord(
        name=results.spec.name,
        accuracy=results.lens.accuracy,
        seed=results.lens.seed,
        verdict=counted.verdict,
        results={stem: hashes[stem] for stem in kept if is_own(stem)},
        others={stem: hashes[stem] for stem in kept if not is_own(stem)},
        outdated=dict(counted.outdated),
        seconds=known_seconds if seconds is None else seconds,
    )
    write_json(folder / RUN_FILE, with_checksum({"schema": RUN_SCHEMA, **record.model_dump(mode="json")}))
    return counted
