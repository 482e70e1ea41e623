"""Time left of a computation of several steps."""

import pytest

from crashfuse.execution.progress import Progress
from crashfuse.execution.time_left import TimeLeft, rounded

EXPECTED = {"Read": 4.0, "Train": 20.0, "Rate": 6.0}


def followed(took_s: dict[str, float], parts: int = 20) -> dict[float, float]:
    """Errors of the time told, over the duration of all, at 20, 50 and 80 %, if steps take these times in turn."""
    whole_s = sum(took_s.values())
    left, errors, now_s = TimeLeft(EXPECTED, 0.0), {}, 0.0
    for name, seconds in took_s.items():
        for part in range(parts + 1):
            left.take(Progress(name, part, parts), now_s)
            for share in (0.2, 0.5, 0.8):
                if share not in errors and now_s >= share * whole_s:
                    told_s = left.left_s(now_s)
                    assert told_s is not None
                    errors[share] = (told_s - (whole_s - now_s)) / whole_s
            now_s += seconds / parts if part < parts else 0.0
    return errors


@pytest.mark.parametrize("pace", [0.5, 1.0, 4.0])
def test_another_computer_shows_in_the_first_seconds(pace: float) -> None:
    """All steps twice as fast or four times as slow as expected: off by less than a fifth of the whole."""
    errors = followed({name: pace * seconds for name, seconds in EXPECTED.items()})
    assert all(abs(error) < 0.2 for error in errors.values())
    assert abs(errors[0.8]) < 0.1


@pytest.mark.parametrize("training_s", [5.0, 200.0])
def test_a_long_step_has_a_pace_of_its_own(training_s: float) -> None:
    """Training on a GPU, or with ten times the epochs: halfway, the pace of reading no longer counts."""
    errors = followed({"Read": 4.0, "Train": training_s, "Rate": 6.0})
    assert abs(errors[0.5]) < 0.2
    assert abs(errors[0.8]) < 0.2


def test_a_step_that_is_known_from_earlier_is_not_waited_for() -> None:
    """Networks that were trained before: once rating has moved, only that is left."""
    left = TimeLeft(EXPECTED, 0.0)
    left.take(Progress("Read", 0, 1), 0.0)
    left.take(Progress("Read", 1, 1), 4.0)
    before_s = left.left_s(4.0)
    left.take(Progress("Rate", 0, 2), 4.0)
    left.take(Progress("Rate", 1, 2), 7.0)
    after_s = left.left_s(7.0)
    assert before_s == pytest.approx(26.0)
    assert after_s == pytest.approx(3.0)


def test_a_slow_beginning_of_a_step_does_not_make_minutes_of_seconds() -> None:
    """The first of forty parts takes as long as four: what is told rises by less than it would by that pace."""
    left = TimeLeft({"Read": 10.0, "Rate": 40.0}, 0.0)
    for part in range(11):
        left.take(Progress("Read", part, 10), float(part))
        left.left_s(float(part))
    left.take(Progress("Rate", 0, 40), 10.0)
    left.take(Progress("Rate", 1, 40), 14.0)
    assert 35.0 < (left.left_s(14.0) or 0.0) < 60.0


def test_what_was_done_before_the_start_says_nothing_about_the_pace() -> None:
    """A study that continues at 80 of 100 predictions: the other 20 take as long as expected."""
    left = TimeLeft({"Predict": 100.0}, 0.0)
    left.take(Progress("Predict", 80, 100), 0.0)
    assert left.left_s(0.0) == pytest.approx(20.0)
    left.take(Progress("Predict", 90, 100), 10.0)
    assert left.left_s(10.0) == pytest.approx(10.0)


def test_a_silent_step_never_has_nothing_left() -> None:
    """A step that says nothing and takes longer than expected still has a tenth to go, and the bar never falls."""
    left, shares = TimeLeft({"Emulate": 10.0}, 0.0), []
    left.take(Progress("Emulate", 0, 1), 0.0)
    for now_s in range(0, 40, 2):
        told_s = left.left_s(now_s)
        assert told_s is not None
        assert told_s >= 1.0
        shares.append(left.share(now_s))
    assert shares == sorted(shares)
    assert shares[-1] < 1


def test_nothing_is_told_of_unknown_steps() -> None:
    """No number rather than a guess."""
    left = TimeLeft({}, 0.0)
    left.take(Progress("Anything", 1, 2), 3.0)
    assert left.left_s(3.0) is None
    assert left.share(3.0) == 0


@pytest.mark.parametrize(("seconds", "told"), [(0.0, 1), (7.2, 8), (19.0, 19), (23.0, 25), (68.0, 70), (130.0, 150)])
def test_times_are_told_as_precisely_as_they_are_known(seconds: float, told: float) -> None:
    """Nobody believes 68 s; and nothing ever takes 0 s more."""
    assert rounded(seconds) == told
