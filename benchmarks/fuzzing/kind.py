"""A kind of file that is fuzzed: how a case is made, and how lensforge reads it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fuzzing.chance import Chance

Files = dict[str, bytes]


@dataclass(frozen=True)
class Kind:
    """``make``: the files of a case by name, the changed one first; ``read``: all that lensforge does with them.

    ``original``: the unchanged files, which must be accepted. ``foreign``: the file is parsed by a library of others,
    which may crash or take all memory. ``share``: of the cases of its group, in relation to the other kinds.
    ``in_folder``: read beside the other files of a result folder.
    """

    name: str
    make: Callable[[Chance], Files]
    read: Callable[[Path], object]
    original: Callable[[], list[Files]]
    share: float = 1.0
    foreign: bool = False
    in_folder: bool = False

    def case(self, seed: int) -> Files:
        """The files of a case: the same for the same seed."""
        return self.make(Chance(self.name, seed))
