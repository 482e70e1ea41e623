"""What a file says of the source and the quality of a channel, in the spellings that occur."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.readers.credibility import Doubt, doubt_of, is_computed, is_simulated

STATUS = {
    Doubt.NONE: (
        "",
        "ok",
        "O.K.",
        "as measured",
        "AM",
        "unknown",
        "NOVALUE",
        "in Ordnung",
        "not failed",
        "sensor ok, checked 2024-03-01",
    ),
    Doubt.SOME: ("questionable data", "scaling factor changed", "system noise", "QD", "ok until 60 ms", "linear trend"),
    Doubt.FAILED: ("channel failed", "Channel_failed", "meaningless data", "no data", "not ok", "CF", "cable lost"),
}
SIMULATED = (
    "simulation",
    "CAE",
    "FE model",
    "parameter",
    "predicted",
    "limit curve",
    "Simulated by LS-DYNA",
    "Berechnung",
    "PAM-CRASH",
    "modèle numérique",
    "synthetic",
    "Simulación",
)
MEASURED = ("", "transducer", "hardware", "camera", "calculation", "simultaneous recorder", "femur gauge")


@pytest.mark.parametrize(("doubt", "status"), [(doubt, text) for doubt, texts in STATUS.items() for text in texts])
def test_the_words_on_quality_tell_sound_from_questionable_and_failed(doubt: Doubt, status: str) -> None:
    """Those of the standard, NHTSA's codes, and laboratories' own; what is not understood is questionable."""
    assert doubt_of(status) == doubt


@pytest.mark.parametrize("origin", [*SIMULATED, *MEASURED])
def test_the_words_on_the_source_tell_simulated_from_measured(origin: str) -> None:
    """What is calculated from measured channels is no simulation."""
    assert is_simulated(origin) == (origin in SIMULATED)
    assert is_computed(origin) == (origin == "calculation")


@given(st.sampled_from([text for texts in STATUS.values() for text in texts]), st.sampled_from([" ", "_", "-", "  "]))
def test_case_and_what_stands_between_words_do_not_matter(status: str, between: str) -> None:
    """As laboratories write it."""
    assert doubt_of(status.upper().replace(" ", between)) == doubt_of(status.lower()) == doubt_of(f" {status} ")
