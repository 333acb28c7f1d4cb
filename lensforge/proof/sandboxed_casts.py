"""The casts through a part whose files come from outside, in a child process with limits of memory and time.

The CAD kernel reads and intersects the STEP file in C++, where a hostile file may end the process or let it grow; so
all of the work on the part is done in the child, and the parent reads nothing but the child's record. A cast by a child
gives the same bits; it takes some seconds more, to start Python and load libraries that the parent then need not load.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import TypeAdapter

from lensforge.optics.media import Media
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.results import BodySize, SimulatedResult
from lensforge.results.file_bounds import made_here
from lensforge.results.files import temporary_folder, write_json
from lensforge.results.sandbox import ChildLimits, serve, work_in_child
from lensforge.results.second_process import IN_TURN, SecondProcess
from lensforge.sources.ray_bundle import RayBundle

if TYPE_CHECKING:
    from lensforge.proof.receiver_screen import Screen

# A mesh of 115,200 triangles takes 0.6 GiB with the libraries, and so do hostile files of its size.
_MEMORY_MIB, _MEMORY_KIB_PER_TRIANGLE, _STL_RECORD = 1536, 4, 50
# Many times what is usual, since the machine may be slow and shared: 2**14 rays take 50 s where six others compute.
_SECONDS, _SECONDS_PER_RAY = 180.0, 0.01
_OF_EXPECTED = ("irradiance", "landings", "flux", "fates")  # arrays that go to the child
_RAYS, _OWN = "rays.", "own."  # beginnings of the names of their arrays
_JOB, _ARRAYS, _STL, _STEP = "job.json", "given.npz", "part.stl", "part.step"

_Result = TypeVar("_Result", bound=SimulatedResult)


def verify_in_sandbox(
    stl: bytes, *, rays: RayBundle, step: bytes, second: SecondProcess = IN_TURN, **given: Any
) -> Proof:
    """:func:`verify_part`, in a child process unless this process made the files; ``second`` has those alone."""
    if made_here(stl) and made_here(step):
        from lensforge.proof.verification import verify_part

        return verify_part(stl, rays=rays, step=step, second=second, **given)
    return _cast_in_child(Proof, stl, step, rays, given)


def stray_in_sandbox(stl: bytes, *, rays: RayBundle, **given: Any) -> StrayLight:
    """:func:`trace_stray`, in a child process unless this process made the file."""
    if made_here(stl):
        from lensforge.proof.stray_analysis import trace_stray

        return trace_stray(stl, rays=rays, **given)
    return _cast_in_child(StrayLight, stl, b"", rays, given)


def _arrays_of(prefix: str, rays: RayBundle) -> dict[str, Any]:
    return {f"{prefix}{name}": value for name, value in vars(rays).items() if value is not None}


def _cast_in_child(kind: type[_Result], stl: bytes, step: bytes, rays: RayBundle, given: dict[str, Any]) -> _Result:
    """Leave the work on the files in a folder to a child process, and read the record that it writes."""
    given |= {"media": asdict(given["media"])}
    numbers, arrays, count = dict(given), _arrays_of(_RAYS, rays), len(rays)
    if (own := numbers.pop("own", None)) is not None:
        arrays |= _arrays_of(_OWN, own.rays)
        numbers["own"], count = [asdict(design) for design in own.designs], count + len(own.rays)
    if (exported := numbers.pop("exported", None)) is not None:
        numbers["exported"] = exported.model_dump()
    screens: Sequence[Screen] = numbers.pop("screens", ())
    for k, expected in enumerate(numbers.pop("expected", ())):
        screens = (*screens, expected.screen)
        for name in _OF_EXPECTED:
            if (value := getattr(expected, name)) is not None:
                arrays[f"expected.{k}.{name}"] = value
    with temporary_folder(_STL) as folder:
        (folder / _STL).write_bytes(stl)
        (folder / _STEP).write_bytes(step)
        np.savez(folder / _ARRAYS, **arrays)
        job = {"stage": kind.stage, "given": numbers, "screens": [asdict(screen) for screen in screens]}
        write_json(folder / _JOB, job)
        memory_mib = _MEMORY_MIB + _MEMORY_KIB_PER_TRIANGLE * len(stl) // _STL_RECORD // 1024
        limits = ChildLimits(memory_mib, _SECONDS + _SECONDS_PER_RAY * count)
        words = "export it again, or cast fewer rays"
        work_in_child(Path(__file__).resolve(), folder, limits, origin="lens.stl and lens.step", remedy=words)
        return kind.read(folder)


def _cast(folder: Path) -> None:
    """Work of the child process: the record of the cast through the files in ``folder``."""
    from lensforge.proof.part_comparison import DesignLight, Expected, IndependentLight
    from lensforge.proof.receiver_screen import Screen
    from lensforge.proof.stray_analysis import trace_stray
    from lensforge.proof.verification import verify_part

    job = json.loads((folder / _JOB).read_text(encoding="utf-8"))
    with np.load(folder / _ARRAYS, allow_pickle=False) as archive:
        arrays = dict(archive)
    rays, given = _bundle_in(arrays, _RAYS), job["given"]
    given["media"] = TypeAdapter(Media).validate_python(given["media"])
    screens, stl = [Screen(**screen) for screen in job["screens"]], (folder / _STL).read_bytes()
    if job["stage"] == Proof.stage:
        expected = [
            Expected(screen, *(arrays.get(f"expected.{k}.{name}") for name in _OF_EXPECTED))  # type: ignore[arg-type]
            for k, screen in enumerate(screens)
        ]
        if "own" in given:
            given["own"] = IndependentLight(
                _bundle_in(arrays, _OWN), tuple(DesignLight(**each) for each in given["own"])
            )
        if "exported" in given:
            given["exported"] = BodySize.model_validate(given["exported"])
        step = (folder / _STEP).read_bytes()
        verify_part(stl, rays=rays, step=step, expected=expected, **given).write(folder)
    else:
        trace_stray(stl, rays=rays, screens=screens, **given).write(folder)


def _bundle_in(arrays: dict[str, Any], prefix: str) -> RayBundle:
    """The rays whose arrays have names with ``prefix``."""
    found = {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}
    return RayBundle(**found)


if __name__ == "__main__":
    serve(_cast)
