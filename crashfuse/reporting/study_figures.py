"""Figures of a study by name: of all its held-out tests, and of one of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Unpack

import numpy as np
import plotly.graph_objects as go

from crashfuse.approaches.calibration import LEVELS
from crashfuse.approaches.displacement_domain.approach import DisplacementConfig, DisplacementDomain, measured_bias
from crashfuse.approaches.fit_cache import fitted
from crashfuse.approaches.registry import by_preference
from crashfuse.campaign_folder.notes import Note
from crashfuse.errors import UsageError, one_of, require_a
from crashfuse.execution.cache import Cache
from crashfuse.reporting.figures import PULSES, Curves, Further, beside, chosen
from crashfuse.reporting.plots.curves import add_marks
from crashfuse.reporting.plots.displacement import bias_parts
from crashfuse.reporting.plots.display import Display, DisplayOptions
from crashfuse.reporting.plots.learning import learning_curves, tuning_strength
from crashfuse.reporting.plots.pulses import add_corridors, residuals
from crashfuse.reporting.plots.ratings import (
    calibration_curves,
    rated_curves,
    rating_heatmap,
    rating_parts,
    rating_spread,
)
from crashfuse.study.config import require_rated
from crashfuse.study.study import Fold, Study

_STEP_M = 0.004  # grid of the parts of a bias
_BEYOND = 1.1  # times the CAE model's crush; the held-out test, which may go further, must not influence it
_ACCELERATIONS = ("motion", "acceleration")  # figures that begin with acceleration over time
_OVER_TIME = (*_ACCELERATIONS, "residuals")


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a figure of a study shows: some approaches, of all tests or of one, then with its curves."""

    study: Study
    approaches: tuple[str, ...]
    display: Display
    fold: Fold
    curves: Curves

    @property
    def window_ms(self) -> float:
        """The rated window; a sentence if the study was not rated over it."""
        return _rated(self.study, self.display)


def overview(
    study: Study, figure: str, approaches: Sequence[str] | None, **options: Unpack[DisplayOptions]
) -> go.Figure:
    """A figure of all held-out tests, see :meth:`Study.plot`."""
    draw = one_of("figure of a whole study", figure, OF_ALL_TESTS)
    names = chosen({name: name for fold in study.folds for name in fold.ratings}, approaches)
    return draw(study, tuple(names), _rated(study, _display(study, options)))


def figure_of_test(
    study: Study,
    held_out: str,
    figure: str,
    approaches: Sequence[str] | None,
    *,
    also: Sequence[Further],
    band: str | None,
    measured: bool,
    corridors: bool,
    notes: Sequence[Note],
    **options: Unpack[DisplayOptions],
) -> go.Figure:
    """A figure of one held-out test, see :meth:`Study.plot`."""
    draw = one_of("figure of a held-out test", figure, OF_A_TEST)
    require_a(bool, measured, "measured=False leaves the test out")
    require_a(bool, corridors, "corridors=True shades them")
    for note in notes:
        require_a(Note, note, "crashfuse.Note(test, text)")
    if corridors and figure not in _ACCELERATIONS:
        raise UsageError(f"Corridors stand in the figures {' and '.join(_ACCELERATIONS)}, not in {figure}.")
    fold, display = study.fold(held_out), _display(study, options)
    estimates = chosen({each.approach: each for each in fold.estimates}, approaches, band)
    shown = estimates | beside(study.campaign, also, display)
    curves = Curves(fold.test.pulse if measured else None, shown, fold.test.condition, band)
    drawn = draw(_Shown(study, tuple(estimates), display, fold, curves))
    if corridors:
        add_corridors(drawn, fold.test.pulse, display)
    return add_marks(drawn, [note for note in notes if note.test == held_out]) if figure in _OVER_TIME else drawn


def _display(study: Study, options: DisplayOptions) -> Display:
    """The display asked for, by default over the longest window of the study."""
    return Display.of(study.campaign.units, max(study.config.windows_ms), **options)


def _rated(study: Study, display: Display) -> float:
    require_rated("study", display.window_ms, study.config.windows_ms)
    return display.window_ms


def _ratings(study: Study, names: Sequence[str], window_ms: float) -> go.Figure:
    overall = {
        fold.held_out: {name: own[window_ms].overall for name, own in fold.ratings.items() if name in names}
        for fold in study.folds
    }
    return rating_heatmap(overall, study.repeats(window_ms))


def _draws(study: Study, names: Sequence[str], window_ms: float) -> go.Figure:
    spread = study.rating_spread(window_ms)
    if not any(name in own for own in spread.values() for name in names):
        raise UsageError("None of these approaches has a band to draw pulses from.")
    some = {test: {name: own[name] for name in own if name in names} for test, own in spread.items()}
    return rating_spread(some, study.repeats(window_ms))


def _calibration(study: Study, names: Sequence[str], _: float) -> go.Figure:
    return calibration_curves(LEVELS, {name: own for name, own in study.reliability.items() if name in names})


OF_ALL_TESTS: dict[str, Callable[[Study, Sequence[str], float], go.Figure]] = {
    "ratings": _ratings,
    "draws": _draws,
    "calibration": _calibration,
}
"""Ratings by test and approach; those of single draws from the bands; the share of tests inside bands of each level."""


def _scores(own: _Shown) -> go.Figure:
    window_ms = own.window_ms
    return rating_parts({name: own.fold.ratings[name][window_ms] for name in own.approaches})


def _rating(own: _Shown) -> go.Figure:
    approach = by_preference(own.approaches)[0]
    further = {name: pulse for name, pulse in own.curves.predictions.items() if name not in own.approaches}
    return rated_curves(own.fold.explained(approach, own.window_ms), approach, own.display, further)


def _bias_parts(own: _Shown) -> go.Figure:
    config, test = own.study.config, own.fold.test
    if config.preset == "paper":
        raise UsageError(
            "The paper's bias model (Table 4) is one Gaussian process; only the fast settings split it into parts."
        )
    unfitted = DisplacementDomain(DisplacementConfig.fast(), seed=config.seed, cache=Cache())
    domain, _ = fitted(unfitted, config.training_campaign(own.study.campaign, test.id), Cache())
    grid = np.arange(0.0, _BEYOND * domain.model_.loading_curve(test.condition).phase.crush_m, _STEP_M)
    measured = measured_bias(test, domain.model_) if own.curves.measured is not None else None
    return bias_parts(domain.bias_parts(test.condition, grid), grid, measured, own.display)


def _state(own: _Shown, *keys: str) -> dict[str, Any]:
    """What the preferred network says of its training."""
    states = {name: own.fold.estimate(name).state for name in own.approaches}
    having = [name for name in by_preference(states) if any(key in states[name] for key in keys)]
    if not having:
        raise UsageError(f"None of these approaches trained a network like that: {', '.join(states)}.")
    return states[having[0]]


def _training(own: _Shown) -> go.Figure:
    return _losses(_state(own, "learning_curve")["learning_curve"], "Mean square error", "Epoch")


def _fine_tuning(own: _Shown) -> go.Figure:
    state = _state(own, "left_out_rmse", "tuning_curve")
    if "tuning_curve" in state:
        return _losses(state["tuning_curve"], "Loss", "Step")
    return tuning_strength(state["rmse"], state["left_out_rmse"], str(state["penalty"]))


def _losses(curve: dict[str, list[float]], value: str, step: str) -> go.Figure:
    steps = [int(number) for number in curve["epoch"]]
    losses = {name.replace("_", " "): list(zip(steps, curve[name], strict=True)) for name in curve if name != "epoch"}
    return learning_curves(losses, value=value, step=step, total=steps[-1])


def _pulses(name: str, own: _Shown) -> go.Figure:
    return own.curves.draw(name, own.display)


def _residuals(own: _Shown) -> go.Figure:
    return residuals(own.fold.test.pulse, own.curves.predictions, own.display, filled=own.curves.band)


OF_A_TEST: dict[str, Callable[[_Shown], go.Figure]] = {
    **{name: partial(_pulses, name) for name in PULSES},
    "residuals": _residuals,
    "scores": _scores,
    "rating": _rating,
    "bias parts": _bias_parts,
    "training": _training,
    "fine-tuning": _fine_tuning,
}
"""Those of pulses; predictions minus the test; the four scores; what one rating is made of; the parts of the bias
expected; how the networks were trained on CAE runs and fine-tuned on tests."""
