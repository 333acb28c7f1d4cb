"""The casts through a part whose files come from outside, in a child process with limits of memory and time.

The CAD kernel reads and intersects the STEP file in C++, where a hostile file may end the process or let it grow; so
all of the work on the part is done in the child, and the parent reads nothing but the child's record. A cast by a child
gives the same bits; it takes some seconds more, to start Python and load libraries that the parent then need not load.
"""

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from lensforge.proof.proof_result import Proof, StrayLight
from lensforge.results import SimulatedResult
from lensforge.results.child_pool import IN_TURN, ChildPool
from lensforge.results.file_bounds import made_here
from lensforge.results.files import temporary_folder
from lensforge.results.sandbox import ChildLimits, serve, work_in_child
from lensforge.sources.ray_bundle import RayBundle

if TYPE_CHECKING:
    from lensforge.proof.verification import FilesOfPart, LightOfDesign, Referees

# A mesh of 115,200 triangles takes 0.6 GiB with the libraries, and so do hostile files of its size.
_MEMORY_MIB = 1536
_MEMORY_KIB_PER_TRIANGLE = 4
_STL_RECORD = 50
# Many times what is usual, since the machine may be slow and shared: 2**14 rays take 50 s where six others compute.
_SECONDS = 180.0
_SECONDS_PER_RAY = 0.01
_CALL = "call.pickle"  # of the parent to the child, never back

_Result = TypeVar("_Result", bound=SimulatedResult)


def verify_in_sandbox(
    files: "FilesOfPart", light: "LightOfDesign", referees: "Referees", threads: int, second: ChildPool = IN_TURN
) -> Proof:
    """:func:`verify_part`, in a child process unless this process made the files and may cast them with ``second``."""
    contents = [files.stl, *([] if files.step is None else [files.step]), *(file.content for file in files.designed)]
    if all(map(made_here, contents)):
        from lensforge.proof.verification import verify_part

        return verify_part(files, light, referees, threads=threads, second=second)
    count = len(light.rays) + (len(light.independent.rays) if light.independent else 0)
    return _cast_in_child(Proof, count, contents, files=files, light=light, referees=referees, threads=threads)


def stray_in_sandbox(stl: bytes, *, rays: RayBundle, **given: Any) -> StrayLight:
    """:func:`trace_stray`, in a child process unless this process made the file."""
    if made_here(stl):
        from lensforge.proof.nonsequential_trace import trace_stray

        return trace_stray(stl, rays=rays, **given)
    return _cast_in_child(StrayLight, len(rays), [stl], stl=stl, rays=rays, **given)


def _cast_in_child(kind: type[_Result], count: int, contents: Sequence[bytes], **arguments: Any) -> _Result:
    """Cast ``count`` rays through files in a child process, and read the record that it writes."""
    with temporary_folder("lens.stl") as folder:
        (folder / _CALL).write_bytes(pickle.dumps((kind.stage, arguments), protocol=pickle.HIGHEST_PROTOCOL))
        most_bytes = max(map(len, contents))
        memory_mib = _MEMORY_MIB + _MEMORY_KIB_PER_TRIANGLE * most_bytes // _STL_RECORD // 1024
        limits = ChildLimits(memory_mib, _SECONDS + _SECONDS_PER_RAY * count)
        remedy = "export it again, or cast fewer rays"
        work_in_child(Path(__file__).resolve(), folder, limits, origin="a file of the part", remedy=remedy)
        return kind.read(folder)


def _cast(folder: Path) -> None:
    """Work of the child process: make the cast requested in ``folder``, and write its record."""
    from lensforge.proof.nonsequential_trace import trace_stray
    from lensforge.proof.verification import verify_part

    stage, given = pickle.loads((folder / _CALL).read_bytes())
    result: Proof | StrayLight = verify_part(**given) if stage == Proof.stage else trace_stray(**given)
    result.write(folder)


if __name__ == "__main__":
    serve(_cast)
