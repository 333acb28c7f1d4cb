"""Cases that have failed once, with their files, which stay the same when the mutators change."""

import base64
import json
import zlib
from dataclasses import dataclass
from pathlib import Path

from fuzzing.kind import Files
from fuzzing.kinds import kind_named

FILE = Path(__file__).with_name("kept_cases.json")


@dataclass(frozen=True)
class KeptCase:
    """A case by kind and seed, the failure that it ``was``, and its files."""

    kind: str
    seed: int
    was: str
    files: Files


def kept_cases() -> list[KeptCase]:
    """All kept cases."""
    if not FILE.exists():
        return []
    found = json.loads(FILE.read_text(encoding="utf-8"))
    return [KeptCase(each["kind"], each["seed"], each["was"], _unpacked(each["files"])) for each in found]


def keep(kind: str, seed: int, was: str) -> None:
    """Add the case to the file, in which each is once."""
    cases = {(each.kind, each.seed): each for each in kept_cases()}
    cases[kind, seed] = KeptCase(kind, seed, was, kind_named(kind).case(seed))
    rows = [
        {"kind": each.kind, "seed": each.seed, "was": each.was, "files": _packed(each.files)}
        for _, each in sorted(cases.items())
    ]
    FILE.write_text("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n", encoding="utf-8")


def _packed(files: Files) -> dict[str, str]:
    return {name: base64.b85encode(zlib.compress(content, 9)).decode() for name, content in files.items()}


def _unpacked(files: dict[str, str]) -> Files:
    return {name: zlib.decompress(base64.b85decode(content)) for name, content in files.items()}
