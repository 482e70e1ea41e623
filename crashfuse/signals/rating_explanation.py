"""What a rating is made of: the shift that was found, the curves that were compared, and where each score was lost.

Every number is one that ISO/TS 18571 uses on the way to the scores (:mod:`crashfuse.signals.rating`), kept by time:
summed up again they give the scores. Only the humps are our own, see :mod:`crashfuse.signals.humps`.
"""

from dataclasses import dataclass

import numpy as np

from crashfuse.signals.humps import counterparts, humps
from crashfuse.signals.pulse import FloatArray, Pulse
from crashfuse.signals.rating import RATING_DT_S, WEIGHTS, Rating, curves_at_10_khz, rate_iso18571
from crashfuse.signals.rating_scores import (
    INNER_CORRIDOR,
    MAX_SHIFT,
    OUTER_CORRIDOR,
    WARP_BAND,
    best_shifts,
    corridor_values,
    overlap,
    smooth_slope,
)
from crashfuse.signals.warping import warping_paths


@dataclass(frozen=True, eq=False, slots=True)
class Compared:
    """Two curves that a score compares point by point.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
        Time in the reference.
    reference, comparison : ndarray, shape (n,)
        In m/s², slopes in m/s³.
    """

    time_s: FloatArray
    reference: FloatArray
    comparison: FloatArray

    @property
    def error(self) -> float:
        """Sum of the differences over the sum of the reference, both without their signs."""
        return float(np.abs(self.comparison - self.reference).sum() / np.abs(self.reference).sum())


@dataclass(frozen=True, slots=True)
class Excursion:
    """A stretch of time outside the inner corridor.

    Attributes
    ----------
    begin_s, end_s : float
    difference_mps2 : float
        Comparison minus reference where they are farthest apart.
    beyond_outer : bool
        Whether the outer corridor is left as well.
    loss : float
        What the stretch costs of the overall rating.
    """

    begin_s: float
    end_s: float
    difference_mps2: float
    beyond_outer: bool
    loss: float


@dataclass(frozen=True, slots=True)
class RatedHump:
    """A hump of the reference, and what happens to each score while it lasts.

    Attributes
    ----------
    begin_s, peak_s, end_s : float
    counterpart_s : float or None
        Peak of the same hump in the comparison, as it stands; None if the comparison has no such hump.
    shift_gain : float
        What the shift gains here of the correlation over the whole window.
    magnitude_share, slope_share : float
        Share of the error of the score that arises here.
    difference_mps2 : float
        Mean of comparison minus reference here, shifted and warped, negative where it is nearer to zero.
    """

    begin_s: float
    peak_s: float
    end_s: float
    counterpart_s: float | None
    shift_gain: float
    magnitude_share: float
    slope_share: float
    difference_mps2: float

    @property
    def late_s(self) -> float | None:
        """How much later its peak comes in the comparison; negative if earlier, None if there is none."""
        return None if self.counterpart_s is None else self.counterpart_s - self.peak_s


@dataclass(frozen=True, eq=False, slots=True)
class RatingExplanation:
    """A rating with what it is made of.

    Attributes
    ----------
    window_ms : float
        Rated is [0, window_ms).
    compared : Compared
        Both curves as they stand, as the corridor score compares them.
    inner_mps2, outer_mps2 : float
        Half widths of the corridors.
    excursions : tuple of Excursion
        Stretches outside the inner corridor, in order of time.
    shift_s : float
        How late the comparison comes by the shift of best correlation; negative if it comes early.
    at_limit : bool
        Whether no larger shift is tried.
    shifted, warped, slopes : Compared
        The curves shifted; shifted and warped, as the magnitude score compares them, one value for each step of the
        path; and the slopes of those shifted.
    humps : tuple of RatedHump
        Those of the reference, in order of time.
    """

    rating: Rating
    window_ms: float
    compared: Compared
    inner_mps2: float
    outer_mps2: float
    excursions: tuple[Excursion, ...]
    shift_s: float
    at_limit: bool
    shifted: Compared
    warped: Compared
    slopes: Compared
    humps: tuple[RatedHump, ...]

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
        losses = self.losses
        return max(losses, key=lambda part: losses[part])


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
    t, c = curves_at_10_khz(reference, comparison, dt_s, window_ms)
    rating = rate_iso18571(t, c, dt_s=RATING_DT_S)
    time_s = np.arange(t.size) * RATING_DT_S
    shift = int(best_shifts(t, c[None])[0])
    shifted_t, shifted_c = overlap(t, c, shift)
    at = slice(max(-shift, 0), max(-shift, 0) + shifted_t.size)  # of the overlap, in samples of the reference
    (i, j), *_ = warping_paths(shifted_c[None], shifted_t, band=WARP_BAND)
    warped = Compared(time_s[at][j], shifted_t[j], shifted_c[i])
    slopes = Compared(time_s[at], *(smooth_slope(own) / RATING_DT_S for own in (shifted_t, shifted_c)))
    norm = float(np.abs(t).max())
    return RatingExplanation(
        rating,
        round(t.size * RATING_DT_S * 1e3, 6) if window_ms is None else float(window_ms),
        Compared(time_s, t, c),
        INNER_CORRIDOR * norm,
        OUTER_CORRIDOR * norm,
        _excursions(t, c),
        shift * RATING_DT_S,
        abs(shift) >= int(MAX_SHIFT * t.size),
        Compared(time_s[at], shifted_t, shifted_c),
        warped,
        slopes,
        _rated_humps(t, c, shift, warped, slopes),
    )


def _excursions(t: FloatArray, c: FloatArray) -> tuple[Excursion, ...]:
    values = corridor_values(t, c)
    outside = np.flatnonzero(values < 1)
    if not outside.size:
        return ()
    found = []
    for stretch in np.split(outside, np.flatnonzero(np.diff(outside) > 1) + 1):
        farthest = stretch[np.abs(c - t)[stretch].argmax()]
        found.append(
            Excursion(
                float(stretch[0] * RATING_DT_S),
                float((stretch[-1] + 1) * RATING_DT_S),
                float(c[farthest] - t[farthest]),
                bool((values[stretch] == 0).any()),
                WEIGHTS["corridor"] * float((1 - values[stretch]).sum()) / t.size,
            )
        )
    return tuple(found)


def _rated_humps(t: FloatArray, c: FloatArray, shift: int, warped: Compared, slopes: Compared) -> tuple[RatedHump, ...]:
    gain = _correlation_terms(t, c, shift) - _correlation_terms(t, c, 0)
    magnitude, slope = (np.abs(own.comparison - own.reference) for own in (warped, slopes))
    same = counterparts(t, c)
    found = []
    for number, hump in enumerate(humps(t)):
        begin_s, peak_s, end_s = (sample * RATING_DT_S for sample in (hump.begin, hump.peak, hump.end))
        of_path, of_slopes = (
            (own.time_s > begin_s - RATING_DT_S / 2) & (own.time_s < end_s - RATING_DT_S / 2)
            for own in (warped, slopes)
        )
        nearer = (np.sign(t[hump.peak]) * (warped.comparison - warped.reference))[of_path]
        found.append(
            RatedHump(
                begin_s,
                peak_s,
                end_s,
                same[number].peak * RATING_DT_S if number in same else None,
                float(gain[hump.samples].sum()),
                _share(magnitude, of_path),
                _share(slope, of_slopes),
                float(nearer.mean()) if nearer.size else 0.0,
            )
        )
    return tuple(found)


def _correlation_terms(t: FloatArray, c: FloatArray, shift: int) -> FloatArray:
    """What each sample of the reference adds to the correlation of the overlap, shape (n,); 0 outside the overlap."""
    terms = np.zeros_like(t)
    own = overlap(t, c, shift)
    if all(np.ptp(curve) > 0 for curve in own):
        centred = [curve - curve.mean() for curve in own]
        begin = max(-shift, 0)
        size = np.sqrt(np.prod([(curve**2).sum() for curve in centred]))
        terms[begin : begin + own[0].size] = centred[0] * centred[1] / size
    return terms


def _share(error: FloatArray, part: np.ndarray) -> float:
    total = float(error.sum())
    return float(error[part].sum()) / total if total > 0 else 0.0
