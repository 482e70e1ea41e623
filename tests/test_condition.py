"""A condition as text and by quantities whose names end in their units says what it says, to nine digits."""

from typing import Any

import pytest

from crashfuse.condition import Condition
from crashfuse.errors import UsageError
from crashfuse.units import KPH, LB, MPH


@pytest.mark.parametrize(
    ("vector", "text"),
    [
        (([35 * MPH, 2100 * LB, 1500 * LB],), "35mph 2100lb 1500lb"),
        (([56 * KPH, 950.0, 1500 * LB],), "56kph 950kg 1500lb"),
        (([35.1 * MPH, 950.0, 690.5], (("drive", "2 wheels"),)), "35.1mph 950kg 690.5kg drive=2%20wheels"),
        (([10 * MPH, 1.0, 1.0], (("a=b", "x=y"),)), "10mph 1kg 1kg a%3Db=x%3Dy"),
    ],
)
def test_each_quantity_is_in_the_unit_in_which_it_is_short(vector: tuple[Any, ...], text: str) -> None:
    """What was chosen as 56 km/h is 56 again; and the text gives the condition back."""
    condition = Condition.of_vector(*vector)
    assert condition.text == text
    again = Condition.parse(text)
    assert again.vector == pytest.approx(condition.vector, rel=1e-9)
    assert again.factors == condition.factors
    assert again.text == text


SPEEDS = ("35kg", "-35mph", "0mph", "nanmph", "1e999mph", f"{'9' * 400}mph")
AXLES = ("", " 900kg", " 900kg 800kg drive", " 900kg 800kg =x")


@pytest.mark.parametrize(
    "text", ["", "35", *(f"{speed} 900kg 800kg" for speed in SPEEDS), *(f"35mph{axles}" for axles in AXLES)]
)
def test_what_is_no_condition_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(UsageError, match="such as 35mph 2100lb 1500lb"):
        Condition.parse(text)


def test_units_are_those_of_the_names() -> None:
    """35 mph are 15.6464 m/s and 56.32704 km/h; 2100 lb are 952.543977 kg, both exactly."""
    one = Condition.of(speed_mph=35, front_weight_lb=2100, rear_weight_kg=700, drive="FWD")
    assert one.vector.tolist() == pytest.approx([15.6464, 952.543977, 700.0], rel=1e-15)
    assert one.factors == (("drive", "FWD"),)
    other = Condition.of(speed_kph=56.32704, front_weight_kg=952.543977, rear_weight_kg=700, drive=None)
    assert other.factors == ()
    assert other.vector.tolist() == pytest.approx(one.vector.tolist(), rel=1e-15)
    assert Condition.of(speed_mps=15.6464, front_weight_kg=1, rear_weight_kg=1).speed_mps == 15.6464


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"speed_mph": 35, "front_weight_lb": 1}, "A condition needs a rear weight: rear_weight_lb or rear_weight_kg."),
        ({"speed_mph": 35, "speed_kph": 56}, "A condition has one speed; given are speed_mph and speed_kph."),
        (
            {"speed_knots": 30},
            "A condition needs a speed: speed_mph or speed_kph or speed_mps; speed_knots does not end in one of these "
            "units.",
        ),
        ({"speed_mph": "fast"}, "speed_mph is a number above 0, not 'fast'."),
        ({"speed_mph": -3}, "speed_mph is a number above 0, not -3."),
        ({"speed_mph": None}, "speed_mph is a number above 0, not None."),
        ({"speed_mph": float("nan")}, "speed_mph is a number above 0, not nan."),
    ],
)
def test_quantities_that_are_no_condition_are_a_sentence(given: dict[str, float | str | None], said: str) -> None:
    with pytest.raises(UsageError) as caught:
        Condition.of(**given)
    assert str(caught.value) == said
