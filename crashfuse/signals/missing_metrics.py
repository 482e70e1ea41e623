"""Sentences on metrics that a record is too short for."""

from collections import defaultdict
from collections.abc import Iterable, Sequence

from crashfuse.signals.metrics import METRIC_LABELS, METRIC_NEEDS, Metric
from crashfuse.wording import Sentence, joined


def missing_metrics(metrics: Sequence[Metric]) -> tuple[str, ...]:
    """Sentences on which metrics and interval ends of a pulse are missing, one per reason; empty if none is."""
    values, ends = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
    for metric in metrics:
        needs, label = METRIC_NEEDS[metric.name], METRIC_LABELS[metric.name]
        if metric.value is None:
            values[needs].append(label)
        missing = [name for name, end in (("lower", metric.lower), ("upper", metric.upper)) if end is None]
        if metric.drawn and missing:
            ends[needs].append(f"{label} ({' and '.join(missing)} end)")
    return (
        *(
            f"The record ends before {needs}, which leaves no value of: {'; '.join(who)}."
            for needs, who in values.items()
        ),
        *(
            f"More than one draw in forty ends before {needs}, which leaves open: {'; '.join(who)}."
            for needs, who in ends.items()
        ),
    )


def missing_sentences(metrics: Iterable[tuple[str, Sequence[Metric]]]) -> list[str]:
    """Sentences of :func:`missing_metrics` for named pulses, each once with the names that it applies to."""
    said: dict[str, list[str]] = {}
    for name, own in metrics:
        for sentence in missing_metrics(own):
            said.setdefault(sentence, []).append(name)
    return [Sentence("{}: {}", joined(names, ", "), sentence) for sentence, names in said.items()]
