"""``run.json``: the verdict on a result folder, and the hashes of the results that its commands have written.

A command vouches only for what it wrote itself: the hashes of all other results stay as they were recorded, so that a
file that somebody changed is not taken over with the next command.
"""

from collections.abc import Mapping
from pathlib import Path

from lensforge.cad.part import Part
from lensforge.errors import InputError
from lensforge.proof.proof_result import JUDGED_FILES, Proof
from lensforge.report.results import Results, is_own, unjudged_files
from lensforge.results import Count, NotNegative, Record, Sha256, StageResult, Text
from lensforge.results.files import write_json
from lensforge.results.stage_result import SCHEMA_VERSION, read_object, require_checksum, validated, with_checksum
from lensforge.results.verdict import Verdict
from lensforge.runs.stored import Stored
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

    @staticmethod
    def read(folder: Path) -> "RunRecord | None":
        """The record of ``folder``; None without one, as in version 0.1.0. Raises :class:`InputError` for any other."""
        path = folder / RUN_FILE
        if not (path.exists() or path.is_symlink()):
            return None
        content = read_object(path, RUN_SCHEMA, _RENEW)
        stated = {key: value for key, value in content.items() if key != "content_sha256"}
        record = validated(RunRecord, stated, path, _RENEW)
        require_checksum({"schema": RUN_SCHEMA, **content}, path, _RENEW)
        return record

    @staticmethod
    def of(results: Results, stored: Stored, hashes: Mapping[str, str], seconds: float | None) -> "RunRecord":
        """The record of ``results``, those of ``stored`` that count; ``hashes`` may be of files that are gone."""
        kept = [stem for stem in (*stored.records, *stored.unreadable) if stem in hashes]
        return RunRecord(
            name=results.spec.name,
            accuracy=results.lens.accuracy,
            seed=results.lens.seed,
            verdict=results.verdict,
            results={stem: hashes[stem] for stem in kept if is_own(stem)},
            others={stem: hashes[stem] for stem in kept if not is_own(stem)},
            outdated=dict(results.outdated),
            seconds=seconds,
        )

    def write(self, folder: Path) -> None:
        """Write ``run.json``."""
        write_json(folder / RUN_FILE, with_checksum({"schema": RUN_SCHEMA, **self.model_dump(mode="json")}))


def unrecorded(hashes: Mapping[str, str] | None, stem: str, result: StageResult) -> str:
    """The reason why ``result`` is not that of the recorded ``hashes``; empty where it is. None: nothing is recorded.

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

    A file of the part that is not the one in export.json is refused with or without ``run.json``, unless it has been
    verified as it is.
    """
    part = results.find(Part)
    unjudged = () if part is None else unjudged_files(part, results.find(Proof))
    if unjudged:
        verify = ", or `lensforge verify` to have it judged as it is" if unjudged[0] in JUDGED_FILES else ""
        raise InputError(f"{folder / unjudged[0]}: not the file that export.json describes; {Part.again()}{verify}")
    if record is None:
        return
    for stem, result in {**results.found, **results.others}.items():
        if why := unrecorded(record.hashes, stem, result):
            raise InputError(f"{folder / stem}.json: {why}; {type(result).again()}")


def require_none_lost(results: Results, record: RunRecord | None, folder: Path) -> None:
    """Raise :class:`InputError` where a result that ``run.json`` states does not count any more.

    Every command renews ``run.json``, and with it the reasons for what is outdated: another reason comes from outside.
    """
    if record is None or record.version != __version__:
        return
    for stem, why in results.outdated.items():
        if stem in record.hashes and stem not in record.outdated:
            raise InputError(f"{folder}: run.json states the result of {stem}, which does not count any more: {why}")
