"""What to mend in the CAE model, as tables and sentences."""

from dataclasses import asdict, fields

import pandas as pd

from crashfuse.approaches.displacement_domain.events import CaeEvent, CaeEvents, cae_events
from crashfuse.campaign import Campaign
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.table import Column, Table, frame_of
from crashfuse.study.study import Study
from crashfuse.units import MS, Quantity, Sentence

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


_EVENTS = (
    Column("Rank", "number", form=".0f", source="rank"),
    Column("Crush", "range", "mm", ".0f", further=("from_mm", "to_mm")),
    Column("Time (ms)", source="time"),
    Column("The CAE model is", source="size"),
    Column("95 %", "range", "kN", ".0f", further=("least", "most")),
    Column("Probability", "probability", source="probability"),
    Column("Tests", source="which"),
    Column("Rating, this alone mended", "number", form=".3f", source="rating_alone"),
    Column("Rating, all but this mended", "number", form=".3f", source="rating_but"),
    Column("Share of what is lost", "share", "%", ".0f", source="share"),
)


def events_table(found: CaeEvents) -> Table:
    """The events, one row each."""
    rows = [
        {
            "time": Sentence("{} in {}", Quantity((event.from_s / MS, event.to_s / MS), ""), event.timed_in),
            "size": _size(event),
            "which": _which(event),
            **dict(zip(("least", "most"), _ends_kn(event), strict=True)),
        }
        for event in found.events
    ]
    return Table("CAE events", events_frame(found).join(frame_of(rows)), _EVENTS)


def events_sentences(found: CaeEvents) -> list[str]:
    """What to mend first, and what that is worth."""
    named = [event for event in found.events[:_NAMED] if event.share >= _WORTH_NAMING]
    none = "In no range of crush do two tests agree and would mending raise the rating."
    mended = f"with all events mended {found.rating_mended:.3f}, " if found.events else ""
    return [
        *([_sentence(found, event) for event in named] or [none]),
        f"The CAE model rates {found.rating_cae:.3f} over 0–{found.window_ms:g} ms in the mean of {found.n_rated} "
        f"tests, {mended}without its bias over displacement {found.rating_all:.3f}.",
    ]


def _sentence(found: CaeEvents, event: CaeEvent) -> str:
    tests = "tests" if len(event.reached) == len(found.tests) else "tests that crush as far"
    return (
        f"From {event.from_m / _MM:.0f} to {event.to_m / _MM:.0f} mm the CAE model is {_size(event)} "
        f"({Quantity(_ends_kn(event), '', '.0f')}) in {_which(event)} {tests}: {100 * event.share:.0f} % of what is "
        "lost."
    )


def _size(event: CaeEvent) -> str:
    return f"{abs(event.force_n) / _KN:.0f} kN too {'soft' if event.force_n > 0 else 'stiff'}"


def _ends_kn(event: CaeEvent) -> tuple[float, float]:
    lower, upper = (event.lower_n, event.upper_n) if event.force_n > 0 else (-event.upper_n, -event.lower_n)
    return lower / _KN, upper / _KN


def _which(event: CaeEvent) -> str:
    shown, reached = len(event.tests), len(event.reached)
    if shown == reached:
        return f"all {reached}"
    extreme = _SUPERLATIVES.get(event.conditions)
    return f"the {shown} {extreme} of {reached}" if extreme else f"{shown} of {reached}"
