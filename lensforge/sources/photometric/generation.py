"""Generation of photometric data: measured, by whom, or computed, as LM-63-2019 codes it.

Section 5.13 and table 2 of ANSI/IES LM-63-19: a number 1.XXXXX in the place that LM-63-2002 keeps for later use. Its
digits say: accredited laboratory, interpolated angles, scaled lumens, computer simulation, undefined. A program shall
show the titles of that table and add nothing to them. The standard is not free: this is the table as three programs
have it that agree, eulumdat-rs among them; photompy 0.3.1 has the digits in another order.
"""

SIMULATED, UNDEFINED = "Computer Simulation", "Undefined"
_UNACCREDITED, _ACCREDITED = "Test at an unaccredited lab", "Test at an accredited lab"
_SCALED, _INTERPOLATED = " that has been lumen scaled", " with interpolated angle set"
_TITLES = {
    "1.00001": UNDEFINED,
    "1.00010": SIMULATED,
    "1.00000": _UNACCREDITED,
    "1.00100": _UNACCREDITED + _SCALED,
    "1.01000": _UNACCREDITED + _INTERPOLATED,
    "1.01100": _UNACCREDITED + _INTERPOLATED + _SCALED,
    "1.10000": _ACCREDITED,
    "1.10100": _ACCREDITED + _SCALED,
    "1.11000": _ACCREDITED + _INTERPOLATED,
    "1.11100": _ACCREDITED + _INTERPOLATED + _SCALED,
}
_CODES = {title: code for code, title in _TITLES.items()}


def generation_title(word: str) -> str:
    """Title of the number ``word`` of a file of 2019; undefined for what the table does not have.

    A bare 1 is undefined, too: older programs write it there, and mean nothing by it.
    """
    whole, _, digits = word.partition(".")
    if len(digits) < 5 and not digits.strip("0"):
        return UNDEFINED
    return _TITLES.get(f"{whole}.{digits.rstrip('0'):0<5}", UNDEFINED)


def generation_code(title: str) -> str:
    """Number by which a file of 2019 says how its data were generated."""
    return _CODES.get(title, _CODES[UNDEFINED])
