"""The command in the report is one that the command line takes, and gives the same settings."""

import shlex

from crashfuse.campaign import Campaign
from crashfuse.cli import parser
from crashfuse.condition import Condition
from crashfuse.reporting.provenance import prediction_command, provenance, study_command
from crashfuse.study.config import StudyConfig
from crashfuse.units import LB, MPH


def test_the_command_of_a_study_is_parsed_back_to_its_settings(campaign: Campaign) -> None:
    """Tests, approaches, preset, seed, windows and what is left out together."""
    config = StudyConfig(approaches=("cae", "fused"), seed=3, windows_ms=(20.0, 55.5), leave_out="speed group")
    command = study_command(campaign, ["T2", "T4"], config)
    parsed = parser().parse_args(shlex.split(command)[1:])
    assert parsed.held_out == ["T2", "T4"]
    assert tuple(parsed.approach) == config.approaches
    assert (parsed.preset, parsed.seed, parsed.device, parsed.leave_out) == (["fast"], [3], "auto", "speed-group")
    assert tuple(parsed.windows_ms) == config.windows_ms


def test_the_command_of_a_prediction_is_parsed_back_to_its_condition() -> None:
    """To ten digits, with its factors."""
    condition = Condition(33.3 * MPH, 2100.5 * LB, 1500 * LB, (("drive", "all wheels"), ("motor", "")))
    parsed = parser().parse_args(shlex.split(prediction_command(condition, StudyConfig()))[1:])
    assert (parsed.speed_mph, parsed.front_weight_lb, parsed.rear_weight_lb) == (33.3, 2100.5, 1500.0)
    assert parsed.factor == ["drive=all wheels"]


def test_the_provenance_names_data_versions_and_settings(campaign: Campaign) -> None:
    """All that decides the numbers."""
    record = provenance(campaign, ["T2"], StudyConfig(seed=5))
    assert record["fingerprint"] == campaign.fingerprint
    assert record["seed"] == 5
    assert record["held_out"] == ["T2"]
    assert record["channel_filter_class"] is None
    assert {"numpy", "torch"} <= set(record["packages"])  # type: ignore[call-overload]
