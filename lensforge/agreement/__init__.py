"""Agreement of a record with itself, with the lens that it belongs to, and with the results that it was made from.

A file can be edited. Nothing that follows from other numbers is taken from it: criteria and findings are derived again
from the record's values, the spec and the limits of this version, and figures from the arrays and files beside them.
"""

from lensforge.agreement.record import contradiction

__all__ = ["contradiction"]
