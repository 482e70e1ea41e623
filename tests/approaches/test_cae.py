"""The uncorrected CAE pulse as an approach."""

import numpy as np
import pytest

from crashfuse.approaches.cae import Cae
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.errors import NotFittedError


def test_it_gives_the_paired_run_and_says_so(campaign: Campaign) -> None:
    """The prediction is the CAE run made at the condition, without a band."""
    condition = campaign.tests[2].condition
    prediction = Cae().fit(campaign).predict(condition)
    run = campaign.cae.paired_run(condition)
    assert run is not None
    np.testing.assert_array_equal(prediction.accel_mps2, campaign.cae.accel_mps2[run])
    assert prediction.draws_mps2 is None
    assert f"CAE pulse: paired run {campaign.cae.ids[run]}." in prediction.notes


def test_it_emulates_elsewhere_and_flags_extrapolation(campaign: Campaign) -> None:
    """Any condition has a pulse; what lies outside the library is said."""
    prediction = Cae().fit(campaign).predict(Condition(20.0, 930.0, 690.0))
    assert prediction.notes[0] == "CAE pulse: from the emulator."
    assert prediction.notes[1].startswith("Extrapolation: speed")


def test_it_needs_no_test(campaign: Campaign) -> None:
    """CAE runs alone are enough, and tests change nothing."""
    condition = Condition(12.0, 930.0, 690.0)
    alone = Cae().fit(campaign.without(campaign.test_ids)).predict(condition)
    np.testing.assert_array_equal(alone.accel_mps2, Cae().fit(campaign).predict(condition).accel_mps2)


def test_it_must_be_fitted_first() -> None:
    """The error says what to do."""
    with pytest.raises(NotFittedError, match="fit"):
        Cae().predict(Condition(10.0, 900.0, 700.0))
