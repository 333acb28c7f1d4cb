"""Numbers and texts at which readers fail: bounds of types, what overflows, what is no number, what is no text."""

import struct

INTEGERS = (
    0, 1, -1, 2, 3, 7, 127, 128, 255, 256, 1000, 65535, 65536, 2**24, 2**31 - 1, 2**31, -(2**31), 2**32 - 1, 2**32,
    2**53 + 1, 2**63 - 1, 2**63, -(2**63), 2**64 - 1, 10**18, -(10**18),
)  # fmt: skip
FLOATS = (
    0.0, -0.0, 1e-320, 5e-324, 2.2250738585072014e-308, 1e-160, 1e-45, 1e-30, 1e-9, 0.5, 1.0, -1.0, 1e9, 1e12, 1e18,
    1e30, 3.4028235e38, 1e39, 1e154, 1e160, 1e300, 1.7976931348623157e308, -1e300, -1e308, 360.0, 90.0, 180.0, -90.0,
)  # fmt: skip
NO_NUMBERS = (float("nan"), float("inf"), float("-inf"))

# As words of a text file; not all of them are numbers to every reader.
WORDS = (
    *map(str, INTEGERS), *(f"{value!r}" for value in FLOATS), "nan", "inf", "-inf", "NaN", "1e309", "-1e309", "1e400",
    "9" * 40, "1" * 5000, "1e99999999999", "0x10", "1_000", "1,5", "1.234,5", "1,234.5", "+-1", "1e", ".", "-", "--1",
    "1d5",
    "１２", "٣", "½", "", '""', "'", "#", ";", ",", "\t", "true", "null", "\0", "\x1a", "\x1b[31m", "é", "\ufeff",
)  # fmt: skip
TEXTS = (
    "", " ", "\0", "a\0b", "a\nb", "\r\n", "\x1b[2J", "\x7f", "\u202eabc", "\u2028", "\ufeff", "\ufffe", "𝄞", "é" * 300,
    "x" * 300, "y" * 100_000, "../../etc/passwd", "/dev/zero", "/", ".", "..", "~", "C:\\x", "a/b", "con", "-rf",
    "--help",
    "$x$", "$\\frac{", "\\", "%s", "{0}", "{{7*7}}", "<script>alert(1)</script>", "&amp;", "'\"><img src=x>", "]]>",
    "nan", "inf", "1e999", "-1", "none", "null", "lens.step", "lens.json", "__class__", "0" * 64, "f" * 64,
)  # fmt: skip
SURROGATE = "\\ud800"  # in JSON: half of a character, which no file can hold

_INTEGER_CODES = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "q": 64, "Q": 64}
_FLOAT_CODES = "fd"
NAN_SIGNALLING = b"\x01\x00\x80\x7f"  # a float32 whose bytes are also a small integer turned round


def packed(code: str, value: float, order: str = "<") -> bytes:
    """``value`` as a field of ``struct`` code ``code``, bent into its range."""
    if code in _INTEGER_CODES:
        bits = _INTEGER_CODES[code]
        return (int(value) % 2**bits).to_bytes(bits // 8, "little" if order == "<" else "big")
    if code in _FLOAT_CODES:
        try:
            return struct.pack(order + code, value)
        except OverflowError:
            return struct.pack(order + code, float("inf"))
    raise ValueError(f"{code}: no code of a number")
