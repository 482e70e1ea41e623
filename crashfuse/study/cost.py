"""Cost of a test: an amount that the user enters."""

import math
import re
from dataclasses import dataclass
from typing import Self

from crashfuse.errors import UsageError

_NUMBER = r"\d{1,3}(?:,\d{3})+(?:\.\d+)?|\d+(?:\.\d+)?"
_AMOUNT = re.compile(rf"(?P<before>[^\d\s.,+-]*)\s*(?P<number>{_NUMBER})\s*(?P<after>[^\d.,+-]*)")


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one test: an amount, and its currency or an empty string."""

    amount: float
    currency: str = ""

    @classmethod
    def of(cls, text: str) -> Self:
        """Read an amount such as ``60000``, ``60,000 EUR`` or ``$60000``.

        Raises
        ------
        UsageError
            If it is no number above 0.
        """
        found = _AMOUNT.fullmatch(str(text).strip())
        amount = float(found["number"].replace(",", "")) if found else 0.0
        if found is None or not 0 < amount < math.inf:
            raise UsageError(
                f"The cost of a test is a number above 0, with a currency or without (60000, 60,000 EUR), not {text!r}."
            )
        return cls(amount, (found["before"] or found["after"]).strip())

    def times(self, factor: float) -> str:
        """A multiple of it, to two digits."""
        value = self.amount * factor
        digits = 1 - math.floor(math.log10(value))
        return f"{round(value, digits):,.0f} {self.currency}".rstrip() if value >= 10 else f"{value:.2g}"

    def __str__(self) -> str:
        return f"{self.amount:,.10g} {self.currency}".rstrip()
