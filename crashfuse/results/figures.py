"""Figures by name: of a campaign, of a study and a test in it, of predicted pulses and whatever is put beside them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, Unpack

import numpy as np

from crashfuse.approaches.base import Prediction
from crashfuse.approaches.cae import Cae
from crashfuse.approaches.calibration import LEVELS
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain, measured_bias
from crashfuse.approaches.displacement_domain.events import cae_events
from crashfuse.approaches.registry import LABELS, by_preference
from crashfuse.cae.model import CaeModel, cae_pulses
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.condition import Condition
from crashfuse.crash_test import CrashTest
from crashfuse.errors import UsageError, one_of, printable, require_a, several
from crashfuse.execution.run import Run
from crashfuse.results.display import Display, DisplayOptions
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots import displacement, learning, pulses, ratings
from crashfuse.results.plots.conditions import condition_space
from crashfuse.results.plots.curves import LegendName, add_marks, by_speed, curve_line
from crashfuse.results.plots.palette import added_test_line
from crashfuse.signals.metrics import Metric
from crashfuse.study.config import StudyConfig, require_rated
from crashfuse.study.estimate import Estimate
from crashfuse.study.study import Fold, Study

T = TypeVar("T")
Draw = Callable[[], Drawing]

RUN = "cae:"  # may stand before the id of a CAE run, and must where a test has the same id
ONE_PROCESS = "The paper's bias model is one Gaussian process; only the fast settings split it into parts."

_FOLDED = "10px,3px"  # dashes of the pulse if a test folds as the one that stands apart
_STEP_M = 0.004  # grid of the parts of a bias
_BEYOND = 1.1  # times the CAE model's crush; the held-out test, which may go further, must not influence it
_ACCELERATIONS = ("motion", "acceleration")  # figures that begin with acceleration over time


class OtherPrediction(Protocol):
    """A prediction at another condition, or with other settings."""

    @property
    def text(self) -> str:
        """How it differs, in few words: equal for equal ones."""

    def curve(self, display: Display) -> tuple[str, Estimate]:
        """Its name in a legend, and itself."""


Further = str | OtherPrediction
"""What a figure shows beside its curves: a test or CAE run by its id, or another prediction."""

LEFT_OUT = {"test": "left out alone", "speed group": "all at its speed left out"}
WITH_GROUP = "left out with its speed group"


@dataclass(frozen=True, eq=False)
class EarlierPrediction:
    """An approach's estimate with some settings, beside those with others."""

    estimate: Estimate
    config: StudyConfig
    shown: StudyConfig  # of the figure that it is put into: its name says in what its own differ from them

    @property
    def text(self) -> str:
        """In what its settings differ, in words."""
        return otherwise(self.config, self.shown)

    def curve(self, _: Display | None = None) -> tuple[str, Estimate]:
        """Its name in a legend, ``Fused, seed 1`` say, and itself."""
        return ", ".join(filter(None, [LABELS[self.estimate.approach], self.text])), self.estimate


def how_left_out(way: str) -> str:
    """How a test was left out: alone, or with its speed group."""
    return LEFT_OUT["test"] if way == "test" else WITH_GROUP


def otherwise(config: StudyConfig, shown: StudyConfig) -> str:
    """In what settings differ from others: ``paper settings, seed 1, left out alone``."""
    left_out = LEFT_OUT.get(config.leave_out, config.leave_out)
    words = {"preset": f"{config.preset} settings", "seed": f"seed {config.seed}", "leave_out": left_out}
    return ", ".join(text for name, text in words.items() if getattr(config, name) != getattr(shown, name))


def pulse_figures(
    test: CrashTest | None, shown: Mapping[str, Prediction], band: str | None, display: Display
) -> dict[str, Draw]:
    """What draws each figure of pulses, of a test and of predictions by name."""
    return {
        "motion": lambda: pulses.motion(test, shown, display, filled=band),
        "acceleration": lambda: pulses.overlay(test, shown, display, filled=band),
        "displacement": lambda: displacement.over_displacement(test, shown, display, filled=band, crush=_crush(shown)),
        "energy": lambda: displacement.energy_over_crush(test, shown, filled=band),
        "integration": lambda: displacement.integration_check(test, shown),
    }


def _crush(shown: Mapping[str, Prediction]) -> dict[str, Metric]:
    metrics = {name: own.metrics for name, own in shown.items() if isinstance(own, Estimate)}
    return {name: metric for name, own in metrics.items() for metric in own if metric.name == "max_crush"}


def campaign_figure(
    campaign: Campaign,
    figure: str,
    *,
    tests: Sequence[str],
    held_out: str | None,
    cfc: float | None,
    also: Sequence[Further],
    **options: Unpack[DisplayOptions],
) -> Drawing:
    """A figure of a campaign, see :meth:`Campaign.plot`."""
    display = Display.of(campaign.units, **options)
    shown = [campaign.test(test) for test in several(tests) or campaign.test_ids]
    further = beside(campaign, also, display)
    speeds_mps = _speeds(campaign)
    tests_by_speed = by_speed(shown, display, speeds_mps=speeds_mps)
    marked = by_speed(shown, display, highlight=held_out, speeds_mps=speeds_mps)

    def bias() -> Drawing:
        model = CaeModel().fit(campaign.cae, Run.of(campaign))
        return displacement.bias_by_speed(marked, {test.id: measured_bias(test, model) for test in shown}, display)

    def cae_and_test() -> Drawing:
        test = campaign.test(held_out) if held_out else shown[0]
        (accel_mps2,) = cae_pulses(campaign.cae, [test.condition], Run.of(campaign))
        return pulses.motion(test, {Cae.name: Prediction(test.condition, accel_mps2)}, display)

    figures: dict[str, Draw] = {
        "tests": lambda: pulses.measured_pulses(marked, display, cfc=cfc, further=further),
        "conditions": lambda: condition_space(campaign.cae, shown, held_out=held_out, display=display),
        "cae": lambda: pulses.library_band(campaign.cae, tests_by_speed, display, further=further),
        "cae and test": cae_and_test,
        "bias": bias,
        "wall": lambda: pulses.wall_forces([own for own in tests_by_speed if own[0].wall is not None]),
        "cae events": lambda: displacement.missing_force(cae_events(campaign, display.window_ms), display, held_out),
    }
    draw = one_of("figure of a campaign", figure, figures)
    if cfc is not None and figure != "tests":
        raise UsageError("A filter is for the figure tests.")
    if also and figure not in ("tests", "cae"):
        raise UsageError("Further curves are for the figures tests and cae.")
    if held_out is not None:
        campaign.test(held_out)
    return draw()


def overview(study: Study, figure: str, approaches: Sequence[str] | None, **options: Unpack[DisplayOptions]) -> Drawing:
    """A figure of all held-out tests, see :meth:`Study.plot`."""
    names = chosen({name: name for fold in study.folds for name in fold.ratings}, approaches)
    window_ms = _rated(study, _display(study, options))

    def asked(by_approach: Mapping[str, T]) -> dict[str, T]:
        return {name: by_approach[name] for name in by_approach if name in names}

    def heatmap() -> Drawing:
        overall = {
            fold.held_out: {name: rated[window_ms].overall for name, rated in asked(fold.ratings).items()}
            for fold in study.folds
        }
        return ratings.rating_heatmap(overall)

    def spread() -> Drawing:
        drawn = {test: asked(by_approach) for test, by_approach in study.rating_spread(window_ms).items()}
        if not any(drawn.values()):
            raise UsageError("None of these approaches has a band to draw pulses from.")
        return ratings.rating_spread(drawn)

    def calibration() -> Drawing:
        return ratings.calibration_curves(LEVELS, asked(study.reliability))

    figures: dict[str, Draw] = {"ratings": heatmap, "draws": spread, "calibration": calibration}
    return one_of("figure of a whole study", figure, figures)()


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
) -> Drawing:
    """A figure of one held-out test, see :meth:`Study.plot`."""
    require_a(bool, measured, "measured=False leaves the test out")
    require_a(bool, corridors, "corridors=True shades them")
    for note in notes:
        require_a(Note, note, "crashfuse.Note(test, text)")
    fold, display = study.fold(held_out), _display(study, options)
    estimates = chosen({estimate.approach: estimate for estimate in fold.estimates}, approaches, band)
    further = beside(study.campaign, also, display)
    test = fold.test if measured else None
    shown = {**estimates, **other_fold(estimates, band), **further}

    def scores() -> Drawing:
        window_ms = _rated(study, display)
        return ratings.rating_parts({name: fold.ratings[name][window_ms] for name in estimates})

    def rating() -> Drawing:
        name = by_preference(estimates)[0]
        explanation = fold.explained(name, _rated(study, display))
        return ratings.rated_curves(explanation, name, display, further)

    figures: dict[str, Draw] = {
        **pulse_figures(test, shown, band, display),
        "residuals": lambda: pulses.residuals(fold.test, shown, display, filled=band),
        "scores": scores,
        "rating": rating,
        "bias parts": lambda: _bias_parts(study, fold, display, measured=measured),
        "training": lambda: _losses(
            _state(estimates, "learning_curve")["learning_curve"], "Mean square error", "Epoch"
        ),
        "fine-tuning": lambda: _fine_tuning(_state(estimates, "left_out_rmse", "tuning_curve")),
    }
    draw = one_of("figure of a held-out test", figure, figures)
    if corridors and figure not in _ACCELERATIONS:
        raise UsageError(f"Corridors stand in the figures {' and '.join(_ACCELERATIONS)}, not in {figure}.")
    drawing = draw()
    if corridors:
        pulses.add_corridors(drawing, fold.test.pulse, display)
    if figure in (*_ACCELERATIONS, "residuals"):
        add_marks(drawing, [note for note in notes if note.test == held_out])
    return drawing


def _display(study: Study, options: DisplayOptions) -> Display:
    return Display.of(study.campaign.units, max(study.config.windows_ms), **options)


def _rated(study: Study, display: Display) -> float:
    require_rated("study", display.window_ms, study.config.windows_ms)
    return display.window_ms


def _bias_parts(study: Study, fold: Fold, display: Display, *, measured: bool) -> Drawing:
    config, test = study.config, fold.test
    if config.preset == "paper":
        raise UsageError(ONE_PROCESS)
    unfitted, campaign = DisplacementDomain(seed=config.seed), config.training_campaign(study.campaign, test.id)
    domain, _ = unfitted.fitted(campaign, Run.of(campaign))
    grid = np.arange(0.0, _BEYOND * domain.model_.loading_curve(test.condition).phase.crush_m, _STEP_M)
    bias = measured_bias(test, domain.model_) if measured else None
    return displacement.bias_parts(domain.bias_parts(test.condition, grid), grid, bias, display)


def _state(estimates: Mapping[str, Estimate], *keys: str) -> dict[str, Any]:
    for name in by_preference(estimates):
        if any(key in estimates[name].state for key in keys):
            return estimates[name].state
    raise UsageError(f"None of these approaches trained a network like that: {', '.join(estimates)}.")


def _fine_tuning(state: dict[str, Any]) -> Drawing:
    if "tuning_curve" in state:
        return _losses(state["tuning_curve"], "Loss", "Step")
    return learning.tuning_strength(state["rmse"], state["left_out_rmse"], str(state["penalty"]))


def _losses(curve: dict[str, list[float]], value: str, step: str) -> Drawing:
    steps = [int(number) for number in curve["epoch"]]
    losses = {name.replace("_", " "): list(zip(steps, curve[name], strict=True)) for name in curve if name != "epoch"}
    return learning.learning_curves(losses, value=value, step=step, total=steps[-1])


def chosen(known: Mapping[str, T], approaches: Sequence[str] | None, band: str | None = None) -> dict[str, T]:
    """What is known by approach, of those asked for, by default all; a UsageError for others."""
    if band is not None:
        one_of("prediction by", band, known)
    names = known if approaches is None else several(approaches)
    return {name: one_of("prediction by", name, known) for name in names}


def beside(campaign: Campaign, also: Sequence[Further], display: Display) -> dict[str, Prediction]:
    """Further pulses by legend name; a UsageError if there is no such test or CAE run."""
    return dict(_further(campaign, asked, display) for asked in several(also))


def single_tests(estimate: Estimate) -> dict[str, Prediction]:
    """An approach's pulses that look like tests, in either way that tests fold, by legend name."""
    line, label = curve_line(estimate.approach), LABELS[estimate.approach]
    lines = line, {**line, "dash": _FOLDED}
    return {
        LegendName.of(f"{label}{name}", own): Prediction(estimate.condition, accel)
        for (name, accel), own in zip(estimate.representative.items(), lines, strict=False)
    }


def other_fold(estimates: Mapping[str, Estimate], band: str | None) -> dict[str, Prediction]:
    """The pulse by the approach whose band is filled if a test folds as one apart, by name."""
    approach = next(iter([band] if band in estimates else by_preference(estimates)), None) or ""
    prediction = estimates[approach] if approach else None
    if prediction is None or not prediction.folds_mps2:
        return {}
    name = f"{LABELS[approach]} if it folds as {prediction.apart_as}"
    line, (_, accel) = {**curve_line(approach), "dash": _FOLDED}, prediction.folds_mps2
    return {LegendName.of(name, line): Prediction(prediction.condition, accel)}


def pulse_name(of: str, condition: Condition, display: Display) -> str:
    """Name of a test or CAE run in a legend."""
    run = f"CAE run {of.removeprefix(RUN)}" if of.startswith(RUN) else of
    return f"{run} · {display.speed(condition.speed_mps)}"


def prediction_name(approach: str, condition: Condition, display: Display) -> str:
    """Name of a prediction at another condition in a legend."""
    return f"{LABELS[approach]} at {display.words(condition.brief)}"


def _further(campaign: Campaign, asked: Further, display: Display) -> tuple[str, Prediction]:
    if not isinstance(asked, str):
        if not hasattr(asked, "curve"):
            raise UsageError(f"Shown beside are ids and predictions, not {printable(repr(asked), 60)}.")
        return asked.curve(display)
    run = asked.removeprefix(RUN)
    if asked in campaign.test_ids:
        test = campaign.test(asked)
        condition, accel_mps2 = test.condition, test.pulse.accel_mps2
        label = pulse_name(asked, condition, display)
        return LegendName.of(label, added_test_line(asked, _speeds(campaign))), Prediction(condition, accel_mps2)
    if run not in campaign.cae.ids:
        tests = ", ".join(campaign.test_ids)
        raise UsageError(f"{campaign.name} has no test and no CAE run {run!r}; its tests are {tests}.")
    number = campaign.cae.ids.index(run)
    condition, accel_mps2 = campaign.cae.conditions[number], campaign.cae.accel_mps2[number].astype(float)
    return pulse_name(RUN + run, condition, display), Prediction(condition, accel_mps2)


def _speeds(campaign: Campaign) -> dict[str, float]:
    """Speeds of all tests; those left out of use must not change the others' colours."""
    unused = {test: condition.speed_mps for test, condition in campaign.unused}
    return unused | {test.id: test.condition.speed_mps for test in campaign.tests}
