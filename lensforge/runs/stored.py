"""The records of a result folder: each file read once, and which of them count for its lens."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from lensforge.cad.part import Part
from lensforge.errors import InputError, OutdatedResult
from lensforge.report.results import OF_STEMS, Results, conditions_of, is_own, stem_of
from lensforge.results import SimulatedResult, StageResult
from lensforge.scene.lens import Lens, load_lens
from lensforge.search.checkpoint import CHECKPOINT, is_checkpoint
from lensforge.search.design_result import Design
from lensforge.surfaces.imported_face import LENS_FILE

_HOLD_LENS = (Design, Part)


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
        for stem, kind in _files_in(folder):
            try:
                records[stem] = kind.read(folder, stem, **({"lens": lens} if kind in _HOLD_LENS else {}))
            except InputError as error:
                unreadable[stem] = error
        return Stored(lens, records, unreadable)

    def with_result(self, result: StageResult) -> "Stored":
        """The same after ``result`` was written; a design brings another lens."""
        lens, stem = result.lens if isinstance(result, Design) else self.lens, stem_of(result)
        unreadable = {name: error for name, error in self.unreadable.items() if name != stem}
        return Stored(lens, {**self.records, stem: result}, unreadable)

    def require_readable(self) -> None:
        """Raise the error of the first damaged record; one of another version of the program only counts as not run."""
        for error in self.unreadable.values():
            if not isinstance(error, OutdatedResult):
                raise error

    def results(self, doubt: Callable[[str, StageResult], str] = lambda _stem, _result: "") -> Results:
        """The results that count: each is of this lens, and of a part and a light that count.

        ``doubt``: a further reason why a record, by its stem, does not count; empty where there is none.
        """
        found: dict[str, StageResult] = {}
        others: dict[str, SimulatedResult] = {}
        outdated = {stem: str(error) for stem, error in self.unreadable.items()}
        for stem in sorted(self.records, key=_place):
            result = self.records[stem]
            why = _mismatch(result, self.lens, found, outdated) or _foreign_conditions(result, stem)
            why = why or doubt(stem, result)
            if why:
                outdated[stem] = f"{why}; {type(result).again()}"
            elif is_own(stem):
                found[stem] = result
            elif isinstance(result, SimulatedResult):
                others[stem] = result
        return Results(self.lens, found, outdated, others)


def load_results(folder: Path) -> Results:
    """Read all results in ``folder``; only lens.json is required. Raises :class:`InputError` for a damaged file."""
    stored = Stored.read(Path(folder))
    stored.require_readable()
    return stored.results()


def _place(stem: str) -> tuple[bool, int, str]:
    """Place of a record among all: after those that it is made from; those under other conditions last."""
    own = is_own(stem)
    return not own, list(OF_STEMS).index(stem) if own else 0, stem


def _lens_in(folder: Path) -> Lens:
    path = folder / LENS_FILE
    if not path.exists() and is_checkpoint(folder / CHECKPOINT):
        raise InputError(f"{path}: no such file: the search was interrupted; design with --resume continues it")
    return load_lens(path)


def _files_in(folder: Path) -> Iterator[tuple[str, type[StageResult]]]:
    """Stem and class of each record in ``folder``: the lens's own first, then those under other conditions."""
    for stem, kind in OF_STEMS.items():
        if (folder / f"{stem}.json").exists():
            yield stem, kind
    for stem, kind in OF_STEMS.items():
        if issubclass(kind, SimulatedResult):
            for path in sorted(folder.glob(f"{stem}_*.json")):
                yield path.stem, kind


def _foreign_conditions(result: StageResult, stem: str) -> str:
    """The reason why ``result`` is not what its file's name says: the lens's own, of a surface, under conditions."""
    conditions = conditions_of(result)
    if is_own(stem) and conditions is not None:
        return f"it was made under other conditions than the lens's own ({conditions})"
    if not is_own(stem) and conditions is None:
        return "it was made under the lens's own conditions, so another file holds it"
    return "" if stem_of(result) == stem else f"it belongs into {stem_of(result)}.json"


def _mismatch(result: StageResult, lens: Lens, found: Mapping[str, StageResult], outdated: Mapping[str, str]) -> str:
    """The reason why ``result`` belongs to another lens, part or light; empty where it does not."""
    for name in result.made_from:
        if name in found and found[name].sha256 != result.inputs[name]:
            return f"it was made from another {name}"
        if name == "lens" and lens.sha256 != result.inputs[name]:
            return "it was made from another lens"
        if name in ("export", "evaluate") and name not in found:
            return f"the {name} that it was made from {'does not count' if name in outdated else 'is missing'}"
    return ""
