"""The credibility sheet: the factors of ASME V&V 40 (``credibility.toml``), filled with what a certification knows."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import chain
from typing import Any

import pandas as pd

from crashfuse.certification.certify import Certification
from crashfuse.condition import ABOUT, about_label
from crashfuse.files.toml_text import package_data
from crashfuse.results.certification_facts import facts
from crashfuse.results.certification_tables import changed_text
from crashfuse.results.result_tables import about_cells
from crashfuse.results.table import frame_of
from crashfuse.study.facts import campaign_facts, tuning_fact
from crashfuse.study.repeatability import repeats_of
from crashfuse.units import UnitSystem, joined, number, read_out, said, speed, statements, weight
from crashfuse.version import __version__

_MOST = 3  # sentences of a code
_BASES = {
    "measured": ("says", "facts"),
    "stated by the user": ("states", "stated_facts"),
    "not known": ("lacks", "lacks_facts"),
}
"""What a line rests on, and where a factor has its sentences and facts."""


@cache
def factors() -> list[dict[str, Any]]:
    """The rows of the sheet before they are filled."""
    return list(package_data(__file__)["factor"])


def credibility_table(certification: Certification, units: UnitSystem | None = None) -> pd.DataFrame:
    """:func:`credibility_rows` in these units, by default the campaign's."""
    system = certification.campaign.units if units is None else units
    rows = credibility_rows(certification)
    return rows.assign(data_say=[said(sentence, system) for sentence in rows["data_say"]])


def credibility_rows(certification: Certification) -> pd.DataFrame:
    """One row a factor and basis: what is asked, what the data say of it, its source; no level, no compliance."""
    known: dict[str, dict[str, None]] = {}
    for own in (*campaign_facts(certification.campaign), *facts(certification)):
        known.setdefault(own.code, {})[own.sentence] = None
    values = {**_of_tests(certification), **_of_answers(certification)}
    return frame_of(
        {
            **{name: row[name] for name in ("activity", "factor", "question")},
            "basis": basis,
            "data_say": joined(sentences),
            "source": row["source"],
        }
        for row in factors()
        for basis, sentences in _by_basis(row, values, known).items()
        if sentences
    )


def _by_basis(
    row: Mapping[str, Any], values: Mapping[str, object], known: Mapping[str, Mapping[str, None]]
) -> dict[str, list[str]]:
    found = {
        basis: [*filter(None, [statements(row.get(texts, ()), values)]), *_of_facts(row.get(codes, ()), known)]
        for basis, (texts, codes) in _BASES.items()
    }
    if "otherwise" in row and not any(found.values()):
        found["measured"] = [row["otherwise"]]
    if "unknown" in row:
        found["not known"].append(f"The data do not say: {row['unknown']}.")
    return found


def _of_facts(codes: Iterable[str], known: Mapping[str, Mapping[str, None]]) -> Iterator[str]:
    for sentences in ([*known.get(code, ())] for code in codes):
        yield from sentences[:_MOST]
        if len(sentences) > _MOST:
            yield f"({len(sentences) - _MOST} more are in report.html.)"


def _of_tests(certification: Certification) -> dict[str, object]:
    campaign, tests = certification.campaign, certification.campaign.tests
    quality, origin, tuning = campaign.quality, about_cells(campaign.cae.about), tuning_fact(campaign).sentence
    is_stated = any(test.cae_tuned is not None for test in tests)
    ends = [dict(about).get(f"{ABOUT}termination") for about in campaign.cae.about]
    stated = Counter(about_label(name) for name, _ in chain.from_iterable(test.about for test in tests))
    speeds, masses = ([getattr(t.condition, name) for t in tests] for name in ("speed_mps", "mass_kg"))
    return {
        "version": __version__,
        "quality": None if (unrecorded := quality.table.empty) else joined([*quality.sentences, quality.checks]),
        "unrecorded": quality.checks if unrecorded else None,
        **{"solver": origin.get("Solver"), "solver_version": origin.get("Version")},
        "no_solver": None if "Solver" in origin else "The CAE runs' solver is not stated (about_solver of cae.csv).",
        "tuned": tuning if is_stated else None,
        "tuning_unknown": None if is_stated else tuning,
        "runs": f"{len(campaign.cae):,}",
        "ended": f"{ends.count('normal'):,}" if any(ends) else None,
        "tests": len(tests),
        "repeated": sum(bool(repeats_of(test, campaign)) for test in tests),
        "speeds": speed(min(speeds), max(speeds), between=" to "),
        "masses": weight(min(masses), max(masses), between=" to "),
        "filter": campaign.filter_class or "not given",
        "pedigree": ", ".join(f"{name} {n}" for name, n in stated.items()) or None,
        "doubtful": read_out([test.id for test in tests if test.faults]) or "none",
        "paired": sum(campaign.cae.paired_run(test.condition) is not None for test in tests),
        "walls": sum(test.wall is not None for test in tests),
    }


def _of_answers(certification: Certification) -> dict[str, object]:
    criteria, record = certification.criteria.items, certification.record
    conditions, brier = certification.matrix.conditions, record.brier or (None, None)
    outside = sum(bool(certification.domain.outside(condition)) for condition in conditions)
    told = ["{} of {} need not be run as asked for".format(*certification.saved)]
    told += [
        f"{v.name}: {v.saved[0]} of {v.saved[1]} ({changed_text(v) or 'no change'})" for v in certification.variants
    ]
    return {
        "planned": len(conditions),
        ("tolerances" if certification.criteria.tolerances else "no_tolerances"): certification.criteria.scatter,
        "no_costs": "Not declared." if certification.criteria.costs is None else None,
        "criteria": ", ".join(criterion.name for criterion in criteria),
        **{name: score and f"{score:.4f}" for name, score in zip(("brier", "brier_cae"), brier, strict=True)},
        "planned_paired": sum(certification.campaign.cae.paired_run(own) is not None for own in conditions),
        "covered": sum(not certification.campaign.cae.extrapolation(condition) for condition in conditions),
        "near": sum(record.support(criterion).near for criterion in criteria),
        "asked": len(criteria),
        "inside": len(conditions) - outside,
        "outside": number(100 * outside / len(conditions), ".0f"),
        "variants": "; ".join(told),
        "untried": None if any(own.left_out for own in certification.variants) else "certify --robustness",
    }
