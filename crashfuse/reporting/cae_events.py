"""What to mend in the CAE model, as tables and sentences."""

from dataclasses import asdict, fields

import pandas as pd

from crashfuse.approaches.displacement_domain.events import CaeEvent, CaeEvents, cae_events
from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.display import Display
from crashfuse.study.study import Study
from crashfuse.units import MS, number, probability_text, statements

_MM, _KN = 1e-3, 1e3
_SHOWN = {"_m": ("_mm", _MM), "_s": ("_ms", MS), "_n": ("_kn", _KN)}
_LEARNS = {"displacement_domain", "fused"}  # approaches that rest on this bias
_NAMED, _WORTH_NAMING = 3, 0.05  # events in sentences; share of what is lost
_SUPERLATIVES = {"fast": "fastest", "slow": "slowest", "heavy": "heaviest", "light": "lightest"}


def study_events(study: Study) -> CaeEvents | None:
    """The events of a study's campaign, over its longest window; None if the study has not learned the bias."""
    learned = _LEARNS.intersection(study.config.approaches)
    return cae_events(study.campaign, max(study.config.windows_ms)) if learned else None


def campaign_events(campaign: Campaign, window_ms: float) -> pd.DataFrame:
    """See :meth:`Campaign.cae_events`."""
    return events_frame(cae_events(campaign, float(Display(window_ms).window_ms)))


def events_frame(found: CaeEvents) -> pd.DataFrame:
    """One row an event, the most expensive first, as in ``cae_events.csv`` (see *Read the report*)."""
    frame = pd.DataFrame(map(asdict, found.events), columns=[field.name for field in fields(CaeEvent)])
    for ending, (shown, unit) in _SHOWN.items():
        names = [name for name in frame if name.endswith(ending)]
        frame[names] = (frame[names] / unit).round(6)
        frame = frame.rename(columns={name: name.removesuffix(ending) + shown for name in names})
    frame[["tests", "reached"]] = frame[["tests", "reached"]].map(" ".join)
    frame.insert(0, "rank", range(1, len(frame) + 1))
    return frame.assign(rating_cae=found.rating_cae, rating_mended=found.rating_mended, window_ms=found.window_ms)


def events_table(found: CaeEvents) -> pd.DataFrame:
    """The events as a readable table, one row each."""
    return pd.DataFrame(
        {
            "Rank": rank,
            "Crush (mm)": _between(event.from_m / _MM, event.to_m / _MM, ".0f"),
            "Time (ms)": f"{_between(event.from_s / MS, event.to_s / MS, '.1f')} in {event.timed_in}",
            "The CAE model is": _size(event),
            "95 % (kN)": _interval(event),
            "Probability": probability_text(event.probability, 1.0),
            "Tests": _which(event),
            "Rating, this alone mended": f"{event.rating_alone:.3f}",
            "Rating, all but this mended": f"{event.rating_but:.3f}",
            "Share of what is lost (%)": number(100 * event.share, ".0f"),
        }
        for rank, event in enumerate(found.events, start=1)
    )


def events_sentences(found: CaeEvents) -> list[str]:
    """What to mend first, and what that is worth."""
    named = [event for event in found.events[:_NAMED] if event.share >= _WORTH_NAMING]
    worth = {name: getattr(found, name) for name in ("rating_cae", "window_ms", "n_rated", "rating_all")}
    worth["mended"] = found.rating_mended if found.events else None
    return [
        *(
            f"{_between(e.from_m / _MM, e.to_m / _MM, '.0f')} mm: {_size(e)} ({_interval(e)}) in {_which(e)} tests; "
            f"{100 * e.share:.0f} % of what is lost."
            for e in named
        ),
        *([] if named else ["In no range of crush do two tests agree and would mending raise the rating."]),
        statements(_WORTH, worth),
    ]


_WORTH = (
    "The CAE model rates {rating_cae:.3f} over 0–{window_ms:g} ms (mean of {n_rated} tests).",
    "With all events mended: {mended:.3f}.",
    "Without its bias over displacement: {rating_all:.3f}.",
)


def _between(lower: float, upper: float, form: str) -> str:
    return f"{number(lower, form)}–{number(upper, form)}"


def _size(event: CaeEvent) -> str:
    return f"{abs(event.force_n) / _KN:.0f} kN too {'soft' if event.force_n > 0 else 'stiff'}"


def _interval(event: CaeEvent) -> str:
    ends = (event.lower_n, event.upper_n) if event.force_n > 0 else (-event.upper_n, -event.lower_n)
    return _between(ends[0] / _KN, ends[1] / _KN, ".0f")


def _which(event: CaeEvent) -> str:
    shown, reached = len(event.tests), len(event.reached)
    if shown == reached:
        return f"all {reached}"
    extreme = _SUPERLATIVES.get(event.conditions)
    return f"the {shown} {extreme} of {reached}" if extreme else f"{shown} of {reached}"
