"""Outlines of plates in STEP files with changed text: each is read, or refused in one line by what reads it.

The reader is called here and not in a child process of its own, which takes a second to load the CAD kernel; whole
batches run in a process that may crash or hang, as the child may. LENSFORGE_FUZZ=10: ten times as many.
"""

import faulthandler
import json
import os
import random
import re
import resource
import signal
import traceback
from pathlib import Path
from typing import Any

import cadquery as cq
import pytest
from nightly import NIGHTLY, scaled
from refusals import one_line

import lensforge as lf
from lensforge.spec.plate_section import DrawnOutline
from lensforge.surfaces.plane_loop import DRAWING, FOUND, JOB
from lensforge.surfaces.step_outline import _write_loops

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")

_NUMBER = re.compile(rb"(?<![#\w.])-?\d+\.\d*(?:E[-+]?\d+)?")
_REFERENCE = re.compile(rb"#\d+(?!\s*=)")
_ENTITY = re.compile(rb"^#\d+ ?= ?[^;]*;\s*", re.MULTILINE)
_LIST = re.compile(rb"\((?:#\d+,?\s*)+\)")
_NUMBERS = (
    b"0.",
    b"-1.",
    b"1E-7",
    b"1E-3",
    b"1E5",
    b"1E99",
    b"-1E308",
    b"1E-320",
    b"NAN",
    b"3.14159265",
    b"1E",
    b"$",
    b"*",
)
_SECONDS, _BYTES = 10 if NIGHTLY else 1, 3 * 2**30  # of a case (most take a tenth of a second), of a batch


def drawings() -> dict[str, bytes]:
    """STEP files of an L with an arc, a round hole and a slot: as a body, its top face, and the wires around it."""
    flat = cq.Workplane().polyline([(-12, -10), (40, -10), (40, 8), (14, 8)])
    flat = flat.threePointArc((11.2, 9.2), (10, 12)).lineTo(10, 36).lineTo(-12, 36).close().extrude(-2.0)
    flat = flat.faces(">Z").workplane(origin=(0, 0, 0)).pushPoints([(34, 4)]).hole(4.0)
    flat = flat.faces(">Z").workplane(origin=(0, 0, 0)).pushPoints([(-2, 29)]).slot2D(8, 3, 30).cutThruAll()
    top = flat.faces(">Z").val()
    return {name: step(shape) for name, shape in {
        "body": flat.val(), "face": top, "wires": cq.Compound.makeCompound(top.Wires()),
        "circle": cq.Wire.makeCircle(9.0, cq.Vector(1.0, 2.0, 3.0), cq.Vector(0.0, 0.0, 1.0)),
    }.items()}  # fmt: skip


def step(shape: Any) -> bytes:
    from lensforge.results.files import file_bytes

    return file_bytes(DRAWING, lambda path: cq.exporters.export(cq.Workplane(obj=shape), str(path)))


def changed(content: bytes, chance: random.Random) -> bytes:
    """``content`` with one to four changes: of numbers, references, entities, lists of references, and bytes."""
    for _ in range(chance.randint(1, 4)):
        kind = chance.randrange(6)
        pattern = (_NUMBER, _REFERENCE, _REFERENCE, _ENTITY, _LIST, _NUMBER)[kind]
        matches = list(pattern.finditer(content, content.find(b"DATA;")))
        if not matches:
            continue
        match, donor = chance.choice(matches), chance.choice(matches)
        new = (
            chance.choice(_NUMBERS),
            donor[0],
            donor[0],
            chance.choice((b"", match[0] * 2)),
            chance.choice((b"()", donor[0], match[0][: match[0].find(b",")] + b")")),
            b"%.6f" % chance.gauss(0.0, 30.0),
        )[kind]
        content = content[: match.start()] + new + content[match.end() :]
    return content


def read(folder: Path, content: bytes) -> None:
    """Read the outline as the child does, and what it has found as its parent does."""
    (folder / DRAWING).write_bytes(content)
    try:
        _write_loops(folder)
        DrawnOutline(loops_mm=json.loads((folder / FOUND).read_text(encoding="utf-8")))
    except lf.InputError:
        one_line(pytest.ExceptionInfo.from_current())
    except Exception as error:
        if not type(error).__module__.startswith("OCP"):  # the child passes the CAD kernel's words on in one line
            raise


def batch(folder: Path, name: str, content: bytes, first: int, last: int) -> None:
    """Cases ``first`` to ``last`` in this process, which ends with them; the last one that has begun is noted."""
    faulthandler.disable()
    resource.setrlimit(resource.RLIMIT_DATA, (_BYTES, _BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    code = 1
    try:
        for number in range(first, last):
            (folder / "begun").write_text(str(number))
            signal.setitimer(signal.ITIMER_PROF, _SECONDS)  # which ends the process
            read(folder, changed(content, random.Random(f"{name} {number}")))
        code = 0
    except MemoryError:
        code = 2
    except BaseException:
        (folder / "failure").write_text(traceback.format_exc())
    os._exit(code)


@pytest.mark.parametrize("name", ["body", "face", "wires", "circle"])
def test_a_changed_outline_is_read_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    content, next_one, last = drawings()[name], 0, scaled(75, by_day=8)
    (tmp_path / JOB).write_text(json.dumps({"origin": "plate.step", "remedy": "export it again"}))
    read(tmp_path, content)
    assert json.loads((tmp_path / FOUND).read_text())
    while next_one < last:
        process = os.fork()
        if process == 0:
            batch(tmp_path, name, content, next_one, last)
        os.waitpid(process, 0)
        next_one = int((tmp_path / "begun").read_text()) + 1
        failure = tmp_path / "failure"
        assert not failure.exists(), (name, next_one - 1, failure.read_text())
