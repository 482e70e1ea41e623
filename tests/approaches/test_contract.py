"""What every approach promises; each that is registered has to keep it."""

import json
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from crashfuse.approaches.base import Approach, FittedState, Prediction
from crashfuse.approaches.registry import APPROACHES, CLASSES, create
from crashfuse.approaches.settings import Settings
from crashfuse.campaign import CaeLibrary, Campaign
from crashfuse.errors import Cancelled, CrashfuseError, NotFittedError, UsageError
from crashfuse.execution.progress import Watch
from crashfuse.signals.pulse import GRID_S, Pulse

pytestmark = [pytest.mark.usefixtures("quick_networks"), pytest.mark.parametrize("name", APPROACHES)]

HELD_OUT = "T3"
Fits = Callable[[str], Approach]


@pytest.fixture(scope="module")
def fits(campaign: Campaign, quick_networks: None) -> Fits:  # noqa: ARG001
    """Each approach by its name, fitted once without the held-out test."""
    rest = campaign.without([HELD_OUT])
    return cache(lambda name: create(name, Settings()).fit(rest))


def same(one: Prediction, other: Prediction) -> bool:
    """Equal to the bit: pulse, draws and notes."""
    draws = [b"" if each.draws_mps2 is None else each.draws_mps2.tobytes() for each in (one, other)]
    return one.accel_mps2.tobytes() == other.accel_mps2.tobytes() and draws[0] == draws[1] and one.notes == other.notes


def runs(campaign: Campaign, n: int) -> Campaign:
    """The campaign with the first n CAE runs alone."""
    cae = campaign.cae
    return replace(campaign, cae=CaeLibrary(cae.ids[:n], cae.conditions[:n], cae.accel_mps2[:n]))


def test_it_says_all_that_is_shown_of_it(name: str) -> None:
    """Label, sentence name, description, colours and preference, none of which another one has."""
    approach, others = CLASSES[name], [other for key, other in CLASSES.items() if key != name]
    assert approach.name == name
    assert approach.label
    assert approach.in_words.startswith("the ")
    assert re.fullmatch(r"[^.]{20}.*\.", approach.description)
    for colour in (approach.colour, approach.dark_colour or approach.colour):
        assert re.fullmatch(r"#[0-9A-F]{6}", colour)
        assert colour not in [shade for other in others for shade in (other.colour, other.dark_colour)]
    assert approach.dash in ("solid", "dash", "dot", "dashdot")
    for said in ("label", "in_words", "description", "preference"):
        assert getattr(approach, said) not in [getattr(other, said) for other in others]


def test_it_predicts_a_whole_finite_pulse_the_same_each_time(name: str, campaign: Campaign, fits: Fits) -> None:
    """On the study grid, with draws on it too if it has a band; it remembers nothing of having been asked."""
    condition = campaign.test(HELD_OUT).condition
    prediction = fits(name).predict(condition)
    assert prediction.condition == condition
    assert prediction.accel_mps2.shape == GRID_S.shape
    assert np.isfinite(prediction.accel_mps2).all()
    if prediction.draws_mps2 is not None:
        assert prediction.draws_mps2.shape[1:] == GRID_S.shape
        assert np.isfinite(prediction.draws_mps2).all()
    fits(name).predict(campaign.tests[0].condition)
    assert same(prediction, fits(name).predict(condition))


@pytest.mark.slow
def test_a_refit_forgets_and_a_held_out_pulse_changes_nothing(name: str, campaign: Campaign, fits: Fits) -> None:
    """Fitted to all tests and then without one whose pulse is another, it predicts that one to the same bits."""
    test = campaign.test(HELD_OUT)
    other = replace(test, pulse=Pulse(GRID_S, 3 * test.pulse.accel_mps2 - 7))
    changed = replace(campaign, tests=tuple(other if each is test else each for each in campaign.tests))
    approach = create(name, Settings())
    approach.fit(changed).predict(test.condition)
    assert approach.fit(changed.without([HELD_OUT])) is approach
    assert same(approach.predict(test.condition), fits(name).predict(test.condition))


def test_its_fitted_state_predicts_the_same_bits(name: str, campaign: Campaign, fits: Fits) -> None:
    """What it learned goes through JSON and arrays; so does what it says of its fit and of tests left out."""
    rest, condition = campaign.without([HELD_OUT]), campaign.test(HELD_OUT).condition
    learned = fits(name).learned()
    kept = FittedState(json.loads(json.dumps(learned.values)), dict(learned.arrays))
    restored = create(name, Settings())
    assert restored.restore(rest, kept) is restored
    assert same(restored.predict(condition), fits(name).predict(condition))
    assert json.dumps(restored.state) == json.dumps(fits(name).state)
    one, two = fits(name).left_out(rest), restored.left_out(rest)
    assert set(one) <= set(rest.test_ids)
    assert one.keys() == two.keys()
    assert all(same(one[test], two[test]) for test in one)
    assert all(prediction.accel_mps2.shape == GRID_S.shape for prediction in one.values())


@pytest.mark.slow
def test_of_many_tests_it_learns_from_some_and_so_does_what_is_restored(
    name: str, campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With more tests than are learned from, its fitted state predicts the same bits, left-out tests included."""
    monkeypatch.setattr("crashfuse.approaches.base.MOST_TESTS", 3)
    fitted = create(name, Settings()).fit(campaign)
    restored = create(name, Settings()).restore(campaign, fitted.learned())
    condition = campaign.test(HELD_OUT).condition
    assert same(restored.predict(condition), fitted.predict(condition))
    one, two = fitted.left_out(campaign), restored.left_out(campaign)
    assert len(one) <= 3 or not CLASSES[name].learns_from_tests
    assert one.keys() == two.keys()
    assert all(same(one[test], two[test]) for test in one)


def test_what_it_mixes_can_be_predicted_by_others(name: str, campaign: Campaign, fits: Fits) -> None:
    """Given its parts' predictions it makes the same of them as alone."""
    approach, condition = fits(name), campaign.test(HELD_OUT).condition
    assert tuple(type(part) for part in approach.parts) == approach.made_of
    assert all(part.preference > approach.preference for part in approach.parts)
    parts = [part.predict(condition) for part in approach.parts]
    assert same(approach.predict_from(condition, parts), approach.predict(condition))


def test_before_it_is_fitted_it_says_so(name: str, campaign: Campaign) -> None:
    """One sentence with what to call; and nothing to say of a fit."""
    approach = create(name, Settings())
    with pytest.raises(NotFittedError, match=rf"{name} has not been fitted; call fit\(campaign\) first"):
        approach.predict(campaign.tests[0].condition)
    with pytest.raises(NotFittedError):
        approach.learned()
    assert approach.state == {}


def test_a_fit_that_is_cancelled_ends_at_its_next_report(name: str, campaign: Campaign) -> None:
    """The event is set before anything is computed."""
    cancel = threading.Event()
    cancel.set()
    with pytest.raises(Cancelled, match="Stopped on request"):
        create(name, Settings()).fit(campaign, Watch(cancel=cancel))


@pytest.mark.slow
def test_without_tests_it_fits_or_says_that_it_needs_some(name: str, campaign: Campaign) -> None:
    """What learns from tests says so; what does not is as good without."""
    bare, condition = campaign.without(campaign.test_ids), campaign.tests[0].condition
    approach = create(name, Settings())
    if approach.learns_from_tests:
        with pytest.raises(UsageError, match="learns from tests; this campaign has none"):
            approach.fit(bare)
    else:
        assert same(approach.fit(bare).predict(condition), create(name, Settings()).fit(campaign).predict(condition))


@pytest.mark.slow
def test_of_too_few_cae_runs_it_says_so(name: str, campaign: Campaign) -> None:
    """None is too few for all; one is enough, or it is said in a sentence."""
    with pytest.raises(CrashfuseError, match=r"CAE runs"):
        create(name, Settings()).fit(runs(campaign, 0))
    approach, trouble = create(name, Settings()), ""
    try:
        approach.fit(runs(campaign, 1))
    except UsageError as error:
        trouble = str(error)
    assert "at least 2" in trouble or np.isfinite(approach.predict(campaign.tests[0].condition).accel_mps2).all()
