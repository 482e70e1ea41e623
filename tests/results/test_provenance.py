"""The command in the report is one that the command line takes, and gives the same settings."""

import argparse
import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crashfuse.campaign import Campaign
from crashfuse.cli import parser
from crashfuse.condition import Condition
from crashfuse.results import provenance
from crashfuse.study.config import StudyConfig
from crashfuse.units import KPH, KPH_KG, LB, MPH, SYSTEMS


def parsed(command: str) -> argparse.Namespace:
    """What the command line makes of a command."""
    return parser().parse_args(shlex.split(command)[1:])


def test_the_command_of_a_study_is_parsed_back_to_its_settings(campaign: Campaign) -> None:
    approaches = "cae", "displacement_domain"
    config = StudyConfig(approaches=approaches, seed=3, windows_ms=(20.0, 55.5), leave_out="speed group")
    given = parsed(provenance.study_command(campaign, ["T2", "T4"], config))
    assert given.held_out == ["T2", "T4"]
    assert (tuple(given.approach), tuple(given.windows_ms)) == (config.approaches, config.windows_ms)
    assert (given.preset, given.seed, given.device, given.leave_out) == (["fast"], [3], "auto", "speed-group")
    unlike = replace(config, approaches=("cae", "fused"))
    assert "--preset" not in provenance.study_command(campaign, ["T2"], unlike)
    assert "preset" not in provenance.certification_settings(campaign, unlike, 0.95)
    assert "preset" not in json.dumps(provenance.provenance(campaign, ["T2"], unlike))


@pytest.mark.parametrize("units", SYSTEMS)
def test_the_command_of_a_prediction_is_parsed_back_to_its_condition(campaign: Campaign, units: str) -> None:
    """To ten digits, with its factors, in the units of the report."""
    condition = Condition.of_vector([33.3 * MPH, 2100.5 * LB, 1500 * LB], (("drive", "all wheels"), ("motor", "")))
    given = parsed(provenance.prediction_command(campaign, condition, StudyConfig(), SYSTEMS[units]))
    found = given.speed_mps, given.front_weight_kg, given.rear_weight_kg
    np.testing.assert_allclose(found, condition.vector, rtol=1e-9)
    assert (given.units, given.factor) == (units, ["drive=all wheels"])


_WORDS = st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]), min_size=1, max_size=30)


@given(
    factors=st.dictionaries(_WORDS.filter(lambda name: "=" not in name), _WORDS, min_size=1, max_size=3), word=_WORDS
)
def test_a_command_gives_back_whatever_words_are_in_it(campaign: Campaign, factors: dict[str, str], word: str) -> None:
    """Pasted into a shell, nothing that a table or a user says is run, split or lost."""
    condition = Condition.of_vector([15.0, 950.0, 700.0], tuple(factors.items()))
    given = parsed(provenance.prediction_command(campaign, condition, StudyConfig()))
    assert given.factor == [f"{name}={value}" for name, value in factors.items()]
    words = shlex.split(provenance.learning_curve_command(campaign, StudyConfig(), 3, word))
    assert words[words.index("--cost-per-test") + 1] == word


def test_commands_are_in_the_units_of_the_report(campaign: Campaign) -> None:
    """Round numbers stay round: 56 km/h is no 34.8 mph."""
    condition, higher = Condition.of_vector([56 * KPH, 950.0, 700.0]), Condition.of_vector([64 * KPH, 1000.0, 750.0])
    vehicle = " --front-weight-kg 950 --rear-weight-kg 700"
    assert f" --speed-kph 56{vehicle} " in provenance.prediction_command(campaign, condition, StudyConfig(), KPH_KG)
    speeds = np.array([condition.speed_mps, 16.0, higher.speed_mps])
    assert f" --speed-kph 56 64{vehicle} " in provenance.sweep_command(
        campaign, condition, speeds, StudyConfig(), KPH_KG
    )
    over = " --speed-kph 56 64 --front-weight-kg 950 1000 --rear-weight-kg 700 750 "
    assert over in provenance.next_test_command(condition, higher, StudyConfig(), KPH_KG)


def test_the_provenance_names_data_versions_and_settings(campaign: Campaign) -> None:
    """All that decides the numbers; whoever reads them should know what they were made without."""
    record = provenance.provenance(campaign, ["T2"], StudyConfig(seed=5))
    assert record["fingerprint"] == campaign.fingerprint
    assert record["seed"] == 5
    assert record["held_out"] == ["T2"]
    assert record["channel_filter_class"] is None
    assert (record["cae_sha256"], record["cae_about"]) == (campaign.cae.fingerprint, {})
    about = ((("about_solver", "A"), ("about_version", "1")),) * 23 + ((("about_solver", "B"),),)
    stated = provenance.provenance(replace(campaign, cae=replace(campaign.cae, about=about)), [], StudyConfig())
    assert stated["cae_about"] == {"Solver": "A (23), B (1)", "Version": "1 (23)"}
    assert {"numpy", "torch"} <= set(record["packages"])  # type: ignore[call-overload]
    fewer = replace(campaign.without(["T3"]), unused=(("T3", campaign.test("T3").condition),), warnings=("Noise.",))
    record = provenance.provenance(fewer, [], StudyConfig())
    unused = "Left out of use, neither learned from nor rated: T3 (no reason given)."
    assert record["warnings"] == [unused, "Noise."]
    assert record["fingerprint"] == campaign.without(["T3"]).fingerprint
