"""What a study computes, once and in which order."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from crashfuse.approaches.cae import Cae
from crashfuse.campaign import Campaign
from crashfuse.condition import Condition
from crashfuse.execution.progress import Watch
from crashfuse.study import tasks
from crashfuse.study.config import StudyConfig
from crashfuse.study.study import Study, run_study

CONFIG = StudyConfig(approaches=("cae", "displacement_domain"), windows_ms=(60.0,))


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.slow
def test_what_needs_no_network_is_rated_first(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    """The first part has the same numbers as the whole, which is the same with and without anyone who waits for it."""
    monkeypatch.setattr(Cae, "trains_networks", True)
    parts: list[Study] = []
    whole = run_study(campaign, CONFIG, held_out=["T1", "T2"], watch=Watch(on_first=parts.append), workers=workers)
    (first,) = parts
    assert first.config.approaches == ("displacement_domain",)
    for one, other in zip(first.folds, whole.folds, strict=True):
        assert one.ratings["displacement_domain"] == other.ratings["displacement_domain"]
    again = run_study(campaign, CONFIG, held_out=["T1", "T2"], workers=1)
    assert [fold.ratings for fold in again.folds] == [fold.ratings for fold in whole.folds]


@pytest.mark.slow
def test_nothing_trains_before_the_only_test_is_shown(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody waits for one comparison: training would slow it down, and starting other processes takes longer."""
    monkeypatch.setattr(Cae, "trains_networks", True)
    order: list[str] = []
    prepare = Cae.prepare

    def noted(self: Cae, campaign: Campaign, conditions: Sequence[Condition], watch: Watch) -> None:
        order.append("training")
        prepare(self, campaign, conditions, watch)

    monkeypatch.setattr(Cae, "prepare", noted)
    watch = Watch(on_first=lambda _: order.append("shown"))
    run_study(campaign, CONFIG, held_out=["T1"], watch=watch, workers=2)
    assert order == ["shown", "training"]


def test_a_speed_group_of_one_test_is_that_test_alone(campaign: Campaign) -> None:
    """One fold serves both."""
    alone = next(test_id for test_id in campaign.test_ids if len(campaign.speed_group(test_id)) == 1)
    both = run_study(campaign, replace(CONFIG, approaches=("cae",), leave_out="both"), held_out=[alone], workers=1)
    assert both.speed_groups is not None
    assert both.fold(alone) is both.speed_groups.fold(alone)


def test_predictions_from_the_same_tests_are_one_task() -> None:
    """They share their fits."""
    wanted = [
        tasks.Wanted(left_out, test, name)
        for left_out, test in ((("A",), "A"), (("A", "B"), "A"), (("A", "B"), "B"))
        for name in CONFIG.approaches
    ]
    assert [len(task.wanted) for task in tasks._tasks(wanted)] == [2, 4]
