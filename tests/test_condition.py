"""A condition as text says what it says, to nine digits, and no other text is taken for one."""

import pytest

from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.units import KPH, LB, MPH


@pytest.mark.parametrize(
    ("condition", "text"),
    [
        (Condition(35 * MPH, 2100 * LB, 1500 * LB), "35mph 2100lb 1500lb"),
        (Condition(56 * KPH, 950.0, 1500 * LB), "56kph 950kg 1500lb"),
        (Condition(35.1 * MPH, 950.0, 690.5, (("drive", "2 wheels"),)), "35.1mph 950kg 690.5kg drive=2%20wheels"),
        (Condition(10 * MPH, 1.0, 1.0, (("a=b", "x=y"),)), "10mph 1kg 1kg a%3Db=x%3Dy"),
    ],
)
def test_each_quantity_is_in_the_unit_in_which_it_is_short(condition: Condition, text: str) -> None:
    """What was chosen as 56 km/h is 56 again; and the text gives the condition back."""
    assert condition.text == text
    again = Condition.parse(text)
    assert again.vector == pytest.approx(condition.vector, rel=1e-9)
    assert again.factors == condition.factors
    assert again.text == text


@pytest.mark.parametrize(
    "text",
    ["", "35", "35mph", "35mph 900kg", "35kg 900kg 800kg", "-35mph 900kg 800kg", "0mph 900kg 800kg", "nanmph 1kg 1kg",
     "1e999mph 900kg 800kg", "35mph 900kg 800kg drive", "35mph 900kg 800kg =x", f"{'9' * 400}mph 900kg 800kg"],
)  # fmt: skip
def test_what_is_no_condition_is_refused_in_a_sentence(text: str) -> None:
    """A link may hold anything."""
    with pytest.raises(UsageError, match="such as 35mph 2100lb 1500lb"):
        Condition.parse(text)
