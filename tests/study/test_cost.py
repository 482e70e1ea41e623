"""The cost of a test is read as people write it, and nothing is guessed."""

import pytest

from crashfuse.errors import UsageError
from crashfuse.study.cost import Cost


@pytest.mark.parametrize(
    ("text", "amount", "currency"),
    [
        ("60000", 60000.0, ""),
        ("60,000 EUR", 60000.0, "EUR"),
        ("€ 60000", 60000.0, "€"),
        (" 1,250,000.50 USD ", 1250000.5, "USD"),
    ],
)
def test_a_cost_is_an_amount_with_or_without_a_currency(text: str, amount: float, currency: str) -> None:
    """As people write it."""
    assert Cost.of(text) == Cost(amount, currency)


@pytest.mark.parametrize("text", ["-5", "0", "", "many", "1e400", "60,00 EUR", "5 6", "nan", "inf"])
def test_what_is_no_cost_is_a_sentence(text: str) -> None:
    """Nothing is guessed."""
    with pytest.raises(UsageError, match="number above 0, with a currency or without"):
        Cost.of(text)


def test_a_multiple_is_rounded_to_two_digits() -> None:
    """With its currency; small amounts are not rounded away."""
    assert Cost(60000.0, "EUR").times(4 / 3) == "80,000 EUR"
    assert Cost(60000.0).times(0.0713) == "4,300"
    assert Cost(0.5).times(0.25) == "0.12"
