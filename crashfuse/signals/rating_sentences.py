"""A rating in words: a sentence on what costs most, and one on each of its four parts."""

import numpy as np

from crashfuse.signals.rating_explanation import RatedHump, RatingExplanation
from crashfuse.units import MS
from crashfuse.wording import Sentence, acceleration

_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")
_SEVERAL = 2  # humps: of one alone nothing is worst
_NOTHING = 1e-9  # of a rating
_BALANCED_MPS2 = 0.5  # a hump that differs less on average is neither too strong nor too weak
_IN_PLACE_S = 0.0005  # a hump that comes this near to its time is not out of place


def rating_sentences(explanation: RatingExplanation, comparison: str = "prediction") -> dict[str, Sentence]:
    """Say what a rating is made of: ``overall`` what costs most of it, then each part by its name.

    ``comparison`` is what the curve that is compared with the test is called, in a word.
    """
    rating, losses = explanation.rating, explanation.losses
    reasons = {name: reason_of(explanation, comparison) for name, reason_of in _REASONS.items()}
    overall = rating_headline(explanation)
    if 1 - rating.overall >= _NOTHING:
        reason = reasons[explanation.costliest]
        overall = Sentence(f"{{}} {reason.template[0].upper()}{reason.template[1:]}.", overall, *reason.values)
    parts = {
        name: Sentence("{}: {}.", f"{name.capitalize()} {getattr(rating, name):.2f} (costs {losses[name]:.3f})", reason)
        for name, reason in reasons.items()
    }
    return {"overall": overall, **parts}


def rating_headline(explanation: RatingExplanation) -> Sentence:
    """A rating, and the part that costs most of it."""
    rating, part, lost = explanation.rating, explanation.costliest, 1 - explanation.rating.overall
    head, costs = f"{rating.overall:.3f} ({rating.grade}) over 0–{explanation.window_ms:g} ms", explanation.losses[part]
    most = "nothing is lost" if lost < _NOTHING else f"{part} costs most, {costs:.3f} of the {lost:.3f} missing to 1"
    return Sentence("{}: {}.", head, most)


def _corridor(explanation: RatingExplanation, comparison: str) -> Sentence:
    inner, outer = (acceleration(half) for half in (explanation.inner_mps2, explanation.outer_mps2))
    if not explanation.excursions:
        return Sentence(f"the {comparison} stays inside the inner corridor, ± {{}}", inner)
    outside_s = sum(excursion.end_s - excursion.begin_s for excursion in explanation.excursions)
    beyond = any(excursion.beyond_outer for excursion in explanation.excursions)
    worst = max(explanation.excursions, key=lambda excursion: excursion.loss)
    side = _side(worst.difference_mps2 * float(np.sign(explanation.compared.reference.sum())))
    return Sentence(
        f"the {comparison} is outside the inner corridor (± {{}}) for {_ms(outside_s)} ms of "
        f"{explanation.window_ms:g}, {'in part' if beyond else 'never'} outside the outer (± {{}}); most is lost from "
        f"{_ms(worst.begin_s)} to {_ms(worst.end_s)} ms, where it is up to {{}} {side}",
        inner, outer, acceleration(abs(worst.difference_mps2)),
    )  # fmt: skip


def _phase(explanation: RatingExplanation, comparison: str) -> Sentence:
    humps, shift_s = explanation.humps, explanation.shift_s
    displaced = [hump for hump in humps if hump.late_s is not None and abs(hump.late_s) > _IN_PLACE_S]
    farthest, out_of_place = max(displaced, key=lambda hump: abs(hump.late_s or 0.0), default=None), ""
    if farthest is not None and (late_s := farthest.late_s):
        late = f"{_ms(abs(late_s))} ms {'late' if late_s > 0 else 'early'} in the {comparison}"
        out_of_place = f"; farthest out of place is the {_nth(explanation, farthest)} hump, {late}"
    if shift_s == 0:
        return Sentence(f"no shift of the {comparison} correlates better with the test{out_of_place}")
    way = f"{_ms(abs(shift_s))} ms {'earlier' if shift_s > 0 else 'later'}"
    limit = ", the largest shift that is tried" if explanation.at_limit else ""
    text = f"the {comparison} correlates best with the test when moved {way}{limit}"
    if humps:
        decisive = max(humps, key=lambda hump: hump.shift_gain)
        text += f"; that gains most at the {_nth(explanation, decisive)} hump of the test ({_ms(decisive.peak_s)} ms)"
    return Sentence(text + out_of_place)


def _magnitude(explanation: RatingExplanation, comparison: str) -> Sentence:
    moved = "shifted and " if explanation.shift_s else ""
    text = f"{moved}warped, the {comparison} still differs by {100 * explanation.warped.error:.0f} % of the test"
    if len(explanation.humps) < _SEVERAL or explanation.warped.error == 0:
        return Sentence(text)
    worst = max(explanation.humps, key=lambda hump: hump.magnitude_share)
    text += f"; {100 * worst.magnitude_share:.0f} % of that at the {_nth(explanation, worst)} hump ({_range(worst)})"
    if abs(worst.difference_mps2) < _BALANCED_MPS2:
        return Sentence(f"{text}, on average neither too strong nor too weak")
    size, side = acceleration(abs(worst.difference_mps2)), _side(worst.difference_mps2)
    return Sentence(f"{text}, on average {{}} {side}", size)


def _slope(explanation: RatingExplanation, comparison: str) -> Sentence:
    moved = "shifted, " if explanation.shift_s else ""
    text = f"{moved}the slope of the {comparison} differs by {100 * explanation.slopes.error:.0f} % of the test's"
    if len(explanation.humps) < _SEVERAL or explanation.slopes.error == 0:
        return Sentence(text)
    worst = max(explanation.humps, key=lambda hump: hump.slope_share)
    share = f"{100 * worst.slope_share:.0f} % of that at the {_nth(explanation, worst)} hump ({_range(worst)})"
    return Sentence(f"{text}; {share}")


_REASONS = {"corridor": _corridor, "phase": _phase, "magnitude": _magnitude, "slope": _slope}


def _nth(explanation: RatingExplanation, hump: RatedHump) -> str:
    place = explanation.humps.index(hump)
    return _ORDINALS[place] if place < len(_ORDINALS) else f"{place + 1}th"


def _range(hump: RatedHump) -> str:
    return f"{_ms(hump.begin_s)}–{_ms(hump.end_s)} ms"


def _side(difference: float) -> str:
    return "too strong" if difference > 0 else "too weak"


def _ms(time_s: float) -> str:
    return f"{time_s / MS:.1f}"


def rating_range(lower: float, upper: float) -> str:
    """Both ends as displayed, one if they are equal."""
    return " to ".join(dict.fromkeys(f"{end:.2f}" for end in (lower, upper)))
