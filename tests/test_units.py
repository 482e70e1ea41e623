"""Sentences keep their quantities, so that any reader gets them in the units of choice, rounded once."""

import pickle
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse import units
from crashfuse.condition import Condition
from crashfuse.units import KPH, KPH_KG, MPH

METRIC = units.KPH_KG


def test_a_sentence_is_a_string_in_mph_and_lb_and_said_in_other_units_rounded_once() -> None:
    """16 km/h stays 16.0 km/h; from the 9.9 mph that were shown it would be 15.9."""
    sentence = units.Sentence("{} is {} away, front {}.", "T1", units.speed(16 * KPH), units.weight(1000.0))
    assert sentence == "T1 is 9.9 mph away, front 2205 lb."
    assert sentence.in_units(METRIC) == "T1 is 16.0 km/h away, front 1000 kg."


def test_sentences_within_sentences_follow_and_travel_between_processes() -> None:
    """What is put together from sentences can still be said in other units, and pickled by workers and caches."""
    inner = units.Sentence("CAE runs: {}.", units.speed(5 * MPH, 62 * MPH))
    assert units.joined([inner, "No more."]).in_units(METRIC) == "CAE runs: 8.0–99.8 km/h. No more."
    assert str(units.joined([inner, "No more."])) == "CAE runs: 5.0–62.0 mph. No more."
    sentence = units.Sentence("{} away {sic}", units.speed(16 * KPH))
    copy = pickle.loads(pickle.dumps(sentence))  # noqa: S301
    assert (copy, copy.in_units(METRIC)) == (sentence, "16.0 km/h away {sic}")


@given(st.text(), st.text(), st.text())
def test_braces_of_others_are_themselves(before: str, word: str, after: str) -> None:
    """A label, a file's name or a cell may hold any text: in a value, and in what is around the places."""
    before, after = (text.replace("{}", "") for text in (before, after))
    sentence = units.Sentence(f"{before} {{}} {after} {{}}", word, units.speed(16 * KPH))
    assert sentence == f"{before} {word} {after} 9.9 mph"
    assert sentence.in_units(METRIC) == f"{before} {word} {after} 16.0 km/h"
    assert units.unpacked(units.packed(sentence)) == sentence


def test_names_are_listed_as_one_reads_them_out() -> None:
    assert [units.read_out("ABC"[:n]) for n in range(4)] == ["", "A", "A and B", "A, B and C"]


@pytest.mark.parametrize(
    ("quantity", "shown"),
    [
        (units.Quantity((1.0,), "g", ".2f"), "9.81 m/s²"),
        (units.Quantity((60.0,), "mph"), "96.6 km/h"),
        (units.Quantity((60.0, 70.5), "km/h", between=" to "), "60.0 to 70.5 km/h"),
        (units.Quantity((650.0,), "mm"), "650.0 mm"),
        (units.Quantity((None,), "g"), "–"),
        (units.Quantity((0.8,), "", ".3f"), "0.800"),
        (units.Quantity((-1.0,), "g", ".2f"), "−9.81 m/s²"),
    ],
)
def test_quantities_are_shown_in_the_readers_unit(quantity: units.Quantity, shown: str) -> None:
    assert units.said(quantity, units.UnitSystem("km/h", "kg", "m/s²")) == shown


def test_a_condition_is_said_in_one_system() -> None:
    condition = Condition.of_vector([56 * KPH, 950.0, 700.0])
    assert condition.in_units(units.MPH_LB) == "34.8 mph, front 2094 lb, rear 1543 lb"
    assert condition.in_units(METRIC) == "56.0 km/h, front 950 kg, rear 700 kg"


def test_no_line_ends_between_a_number_and_its_unit() -> None:
    text = "8 tests at 35.1 mph: 95 % within ± 1.9 g, ≤ 460 mm, 5 good ones, 9.8 m/s² in 60 ms"
    told = "8 tests at 35.1~mph: 95~% within ±~1.9~g, ≤~460~mm, 5 good ones, 9.8~m/s² in 60~ms"
    assert units.unbroken(text) == told.replace("~", "\N{NO-BREAK SPACE}")


@pytest.mark.parametrize("form", [".1f", "+.1f", ".3g", "#.4g"])
@given(value=st.floats(-1e3, 1e3))
def test_what_rounds_to_nothing_has_no_sign(form: str, value: float) -> None:
    text = units.number(value, form)
    assert not (float(text.replace("−", "-")) == 0 and text[0] in "+−-")
    assert "-" not in text


@given(value=st.floats(0, 1), base=st.floats(0, 1))
def test_a_difference_is_that_of_what_is_shown(value: float, base: float) -> None:
    """0.885 − 0.681 is +0.204, whatever was rounded away."""
    shown = Decimal(f"{value:.3f}") - Decimal(f"{base:.3f}")
    assert Decimal(units.difference(value, base, 3).replace("−", "-")) == shown


@given(probability=st.floats(0, 1), confidence=st.sampled_from([0.5, 0.8, 0.9, 0.95, 0.987, 0.99]))
def test_a_probability_is_rounded_but_not_over_what_it_is_compared_with(probability: float, confidence: float) -> None:
    text = units.probability_text(probability, confidence)
    if text in (">0.999", "<0.001"):
        assert not 0.001 <= probability <= 0.999
        return
    shown = float(text)
    assert abs(shown - probability) <= 0.0005 + 1e-12
    assert (shown >= confidence) is (probability >= confidence - 1e-12)
    assert (shown <= 1 - confidence + 1e-12) is (probability <= 1 - confidence + 1e-12)


def test_a_probability_has_as_few_digits_as_will_do() -> None:
    shown = [units.probability_text(p, 0.95) for p in (0.97777, 0.9499, 0.94996, 0.95, 0.0504, 0.05, 0.1 * 9.5, None)]
    assert shown == ["0.978", "0.9499", "0.94996", "0.950", "0.0504", "0.050", "0.950", "–"]


def test_a_difference_has_a_sign_unless_there_is_none() -> None:
    assert [units.signed(value, 3) for value in (0.0, 4e-4, -4e-4, 0.1, -0.1)] == ["0.000"] * 3 + ["+0.100", "−0.100"]
    assert f"{units.speed(0.0, form='+.1f')}, {units.speed(10 * MPH, form='+.1f')}" == "0.0 mph, +10.0 mph"


def test_sentences_of_values_are_in_the_readers_units_and_lack_what_is_not_known() -> None:
    """A name's ending is the unit; lists are read out, and braces in a value are somebody's words."""
    templates = ("{who} at {v_mps}: {share:.0%}, {n:,} of {a_g}.", "{none}", "{empty}", "{absent}", "Always.")
    values = {"who": ["A", "{B}"], "v_mps": 10 * MPH, "share": 0.5, "n": 1200, "a_g": 2.0, "none": None, "empty": []}
    sentence = units.statements(templates, values)
    assert sentence == "A and {B} at 10.0 mph: 50 %, 1,200 of 2.0 g. Always."
    assert sentence.in_units(KPH_KG) == "A and {B} at 16.1 km/h: 50 %, 1,200 of 2.0 g. Always."
    assert units.read_out([f"T{i}" for i in range(25)]).endswith("T19 and 5 more")
