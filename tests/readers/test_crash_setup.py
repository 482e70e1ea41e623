"""The names of tests tell which are not full-frontal into a barrier."""

import pytest

from crashfuse.readers.crash_setup import other_setup


@pytest.mark.parametrize(
    "text",
    [
        "VEHICLE INTO VEHICLE",
        "IMPACTOR INTO VEHICLE",
        "Car-to-car, 50 km/h",
        "Fahrzeug gegen Fahrzeug",
        "Small overlap frontal: driver side",
        "Moderate overlap",
        "Front impact, 40 % overlap",
        "ODB 64 km/h",
        "Euro NCAP MPDB",
        "Offset deformable barrier",
        "Frontal offset",
        "Side impact",
        "Far-side pole",
        "Rear end collision",
        "Oblique",
        "Whiplash sled",
        "Pfahlaufprall",
    ],
)
def test_other_crashes_are_named(text: str) -> None:
    """As laboratories call them."""
    assert other_setup(["", "Toyota Camry 2018", text]) == text


@pytest.mark.parametrize(
    "text",
    [
        "OPTIONAL NEW CAR ASSESSMENT PROGRAM FRONTAL BARRIE",
        "VEHICLE INTO BARRIER",
        "Full-width rigid barrier, 56 km/h",
        "Full overlap",
        "100 % overlap",
        "Frontal impact",
        "Offset removed before filtering",
        "NCAP - 2018 TOYOTA CAMRY LE 4-DOOR SEDAN",
    ],
)
def test_full_frontal_crashes_are_not(text: str) -> None:
    """Nor is anything that says nothing of it."""
    assert other_setup([text]) == ""
