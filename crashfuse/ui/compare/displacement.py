"""Test and predictions over displacement: five figures, each computed on demand."""

import streamlit as st

from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.figures import choose, show_cached_figure
from crashfuse.ui.text import plain

_CURVES, _ENERGY, _BIAS = "Acceleration", "Energy", "Bias by speed"
_PARTS, _CHECK = "Parts of the bias", "Check of the integration"
_OF_CURVES = {
    _CURVES: (
        "displacement",
        "Acceleration over displacement, up to maximum crush: {}",
        "Up to maximum crush (the marks, with their 95 % interval; an open end has no bar). The area under each curve "
        "is the absorbed energy per unit mass, ½ v0²: at one impact speed, a lower deceleration means more crush.",
    ),
    _ENERGY: (
        "energy",
        "Absorbed energy over crush: {}",
        "All of ½ m v0² is absorbed at maximum crush. The slope is the crush force; of curves at one speed and "
        "mass, one that ends further right needs more crush for the same energy.",
    ),
    _CHECK: (
        "integration",
        "Displacement over time, integrated over time and recovered from a(s), and their difference",
        "Lines: each pulse integrated twice over time, up to zero velocity. Circles: the same motion recovered from "
        "acceleration over displacement (Eq. 29 of the paper). Where they agree, the conversion is lossless.",
    ),
}
"""Figures of curves that the user chooses: the library's name, the alternative text, and what to see."""


def show(comparison: Comparison) -> None:
    """Show the held-out test, the CAE model and its correction over displacement, in the figure that the user picks."""
    row = st.container(horizontal=True, vertical_alignment="center", gap="xsmall")
    with row:
        choice = choose("Figure", [_CURVES, _ENERGY, _BIAS, _PARTS, _CHECK], key="over_displacement")
    if choice == _PARTS:
        _show_parts(comparison)
        return
    if choice == _BIAS:
        _show_bias(comparison)
        return
    with row:
        curves = comparison.choose_curves()
    figure, alt, caption = _OF_CURVES[choice]
    shown = "acceleration over displacement" if choice == _CURVES else choice.lower()
    show_cached_figure(
        lambda: comparison.plot(figure, curves),
        alt.format(curves.of(comparison.test.id)),
        choice,
        comparison.key,
        curves.key,
        name=curves.named(shown),
        beside=curves.also,
    )
    st.caption(caption)


def _show_bias(comparison: Comparison) -> None:
    campaign, test, display = comparison.view.campaign, comparison.test, comparison.view.display
    show_cached_figure(
        lambda: campaign.plot("bias", held_out=test.id, display=display),
        "What the CAE model got wrong in each test, over displacement, coloured by speed",
        _BIAS,
        comparison.key,
        name="bias by speed",
    )
    st.caption(
        "What has to be added to the CAE model to get each test. The displacement domain is fitted to these; "
        f"{plain(test.id)} is held out: drawn here, not used in the fit. The steep ends are at zero velocity."
    )


def _show_parts(comparison: Comparison) -> None:
    if comparison.config.preset == "paper":
        st.info("The paper's bias model (Table 4) is one Gaussian process; only the fast settings split it into parts.")
        return
    test, display = comparison.test, comparison.view.display
    show_cached_figure(
        lambda: comparison.study.plot(test.id, "bias parts", display=display),
        f"Parts of the bias that is expected in test {test.id}, over displacement, each with its 95 % band",
        _PARTS,
        comparison.key,
        name="parts of the bias",
    )
    st.caption(
        f"What the other {len(comparison.others.tests)} tests predict of the bias in {plain(test.id)}. Parts can "
        "cancel each other: their sum is better known than each of them. Shared: the same in every test; ratio: the "
        "CAE model's pulse, its trend and its humps, times a factor. The test's own part, its repeatability, can't be "
        "predicted, only its size. The measured bias is drawn for comparison only."
    )
