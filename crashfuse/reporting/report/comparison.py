"""The report of two studies beside each other."""

import platform

from crashfuse.approaches.registry import LABELS
from crashfuse.reporting.past_results import (
    comparison_by_window,
    comparison_means,
    comparison_tests,
    left_out_in_words,
    studies_table,
)
from crashfuse.reporting.plots.compared import rating_differences
from crashfuse.reporting.plots.display import DEFAULT, Display
from crashfuse.reporting.report.page import render_in_frame
from crashfuse.study.comparison import StudyComparison
from crashfuse.version import __version__


def comparison_report(compared: StudyComparison, display: Display = DEFAULT) -> str:
    """HTML report of two studies: which one rates higher, in which tests, by how much, and what they are.

    Over the rated window of the display, if both were rated over it, else over the longest one.
    """
    first, second = compared.first, compared.second
    window = compared.window(display.window_ms)
    names = dict.fromkeys([first.campaign, second.campaign])
    return render_in_frame(
        "comparison",
        f"{' and '.join(names)}: two studies compared",
        display,
        window=f"0–{window:g} ms",
        basis=first.basis,
        studies=studies_table(first, second, display),
        cautions=compared.cautions,
        ways=[
            {
                "label": left_out_in_words(way),
                "sentences": compared.sentences(window, way),
                "means": comparison_means(compared, window, way),
                "tests": comparison_tests(compared, window, way),
                "figure": rating_differences(compared, window, way),
                "by_window": comparison_by_window(compared, way) if len(compared.windows_ms) > 1 else None,
            }
            for way in compared.ways
        ],
        origin={
            "Command": f"crashfuse compare {first.id} {second.id} --report FILE",
            "Campaign fingerprints (SHA-256)": " ".join(dict.fromkeys([first.fingerprint, second.fingerprint])),
            "Approaches": ", ".join(LABELS.get(name, name) for name in compared.ratings["approach"].unique()),
            "crashfuse": __version__,
            "Python, platform": f"{platform.python_version()}, {platform.platform()}",
        },
    )
