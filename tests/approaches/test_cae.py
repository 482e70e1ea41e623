"""The uncorrected CAE pulse as an approach."""

import numpy as np

from crashfuse.approaches.cae import Cae
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition


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
    prediction = Cae().fit(campaign).predict(Condition.of_vector([20.0, 930.0, 690.0]))
    assert prediction.notes[0] == "CAE pulse: from the emulator."
    assert prediction.notes[1].startswith("Extrapolation: speed")
