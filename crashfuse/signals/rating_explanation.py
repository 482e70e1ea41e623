"""What a rating is made of: the shift that was found, the curves that were compared, and where each score was lost.

Every number is one that ISO/TS 18571 uses on the way to the scores (:mod:`crashfuse.signals.rating`), kept by time:
summed up again they give the scores. Only the humps are our own, see :func:`counterparts`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from crashfuse.errors import require_a
from crashfuse.signals import rating as iso18571
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.signals.rating import RATING_DT_S, WEIGHTS, Rating
from crashfuse.units import MS, Sentence, acceleration

_PROMINENCE = 0.1  # of the largest |a|: what rises less above its valleys is a ripple
_FARTHEST = 0.2  # of the samples: as far apart as the rating looks for a shift
_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")
_SEVERAL = 2  # humps: of one alone nothing is worst
_LEAST_SHOWN = 0.005  # an error that is shown as 1 %; parts of a smaller one are rounding
_NOTHING = 1e-9  # of a rating
_BALANCED_MPS2 = 0.5  # a hump that differs less on average is neither too strong nor too weak
_IN_PLACE_S = 0.0005  # a hump that comes this near to its time is not out of place


@dataclass(frozen=True, eq=False, slots=True)
class Compared:
    """Two curves that a score compares point by point, shape (n,), in m/s² (slopes: m/s³), by time in the reference."""

    time_s: FloatArray
    reference: FloatArray
    comparison: FloatArray

    @property
    def error(self) -> float:
        """Sum of |differences| over the sum of |reference|."""
        return float(np.abs(self.comparison - self.reference).sum() / np.abs(self.reference).sum())


@dataclass(frozen=True, slots=True)
class Excursion:
    """A stretch of time outside the inner corridor, and what it costs of the overall rating."""

    begin_s: float
    end_s: float
    difference_mps2: float  # comparison minus reference where they are farthest apart
    beyond_outer: bool
    loss: float


@dataclass(frozen=True, slots=True)
class RatedHump:
    """A hump of the reference, and what happens to each score while it lasts."""

    begin_s: float
    peak_s: float
    end_s: float
    counterpart_s: float | None  # the peak of the same hump in the comparison, as it stands
    shift_gain: float  # of the correlation
    magnitude_share: float  # of the errors of this score
    slope_share: float
    difference_mps2: float  # mean of comparison minus reference, shifted and warped; negative where nearer to zero

    @property
    def late_s(self) -> float | None:
        """How much later its peak comes in the comparison; None if there is none."""
        return None if self.counterpart_s is None else self.counterpart_s - self.peak_s


@dataclass(frozen=True, eq=False, slots=True)
class RatingExplanation:
    """A rating over [0, ``window_ms``) with what it is made of."""

    rating: Rating
    window_ms: float
    compared: Compared  # both curves as they stand, as the corridor score compares them
    inner_mps2: float  # half widths of the corridors
    outer_mps2: float
    excursions: tuple[Excursion, ...]
    shift_s: float  # how late the comparison comes by the shift of best correlation; negative if early
    at_limit: bool  # whether no larger shift is tried
    shifted: Compared
    warped: Compared  # shifted and warped, as the magnitude score compares them, a value for each step of the path
    slopes: Compared  # of those shifted
    humps: tuple[RatedHump, ...]  # of the reference

    def __repr__(self) -> str:
        lost = ", ".join(f"{part} {loss:.3f}" for part, loss in self.losses.items())
        return f"<RatingExplanation of {self.rating.overall:.3f} over 0–{self.window_ms:g} ms, lost by {lost}>"

    @property
    def losses(self) -> dict[str, float]:
        """What each part costs of the overall rating; with it they add up to 1."""
        return {part: weight * (1 - getattr(self.rating, part)) for part, weight in WEIGHTS.items()}

    @property
    def costliest(self) -> str:
        """The part that costs most."""
        return max(WEIGHTS, key=self.losses.__getitem__)


def explain_rating(
    reference: FloatArray | Pulse,
    comparison: FloatArray | Pulse,
    window_ms: float | None = None,
    *,
    dt_s: float | None = None,
) -> RatingExplanation:
    """Rate two curves and keep what the rating is made of.

    Parameters and errors are those of :func:`crashfuse.signals.rating.rate_iso18571`. The sizes of an explanation are
    in the curves' unit.
    """
    t, c = iso18571.curves_at_10_khz(reference, comparison, dt_s, window_ms)
    rating = iso18571.rate_iso18571(t, c, dt_s=RATING_DT_S)
    time_s = np.arange(t.size) * RATING_DT_S
    shift = int(iso18571.best_shifts(t, c[None])[0])
    shifted_t, shifted_c = iso18571.overlap(t, c, shift)
    at = slice(max(-shift, 0), max(-shift, 0) + shifted_t.size)  # of the overlap, in samples of the reference
    (i, j), *_ = iso18571.warping_paths(shifted_c[None], shifted_t, band=iso18571.WARP_BAND)
    warped = Compared(time_s[at][j], shifted_t[j], shifted_c[i])
    slopes = Compared(time_s[at], *(iso18571.smooth_slope(curve) / RATING_DT_S for curve in (shifted_t, shifted_c)))
    norm = float(np.abs(t).max())
    return RatingExplanation(
        rating=rating,
        window_ms=round(t.size * RATING_DT_S * 1e3, 6) if window_ms is None else float(window_ms),
        compared=Compared(time_s, t, c),
        inner_mps2=iso18571.INNER_CORRIDOR * norm,
        outer_mps2=iso18571.OUTER_CORRIDOR * norm,
        excursions=tuple(_excursions(t, c)),
        shift_s=shift * RATING_DT_S,
        at_limit=abs(shift) >= int(iso18571.MAX_SHIFT * t.size),
        shifted=Compared(time_s[at], shifted_t, shifted_c),
        warped=warped,
        slopes=slopes,
        humps=tuple(_rated_humps(t, c, shift, warped, slopes)),
    )


def _excursions(t: FloatArray, c: FloatArray) -> Iterator[Excursion]:
    values = iso18571.corridor_values(t, c)
    outside = np.flatnonzero(values < 1)
    for stretch in np.split(outside, np.flatnonzero(np.diff(outside) > 1) + 1) if outside.size else ():
        begin_s, end_s = float(stretch[0] * RATING_DT_S), float((stretch[-1] + 1) * RATING_DT_S)
        farthest = stretch[np.abs(c - t)[stretch].argmax()]
        loss = WEIGHTS["corridor"] * float((1 - values[stretch]).sum()) / t.size
        is_beyond = bool((values[stretch] == 0).any())
        yield Excursion(begin_s, end_s, float(c[farthest] - t[farthest]), is_beyond, loss)


def _rated_humps(t: FloatArray, c: FloatArray, shift: int, warped: Compared, slopes: Compared) -> Iterator[RatedHump]:
    gain = _correlation_terms(t, c, shift) - _correlation_terms(t, c, 0)
    magnitude, slope = (np.abs(pair.comparison - pair.reference) for pair in (warped, slopes))
    same = counterparts(t, c)
    for number, hump in enumerate(humps(t)):
        begin_s, peak_s, end_s = (sample * RATING_DT_S for sample in (hump.begin, hump.peak, hump.end))
        of_path, of_slopes = (
            (pair.time_s > begin_s - RATING_DT_S / 2) & (pair.time_s < end_s - RATING_DT_S / 2)
            for pair in (warped, slopes)
        )
        nearer = (np.sign(t[hump.peak]) * (warped.comparison - warped.reference))[of_path]
        yield RatedHump(
            begin_s=begin_s,
            peak_s=peak_s,
            end_s=end_s,
            counterpart_s=same[number].peak * RATING_DT_S if number in same else None,
            shift_gain=float(gain[hump.begin : hump.end].sum()),
            magnitude_share=_share(magnitude, of_path),
            slope_share=_share(slope, of_slopes),
            difference_mps2=float(nearer.mean()) if nearer.size else 0.0,
        )


def _correlation_terms(t: FloatArray, c: FloatArray, shift: int) -> FloatArray:
    terms, curves, begin = np.zeros_like(t), iso18571.overlap(t, c, shift), max(-shift, 0)
    if all(np.ptp(curve) > 0 for curve in curves):
        centred = [curve - curve.mean() for curve in curves]
        size = np.sqrt(np.prod([(curve**2).sum() for curve in centred]))
        terms[begin : begin + curves[0].size] = centred[0] * centred[1] / size
    return terms


def _share(error: FloatArray, part: np.ndarray) -> float:
    total = float(error.sum())
    return float(error[part].sum()) / total if total > 0 else 0.0


class Hump(NamedTuple):
    """A hump of a pulse from valley to valley, ``[begin, end)``, in samples."""

    begin: int
    peak: int
    end: int


def humps(curve: FloatArray) -> tuple[Hump, ...]:
    """The humps of a curve, shape (n,), on the side of zero where most of it lies, in order of time.

    A hump rises by at least a tenth of the largest value above the valleys beside it. Together they fill the curve.
    """
    from scipy.signal import find_peaks  # half a second

    upright = curve if curve.sum() > 0 else -curve
    peaks, _ = find_peaks(upright, prominence=_PROMINENCE * np.abs(curve).max())
    valleys = [int(left + upright[left:right].argmin()) for left, right in pairwise(peaks)]
    ends = pairwise([0, *valleys, curve.size])
    return tuple(Hump(begin, peak, end) for peak, (begin, end) in zip(peaks.tolist(), ends, strict=False))


def counterparts(reference: FloatArray, comparison: FloatArray) -> dict[int, Hump]:
    """The hump of the comparison that is each of the reference's, by number in :func:`humps`, where there is one.

    Both curves are warped onto each other. Two humps are the same if the peak of each is aligned with a moment of the
    other.
    """
    (i, j), *_ = iso18571.warping_paths(comparison[None], reference, band=_FARTHEST)

    def meets(samples: np.ndarray, hump: Hump) -> bool:
        return bool(((samples >= hump.begin) & (samples < hump.end)).any())

    others = humps(comparison)
    return {
        number: other
        for number, hump in enumerate(humps(reference))
        for other in others
        if meets(i[j == hump.peak], other) and meets(j[i == other.peak], hump)
    }


def rating_sentences(explanation: RatingExplanation, comparison: str = "prediction") -> dict[str, Sentence]:
    """Say what a rating is made of: ``overall`` what costs most of it, then each part by its name.

    ``comparison`` is what the curve that is compared with the test is called, in a word.
    """
    require_a(RatingExplanation, explanation, "crashfuse.explain_rating(reference, comparison)")
    rating, losses = explanation.rating, explanation.losses
    reasons = {name: reason_of(explanation, comparison) for name, reason_of in _REASONS.items()}
    overall = rating_headline(explanation)
    if 1 - rating.overall >= _NOTHING:
        reason = reasons[explanation.costliest]
        overall = Sentence(f"{{}} {reason.template[0].upper()}{reason.template[1:]}.", overall, *reason.values)
    heads = {n: f"{n.capitalize()} {getattr(rating, n):.2f} (costs {loss:.3f})" for n, loss in losses.items()}
    parts = {name: Sentence("{}: {}.", heads[name], reason) for name, reason in reasons.items()}
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
    text = (
        f"the {comparison} is outside the inner corridor (± {{}}) for {_ms(outside_s)} ms of "
        f"{explanation.window_ms:g}, {'in part' if beyond else 'never'} outside the outer (± {{}}); most is lost from "
        f"{_ms(worst.begin_s)} to {_ms(worst.end_s)} ms, where it is up to {{}} {side}"
    )
    return Sentence(text, inner, outer, acceleration(abs(worst.difference_mps2)))


def _phase(explanation: RatingExplanation, comparison: str) -> Sentence:
    humps, shift_s = explanation.humps, explanation.shift_s
    displaced = [hump for hump in humps if hump.late_s is not None and abs(hump.late_s) > _IN_PLACE_S]
    farthest, out_of_place = max(displaced, key=lambda hump: abs(hump.late_s or 0.0), default=None), ""
    if farthest is not None and (late_s := farthest.late_s):
        late = f"{_ms(abs(late_s))} ms {'late' if late_s > 0 else 'early'} in the {comparison}"
        out_of_place = f"; the {_nth(explanation, farthest)} hump is farthest off, {late}"
    if shift_s == 0:
        return Sentence(f"no shift in time of the {comparison} fits the test better{out_of_place}")
    way = f"{_ms(abs(shift_s))} ms {'earlier' if shift_s > 0 else 'later'}"
    limit = ", the largest shift that is tried" if explanation.at_limit else ""
    text = f"the {comparison} fits the test best when moved {way}{limit}"
    if humps:
        decisive = max(humps, key=lambda hump: hump.shift_gain)
        text += f"; the {_nth(explanation, decisive)} hump of the test ({_ms(decisive.peak_s)} ms) gains most"
    return Sentence(text + out_of_place)


def _magnitude(explanation: RatingExplanation, comparison: str) -> Sentence:
    moved, error = "shifted and " if explanation.shift_s else "", explanation.warped.error
    text = f"{moved}warped, the {comparison} still differs by {100 * error:.0f} % of the test"
    text, worst = _with_worst(explanation, text, error, "magnitude_share")
    if worst is None:
        return Sentence(text)
    if abs(worst.difference_mps2) < _BALANCED_MPS2:
        return Sentence(f"{text}, on average neither too strong nor too weak")
    size, side = acceleration(abs(worst.difference_mps2)), _side(worst.difference_mps2)
    return Sentence(f"{text}, on average {{}} {side}", size)


def _slope(explanation: RatingExplanation, comparison: str) -> Sentence:
    moved, error = "shifted, " if explanation.shift_s else "", explanation.slopes.error
    text = f"{moved}the slope of the {comparison} differs by {100 * error:.0f} % of the test's"
    return Sentence(_with_worst(explanation, text, error, "slope_share")[0])


def _with_worst(explanation: RatingExplanation, text: str, error: float, share: str) -> tuple[str, RatedHump | None]:
    if len(explanation.humps) < _SEVERAL or error < _LEAST_SHOWN:
        return text, None
    worst = max(explanation.humps, key=lambda hump: float(getattr(hump, share)))
    part = f"{100 * getattr(worst, share):.0f} % of that at the {_nth(explanation, worst)} hump"
    return f"{text}; {part} ({_ms(worst.begin_s)}–{_ms(worst.end_s)} ms)", worst


_REASONS = {"corridor": _corridor, "phase": _phase, "magnitude": _magnitude, "slope": _slope}


def _nth(explanation: RatingExplanation, hump: RatedHump) -> str:
    place = explanation.humps.index(hump)
    return _ORDINALS[place] if place < len(_ORDINALS) else f"{place + 1}th"


def _side(difference: float) -> str:
    return "too strong" if difference > 0 else "too weak"


def _ms(time_s: float) -> str:
    return f"{time_s / MS:.1f}"


def rating_range(lower: float, upper: float) -> str:
    """Both ends as displayed, one if they are equal."""
    return " to ".join(dict.fromkeys(f"{end:.2f}" for end in (lower, upper)))
