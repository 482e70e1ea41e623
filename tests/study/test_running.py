"""What a study computes, once and in which order."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from crashfuse.approaches.cae import Cae
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.progress import Watch
from crashfuse.execution.run import Run
from crashfuse.execution.workers import Local
from crashfuse.study import running
from crashfuse.study.config import StudyConfig
from crashfuse.study.running import run_study
from crashfuse.study.study import Study

CONFIG = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(60.0,))


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.slow
def test_results_come_as_they_are_known_without_networks_first(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    """Each part holds more, with the numbers of the whole, which is the same with and without anyone who waits."""
    monkeypatch.setattr(Cae, "trains_networks", True)
    parts: list[Study] = []
    whole = run_study(campaign, CONFIG, held_out=["T1", "T2"], watch=Watch(on_part=parts.append), workers=workers)
    known = [{(fold.held_out, name) for fold in part.folds for name in fold.ratings} for part in parts]
    domain = "displacement_domain"
    assert known[0] in ({("T1", domain)}, {("T2", domain)})
    assert known[1] == {("T1", domain), ("T2", domain)}
    assert len(known[2]) == 3
    assert known[3] == {(fold.held_out, name) for fold in whole.folds for name in fold.ratings}
    assert [part.config.approaches for part in parts] == [(domain,)] * 3 + [CONFIG.approaches]
    for fold in (fold for part in parts for fold in part.folds):
        assert all(whole.fold(fold.held_out).ratings[name] == own for name, own in fold.ratings.items())
    again = run_study(campaign, CONFIG, held_out=["T1", "T2"], workers=1)
    assert [fold.ratings for fold in again.folds] == [fold.ratings for fold in whole.folds]


@pytest.mark.slow
def test_nothing_trains_before_the_only_test_is_shown(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody waits for one comparison: training would slow it down, and starting other processes takes longer."""
    monkeypatch.setattr(Cae, "trains_networks", True)
    order: list[str] = []
    prepare = Cae.prepare

    def noted(self: Cae, campaign: Campaign, conditions: Sequence[Condition], run: Run) -> None:
        order.append("training")
        prepare(self, campaign, conditions, run)

    monkeypatch.setattr(Cae, "prepare", noted)
    watch = Watch(on_part=lambda part: order.append(f"shown {len(part.config.approaches)}"))
    run_study(campaign, CONFIG, held_out=["T1"], watch=watch, workers=2)
    assert order == ["shown 1", "training", "shown 2"]


def test_nobody_else_is_asked_to_compute_a_single_fold(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without networks too: its repeatability is no second task that other processes would be started for."""
    monkeypatch.setattr(Local, "submitted", None)
    study = run_study(campaign, CONFIG, held_out=["T1"], workers=2)
    assert set(study.fold("T1").ratings) == set(CONFIG.approaches)
    assert study.repeatability["T1"]


def test_a_speed_group_of_one_test_is_that_test_alone(campaign: Campaign) -> None:
    alone = next(test_id for test_id in campaign.test_ids if len(campaign.speed_group(test_id)) == 1)
    both = run_study(campaign, replace(CONFIG, approaches=("cae",), leave_out="both"), held_out=[alone], workers=1)
    assert both.speed_groups is not None
    assert both.fold(alone) is both.speed_groups.fold(alone)


def test_predictions_from_the_same_tests_are_one_task() -> None:
    asked = ((("A",), "A"), (("A", "B"), "A"), (("A", "B"), "B"))
    wanted = [running.Wanted(out, test, name) for out, test in asked for name in CONFIG.approaches]
    assert [len(task.wanted) for task in running._tasks(wanted)] == [2, 4]
