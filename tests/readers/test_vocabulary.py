"""Channel codes: what they say of a sensor in any spelling, and which sensors measure the vehicle's pulse."""

import pytest

from crashfuse.readers import vocabulary
from crashfuse.readers.vocabulary import ChannelCode, Doubt, doubt_in, doubt_of


def code(text: str) -> ChannelCode:
    found = ChannelCode.parsed(text)
    assert found is not None
    return found


@pytest.mark.parametrize("text", ["11VEHC0000__ACX_", "11VEHC0000??ACX?", "11vehc000000acx0", " 11VEHC000000ACX0 "])
def test_whatever_fills_a_code_it_is_the_same(text: str) -> None:
    assert code(text) == ChannelCode("11VEHC000000ACX0")


def test_other_names_are_no_codes() -> None:
    texts = ["", "Tunnel X", "10VEHC000000ACX", "10VEHC000000ACXDD", "X0VEHC000000ACXD", "Beschleunigung_g"]
    assert not any(map(ChannelCode.parsed, texts))


def test_dummies_are_told_from_vehicles() -> None:
    assert all(code(text).is_of_a_dummy for text in ("11HEADCG0000ACXP", "11LOAD0000H3ACXP"))
    assert not any(code(text).is_of_a_dummy for text in ("10SIMELE00INACXD", "11VEHC0000__ACX_"))  # a sill's inside


def test_filter_classes_are_low_passes() -> None:
    """CFC 60 passes 100 Hz (SAE J211-1), by the letters of the edition before, too; prefiltered only says nothing."""
    cutoffs = [1650, 1000, 300, 100, None, None]
    for letters in ("ABCDP_", "EFGHQV"):
        assert [code(f"10VEHC000000ACX{letter}").cutoff_hz for letter in letters] == cutoffs


@pytest.mark.parametrize("letters", ["0PAB", "PEFG", "DVLQ", "CDHY", "DSXK"])
def test_of_filters_the_least_is_taken_and_what_is_unknown_last(letters: str) -> None:
    """By RED B: V is film analysis, Q and L are below CFC 60; K and Y are no letters of it."""
    codes = {letter: code(f"10TUNN000000ACX{letter}") for letter in sorted(letters)}
    assert vocabulary.propose_by_code(codes)[0] == (letters[0],)
    assert {letter for letter in letters if codes[letter].status("")} == {*letters} & {*"VLQ"}


@pytest.mark.parametrize(
    ("codes", "chosen"),
    [
        (["10SEATLERE00ACXP", "10VEHCCG0000ACXP", "10SEATRIRE00ACXP"], [0, 2]),
        (["10FORALERE00AC1P", "10FORARIRE00AC1P", "10FORARIRE01AC1P"], [0, 1, 2]),  # redundant ones, too
        (["10SEATLERE00ACXD", "10SEATLERE00ACXP"], [1]),  # one sensor, filtered and not
        (["11SEATLERE00ACXP", "10TUNN000000ACXP"], [1]),  # an occupant's seat
        (["10SEATLEFR00ACXP", "10TUNN000000ACXP"], [1]),  # a front seat
        (["11VEHC0000__ACXD", "11VEHC0000__ACX_"], [1]),
        (["10TUNN000000ACXP", "10TUNN000000ACXP"], [0]),
        (["11SIMELEFR00ACXP", "11SIMELERE00ACXP"], [1]),  # a longitudinal beam: its front is in the crush
        (["10MSMELEFR00ACXP", "10BPILLE0000ACXP", "10SIMERI0000ACXP"], [1]),
        (["10SILBLEFR00ACXP", "10SILBLERE00ACXP", "10SILBRI0000ACXP"], [1, 2]),
        (["10SIMELEFR00ACXP"], []),
        (["10ENGN000000ACXP"], []),
        ([], []),
    ],
)
def test_the_best_placed_are_proposed(codes: list[str], chosen: list[int]) -> None:
    names = {f"{number}": code(text) for number, text in enumerate(codes)}
    found, why = vocabulary.propose_by_code(names)
    assert set(found) == {f"{number}" for number in chosen}
    assert ("choose one" in why) == (not chosen)
    assert code("10ENGN000000ACXP").rank == vocabulary.UNPLACED


STATUS = {
    Doubt.NONE: (
        *("", "ok", "O.K.", "as measured", "AM", "unknown", "NOVALUE", "in Ordnung", "not failed"),
        "sensor ok, checked 2024-03-01",
    ),
    Doubt.SOME: ("questionable data", "scaling factor changed", "system noise", "QD", "ok until 60 ms", "linear trend"),
    Doubt.FAILED: ("channel failed", "Channel_failed", "meaningless data", "no data", "not ok", "CF", "cable lost"),
}
SIMULATED = (
    *("simulation", "CAE", "FE model", "parameter", "predicted", "limit curve", "Simulated by LS-DYNA", "Berechnung"),
    *("PAM-CRASH", "modèle numérique", "synthetic", "Simulación", "FE", "FE 12", "Santa Fe, FE mesh", "仿真", "расчет"),
)
MEASURED = ("", "transducer", "hardware", "camera", "calculation", "simultaneous recorder", "femur gauge", "Santa Fe")


@pytest.mark.parametrize(("doubt", "status"), [(doubt, text) for doubt, texts in STATUS.items() for text in texts])
def test_the_words_on_quality_tell_sound_from_questionable_and_failed(doubt: Doubt, status: str) -> None:
    assert doubt_of(status) == doubt
    for between in (" ", "_", "-", "  "):
        assert doubt_of(status.upper().replace(" ", between)) == doubt_of(f" {status.lower()} ") == doubt


COMMENT = {
    Doubt.NONE: (
        *("", "LEFT REAR SILL X", "drift … within 2 %", "no data loss", "Dead pedal", "not damaged"),
        *("linearity error 0.5 %", "Vehicle X, no remarks"),
    ),
    Doubt.SOME: (
        *("SILL X - QUESTIONABLE DELTA-V", "signal saturated at 200 g", "Suspect after 40 ms", "clipped"),
        *("Signal gestört", "noisy", "out of range", "intermittent signal", "data error"),
    ),
    Doubt.FAILED: (
        *("SILL AX, CHANNEL FAILED AT 50 MS", "No valid data after 67ms", "signal lost", "Bad data", "Sensor defekt"),
        *("Kanal ausgefallen ab 40 ms", "INVALID", "do not use", "cable broken", "NO DATA - FAILED"),
        "sensor came loose",
    ),
}


@pytest.mark.parametrize(("doubt", "text"), [(doubt, text) for doubt, texts in COMMENT.items() for text in texts])
def test_the_words_of_a_comment_tell_what_speaks_against_a_channel(doubt: Doubt, text: str) -> None:
    assert doubt_in(text) == doubt_in(text.upper()) == doubt


@pytest.mark.parametrize("origin", [*SIMULATED, *MEASURED, "Civic FE"])
def test_the_words_on_the_source_tell_simulated_from_measured(origin: str) -> None:
    assert vocabulary.is_simulated(origin) == (origin in SIMULATED)
    assert vocabulary.mentions(origin, "computed") == (origin == "calculation")


OTHER = (
    *("VEHICLE INTO VEHICLE", "IMPACTOR INTO VEHICLE", "Car-to-car, 50 km/h", "Fahrzeug gegen Fahrzeug"),
    *("Small overlap frontal: driver side", "Moderate overlap", "Front impact, 40 % overlap", "ODB 64 km/h"),
    *("Euro NCAP MPDB", "Offset deformable barrier", "Frontal offset", "Side impact", "Far-side pole"),
    *("Rear end collision", "Oblique", "Whiplash sled", "Pfahlaufprall"),
)
FRONTAL = (
    *("OPTIONAL NEW CAR ASSESSMENT PROGRAM FRONTAL BARRIE", "VEHICLE INTO BARRIER", "Full-width rigid barrier"),
    *("Full overlap", "100 % overlap", "Frontal impact", "Offset removed before filtering"),
    "NCAP - 2018 TOYOTA CAMRY LE 4-DOOR SEDAN",
)


@pytest.mark.parametrize("text", [*OTHER, *FRONTAL])
def test_other_crashes_are_told_from_full_frontal_ones(text: str) -> None:
    assert vocabulary.other_setup(["", "Toyota Camry 2018", text]) == (text if text in OTHER else "")
