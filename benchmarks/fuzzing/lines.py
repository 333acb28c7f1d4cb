"""Text files of lines and numbers: IES, EULUMDAT, spectra, point clouds, and rays as text."""

import re
from collections.abc import Sequence

from fuzzing.chance import Chance
from fuzzing.extremes import WORDS
from fuzzing.noise import damaged

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|[-+]?\.\d+")
_WORD = re.compile(r"[^\s,;=]+")
_BLANKS = (" ", "\t", ",", ";", "  ", "\n", "\0", "\u00a0", "=")
_ENDS = ("\r\n", "\r", "\n\n", "\r\r\n", " \n", "\n\0", "\x0b", "\u2028")
_ENCODINGS = ("utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "utf-32", "cp1252", "cp500")
_MOST_REPEATS = 2000
_HEAD_LINES = 45  # in which counts and names stand


def changed_text(chance: Chance, samples: Sequence[bytes]) -> bytes:
    """One of the text files with a few numbers, words or lines changed; sometimes its encoding, sometimes its bytes."""
    content = chance.pick(samples)
    if chance.share(0.15):
        return damaged(chance, content, samples)
    text = content.decode("utf-8", "replace")
    for _ in range(chance.few()):
        text = chance.apply(_CHANGES, text)
    if chance.share(0.05):
        text = text.replace("\n", chance.pick(_ENDS))
    if chance.share(0.05):
        return text.encode(chance.pick(_ENCODINGS), "replace")
    return text.encode("utf-8", "replace")


def _number(chance: Chance, text: str) -> str:
    """Another number in place of one, mostly of the head of the file."""
    end = len(text) if chance.share(0.4) else _end_of_head(chance, text)
    found = _near(chance, _NUMBER, text, end)
    if found is None:
        return text
    return text[: found.start()] + _other_number(chance, found.group()) + text[found.end() :]


def _other_number(chance: Chance, word: str) -> str:
    kind = chance.below(6)
    if kind == 0 and word.lstrip("-+").isdigit():
        return str(int(word[:20]) + (1 if chance.share(0.5) else -1))
    if kind == 1:
        return f"-{word}"
    if kind == 2:
        return f"{word}e{chance.below(700) - 350}"
    if kind == 3:
        return f"{word}{chance.pick('0123456789')}"
    return chance.pick(WORDS)


def _word(chance: Chance, text: str) -> str:
    found = _near(chance, _WORD, text, len(text))
    return text if found is None else text[: found.start()] + chance.pick(WORDS) + text[found.end() :]


def _near(chance: Chance, pattern: re.Pattern[str], text: str, end: int) -> re.Match[str] | None:
    """A match at a place picked at random, not longer than a line away."""
    at = chance.below(end)
    return pattern.search(text, max(text.rfind("\n", 0, at), 0) if chance.share(0.3) else at)


def _end_of_head(chance: Chance, text: str) -> int:
    end = -1
    for _ in range(1 + chance.below(_HEAD_LINES)):
        following = text.find("\n", end + 1)
        if following < 0:
            break
        end = following
    return max(end, 1)


def _line(chance: Chance, text: str) -> str:
    """A line left out, doubled, moved, emptied, or cut in two."""
    lines = text.split("\n")
    at = chance.below(len(lines))
    kind = chance.below(6)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines[at:at] = [lines[at]] * (1 if chance.share(0.7) else chance.below(_MOST_REPEATS))
    elif kind == 2:
        lines.insert(chance.below(len(lines)), lines.pop(at))
    elif kind == 3:
        lines[at] = ""
    elif kind == 4:
        half = chance.below(len(lines[at]) + 1)
        lines[at : at + 1] = [lines[at][:half], lines[at][half:]]
    else:
        del lines[at:]
    return "\n".join(lines)


def _blank(chance: Chance, text: str) -> str:
    at = chance.below(len(text))
    return text[:at] + chance.pick(_BLANKS) + text[at + chance.below(2) :]


def _repeated(chance: Chance, text: str) -> str:
    """A word many times over, on one line."""
    found = _near(chance, _WORD, text, len(text))
    if found is None:
        return text
    return text[: found.end()] + f" {found.group()}" * chance.below(_MOST_REPEATS) + text[found.end() :]


_CHANGES = (_number, _number, _number, _number, _word, _line, _line, _blank, _repeated)
