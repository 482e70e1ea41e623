"""Test and predictions over displacement: five figures, each computed on demand."""

from functools import partial

import numpy as np
import streamlit as st

from crashfuse.approaches.displacement_domain.approach import DisplacementDomain, measured_bias
from crashfuse.approaches.displacement_domain.bias import BiasPart, BiasPoints
from crashfuse.approaches.displacement_domain.config import DisplacementConfig
from crashfuse.approaches.fit_cache import fitted
from crashfuse.cae.model import CaeModel
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.cache import Cache
from crashfuse.reporting.plots import bias
from crashfuse.reporting.plots import displacement as plots
from crashfuse.signals.pulse import FloatArray
from crashfuse.ui.beside import without_clicks
from crashfuse.ui.compare.comparison import Comparison
from crashfuse.ui.figure_tools import file_name
from crashfuse.ui.figures import choose, show_cached_figure, show_figure

_CURVES, _ENERGY, _BIAS = "Acceleration", "Energy", "Bias by speed"
_PARTS, _CHECK = "Parts of the bias", "Check of the integration"
_STEP_M = 0.004  # grid of the drawn curves
_BEYOND = 1.1  # times the CAE model's crush; the held-out test, which may go further, must not influence it


def show(comparison: Comparison) -> None:
    """Show the held-out test, the CAE model and its correction over displacement, in the figure that the user picks."""
    display, test, condition = comparison.view.display, comparison.test, comparison.test.condition
    row = st.container(horizontal=True, vertical_alignment="center")
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
    measured = test.pulse if curves.test else None
    pulses = measured, curves.predictions, condition.speed_mps
    if choice == _CURVES:
        draw = partial(plots.over_displacement, *pulses, display, filled=curves.filled)
        alt = f"Acceleration over displacement: test {test.id} and every prediction of it, up to maximum crush"
        caption = (
            "Up to maximum crush (the marks, with their 95 % interval). The area under each curve is the absorbed "
            "energy per unit mass, ½ v0², the same for all: a lower deceleration means more crush."
        )
    elif choice == _ENERGY:
        draw = partial(plots.energy_over_crush, *pulses, condition.mass_kg, filled=curves.filled)
        alt = f"Absorbed energy over crush: test {test.id} and every prediction of it"
        caption = (
            "All of ½ m v0² is absorbed at maximum crush. The slope is the crush force; a curve that ends further "
            "right needs more crush for the same energy."
        )
    else:
        draw = partial(plots.integration_check, *pulses)
        alt = "Displacement over time, integrated over time and recovered from a(s), and their difference"
        caption = (
            "Lines: each pulse integrated twice over time, up to zero velocity. Circles: the same motion recovered "
            "from acceleration over displacement (Eq. 29). Where they agree, the conversion is lossless."
        )
    shown = "acceleration over displacement" if choice == _CURVES else choice.lower()
    name = file_name(test.id, shown, *display.in_names[1:])
    show_cached_figure(lambda: without_clicks(draw()), alt, choice, comparison.key, curves.key, name=name)
    st.caption(caption)


def _show_bias(comparison: Comparison) -> None:
    campaign, test, display = comparison.view.campaign, comparison.test, comparison.view.display
    biases = _biases(campaign.fingerprint, campaign)
    show_cached_figure(
        lambda: bias.bias_by_speed(campaign.tests, biases, highlight=test.id, display=display),
        "What the CAE model got wrong in each test, over displacement, coloured by speed",
        _BIAS,
        comparison.key,
        name=file_name(test.id, "bias by speed", *display.in_names[1:]),
    )
    st.caption(
        "What has to be added to the CAE model to get each test. The displacement domain is fitted to these; "
        f"{test.id} is held out: drawn here, not used in the fit. The steep ends are at zero velocity."
    )


def _show_parts(comparison: Comparison) -> None:
    view, config, rest = comparison.view, comparison.config, comparison.others
    if config.preset == "paper":
        st.info("The paper's bias model (Table 4) is one Gaussian process; only the fast settings split it into parts.")
        return
    campaign, test = view.campaign, view.held_out
    grid, expected = _parts(rest.fingerprint, test.condition, config.seed, rest)
    measured = _biases(campaign.fingerprint, campaign)[campaign.tests.index(test)]
    show_figure(
        bias.bias_parts(expected, grid, measured, view.display),
        alt=f"Parts of the bias that is expected in test {test.id}, over displacement, each with its 95 % band",
        name=file_name(test.id, "parts of the bias", *view.display.in_names[1:]),
    )
    st.caption(
        f"What the other {len(rest.tests)} tests predict of the bias in {test.id}. Parts can cancel each other: their "
        "sum is better known than each of them. The test's own part, its repeatability, can't be predicted, only its "
        "size. The measured bias is drawn for comparison only."
    )


@st.cache_data(show_spinner="Comparing the tests with the CAE model …", max_entries=8)
def _biases(fingerprint: str, _campaign: Campaign) -> tuple[BiasPoints, ...]:  # noqa: ARG001 - the key
    model = CaeModel(cache=Cache()).fit(_campaign.cae)
    return tuple(measured_bias(test, model) for test in _campaign.tests)


@st.cache_data(show_spinner="Splitting the bias into parts …", max_entries=32)
def _parts(
    fingerprint: str,  # noqa: ARG001 - the key, with the next two
    condition: Condition,
    seed: int,
    _rest: Campaign,
) -> tuple[FloatArray, tuple[BiasPart, ...]]:
    return parts(_rest, condition, seed=seed)


def parts(rest: Campaign, condition: Condition, *, seed: int) -> tuple[FloatArray, tuple[BiasPart, ...]]:
    """Displacements, and the parts of the bias there as estimated from the tests that were not held out."""
    unfitted = DisplacementDomain(DisplacementConfig.fast(), seed=seed, cache=Cache())
    domain, _ = fitted(unfitted, rest, Cache())
    grid = np.arange(0.0, _BEYOND * domain.model_.loading_curve(condition).own.crush_m, _STEP_M)
    return grid, domain.bias_parts(condition, grid)
