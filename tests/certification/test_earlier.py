"""An earlier certification: what it said of a condition."""

from crashfuse.certification.earlier import EarlierVerdict


def test_an_interval_of_which_one_end_is_known_holds_what_is_on_its_side() -> None:
    """None at all is no answer."""
    known, half, unknown = (EarlierVerdict("open", 0.5, *ends) for ends in ((1.0, 2.0), (None, 2.0), (None, None)))
    assert [known.holds(value) for value in (0.9, 1.0, 2.1)] == [False, True, False]
    assert half.holds(-1.0)
    assert unknown.holds(1.0) is None
