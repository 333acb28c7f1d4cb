"""Outcomes of mutants, kept in a file after each of them, and what is counted from them."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from .draw import Mutant

EQUIVALENT = Path(__file__).with_name("equivalent.json")


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant: ``first`` when it was drawn, ``now`` when it was last tried."""

    key: str
    place: str
    old: str
    new: str
    first: str
    now: str
    seconds: float

    @property
    def package(self) -> str:
        return self.key.partition("/")[0]


@dataclass
class Record:
    """The file of a run: one seed, the outcomes in the order of the draw, and how long tests take without a bug."""

    path: Path
    seed: int = 0
    possible: dict[str, int] = field(default_factory=dict)  # mutants of each module
    without_bug: dict[str, float] = field(default_factory=dict)  # seconds of processor time
    outcomes: dict[str, Outcome] = field(default_factory=dict)

    @classmethod
    def load(cls, path: Path, seed: int) -> "Record":
        record = cls(path, seed)
        if path.exists():
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["seed"] != seed:
                raise SystemExit(f"{path} has the seed {content['seed']}: another file, --out, for the seed {seed}")
            record.possible, record.without_bug = content["possible"], content["without_bug"]
            record.outcomes = {each["key"]: Outcome(**each) for each in content["outcomes"]}
        return record

    def save(self) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        content = {
            "seed": self.seed,
            "possible": self.possible,
            "without_bug": self.without_bug,
            "outcomes": [asdict(outcome) for outcome in self.outcomes.values()],
        }
        new = self.path.with_suffix(".new")
        new.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        new.replace(self.path)


def equivalent() -> dict[str, str]:
    """Reason why a mutant is no bug, by its key."""
    reasons: dict[str, str] = json.loads(EQUIVALENT.read_text(encoding="utf-8"))
    return reasons


def table(record: Record) -> str:
    """The outcomes by package, in Markdown: the share caught of those that are bugs, and its confidence interval."""
    reasons = equivalent()
    rows = ["| package | possible | drawn | no bug | caught at first | caught now | left |", "|---" * 7 + "|"]
    for package in [*dict.fromkeys(each.package for each in record.outcomes.values()), ""]:
        drawn = [each for each in record.outcomes.values() if each.package == package or not package]
        bugs = [each for each in drawn if each.key not in reasons]
        first, now = (sum(getattr(each, when) != "passed" for each in bugs) for when in ("first", "now"))
        possible = sum(n for module, n in record.possible.items() if module.startswith(package))
        cells = (possible, len(drawn), len(drawn) - len(bugs), share(first, len(bugs)), share(now, len(bugs)))
        rows.append(" | ".join([f"| {f'`{package}`' if package else 'all'}", *map(str, cells), f"{len(bugs) - now} |"]))
    return "\n".join(rows)


def share(caught: int, bugs: int) -> str:
    """Count, share in per cent, and its 95 % confidence interval by Wilson's score."""
    from lensforge.made.tolerance_result import PassRate  # not before the tests have run: they import a changed copy

    if not bugs:
        return "0"
    part = PassRate.of(caught, bugs)
    return f"{caught} ({100 * part.value:.0f} %, {100 * part.low:.0f} to {100 * part.high:.0f})"


def survivors(record: Record, mutants: dict[str, Mutant]) -> list[str]:
    """Each bug that no test noticed: file, line, old and new text."""
    left = [each for each in record.outcomes.values() if each.now == "passed" and each.key not in equivalent()]
    lines = {key: mutant.line for key, mutant in mutants.items()}
    return [f"lensforge/{each.place}:{lines.get(each.key, 0)}\n  - {each.old}\n  + {each.new}" for each in left]


def stale(places: Path) -> list[str]:
    """Keys of reasons whose line is in no module below ``places`` any more."""
    return [key for key in equivalent() if _line_of(key) not in _lines(places / key.partition(": ")[0])]


def _line_of(key: str) -> str:
    return key.partition(": ")[2].rpartition(" @")[0]


def _lines(module: Path) -> set[str]:
    return {line.strip() for line in module.read_text(encoding="utf-8").splitlines()} if module.exists() else set()
