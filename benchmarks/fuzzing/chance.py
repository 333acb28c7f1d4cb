"""Random choices of one case: from the kind's name and the seed, the same on any machine and any version of Python."""

import random
from collections.abc import Callable, Sequence
from typing import TypeVar

_Item = TypeVar("_Item")
_Content = TypeVar("_Content")


class Chance:
    """Choices made of ``random.random()`` alone, whose sequence Python keeps between its versions."""

    def __init__(self, kind: str, seed: int) -> None:
        self._next = random.Random(f"lensforge {kind} {seed}").random

    def below(self, count: int) -> int:
        """An integer from 0 to ``count`` - 1; 0 where ``count`` is 0."""
        return int(self._next() * count)

    def share(self, probability: float) -> bool:
        """True in this share of all calls."""
        return self._next() < probability

    def pick(self, items: Sequence[_Item]) -> _Item:
        """One of ``items``, all alike."""
        return items[self.below(len(items))]

    def bytes(self, count: int) -> bytes:
        """That many bytes of noise."""
        return bytes(self.below(256) for _ in range(count))

    def few(self, most: int = 5) -> int:
        """1 to ``most``; a small number more often than a large one."""
        return 1 + min(self.below(most), self.below(most))

    def apply(self, changes: "Sequence[Callable[[Chance, _Content], _Content]]", content: _Content) -> _Content:
        """``content`` after one of the ``changes``."""
        return self.pick(changes)(self, content)
