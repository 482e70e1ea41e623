"""What the pages have computed: once, for whatever list of tests it was asked first."""

import threading
from types import SimpleNamespace

import pytest

from crashfuse.campaign import Campaign
from crashfuse.execution.progress import Watch
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Fit
from crashfuse.study.study import Fold, Study
from crashfuse.ui.kit.computation import Request, _folds, fit_request, study_request
from tests.ui.conftest import SOON

CONFIG = StudyConfig(approaches=("cae",), windows_ms=(60.0,))


@pytest.fixture
def rated(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Tests whose predictions were rated, one after the other."""
    rated: list[str] = []
    rate = Fold.of

    def noted(test: object, *rest: object) -> Fold:
        rated.append(test.id)  # type: ignore[attr-defined]
        return rate(test, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(Fold, "of", noted)
    _folds().clear()
    return rated


def studied(request: Request[Study]) -> Study:
    request.start()
    job = request.find()
    assert job is not None
    assert job.wait(SOON)
    assert job.result is not None
    return job.result


@pytest.mark.slow
def test_a_fold_that_was_computed_for_one_list_of_tests_serves_another(campaign: Campaign, rated: list[str]) -> None:
    """What Train computed Compare finds at once; a longer list computes only what it has more."""
    trained = studied(study_request(campaign, ("T1", "T2"), CONFIG))
    assert study_request(campaign, ("T2",), CONFIG).in_cache()
    assert studied(study_request(campaign, ("T2",), CONFIG)).fold("T2") is trained.fold("T2")
    assert rated == ["T1", "T2"]
    longer = studied(study_request(campaign, ("T1", "T2", "T3"), CONFIG))
    assert [fold.held_out for fold in longer.folds] == ["T1", "T2", "T3"]
    assert rated == ["T1", "T2", "T3"]


@pytest.mark.parametrize("approaches", [("cae", "displacement_domain", "fused"), ("displacement_domain", "fused")])
def test_predict_has_a_first_part_of_the_answer_with_and_without_the_raw_cae_model(
    approaches: tuple[str, ...], campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The displacement domain is shown before any network is trained; the raw CAE model alone answers nothing."""

    def fit(_: object, name: str, *__: object, **___: object) -> SimpleNamespace:
        return SimpleNamespace(approach=SimpleNamespace(name=name))

    monkeypatch.setattr(Fit, "of", fit)
    monkeypatch.setattr("crashfuse.ui.kit.computation.estimates_at", lambda *_: [])
    parts: list[tuple[str, ...]] = []
    watch = Watch(lambda _: None, None, lambda part: parts.append(part.approaches))
    fit_request(campaign, StudyConfig(approaches=approaches)).work(watch)
    assert parts == [approaches[:-1], approaches]


def test_a_fold_with_other_settings_is_another(campaign: Campaign, rated: list[str]) -> None:
    """Another window is rated anew; a whole study after Compare computes the speed groups only."""
    for config in (CONFIG, StudyConfig(approaches=("cae",), windows_ms=(40.0,))):
        study = studied(study_request(campaign, ("T1",), config))
        assert list(study.fold("T1").ratings["cae"]) == list(config.windows_ms)
    assert rated == ["T1", "T1"]
    for leave_out in ("test", "both"):
        study = studied(study_request(campaign, ("T2",), StudyConfig(approaches=("cae",), leave_out=leave_out)))
        assert (study.speed_groups is None) == (leave_out == "test")
    assert rated[2:] == ["T2", "T2"]


def test_a_page_that_waits_for_what_is_kept_lets_another_visitor_go_on() -> None:
    slow, gate = threading.Event(), threading.Event()

    def in_cache() -> bool:
        slow.set()
        return not gate.wait(SOON)

    waiting = threading.Thread(target=Request("one", "", lambda _: None, in_cache).find)
    waiting.start()
    assert slow.wait(SOON)
    other = threading.Thread(target=Request("another", "", lambda _: None).find)
    other.start()
    other.join(SOON)
    assert not other.is_alive()
    gate.set()
    waiting.join(SOON)
