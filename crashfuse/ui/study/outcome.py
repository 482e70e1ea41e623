"""What every tab of the Study page shows: the ratings of all tests, each left out in turn."""

from collections.abc import Hashable
from dataclasses import dataclass

from crashfuse.study.config import StudyConfig
from crashfuse.study.study import Study
from crashfuse.ui import page_tables
from crashfuse.ui.chosen import View


@dataclass(frozen=True, eq=False)
class Outcome:
    """A study of all tests, and how the reader wants to see it.

    Attributes
    ----------
    view : View
        The choices in the sidebar: campaign, rated window, units.
    config : StudyConfig
        The settings that were chosen.
    study : Study
        While networks train, of fewer approaches than the settings ask for.
    request_key : Hashable
        Equal for equal data and settings.
    """

    view: View
    config: StudyConfig
    study: Study
    request_key: Hashable

    @property
    def key(self) -> Hashable:
        """Equal for equal data, settings and display, and as much that is known: the key of a cached figure."""
        ways = [way for way in (self.study, self.study.speed_groups) if way is not None]
        known = tuple((fold.held_out, *fold.ratings) for way in ways for fold in way.folds)
        return self.request_key, known, tuple(self.study.repeatability), self.view.display

    @property
    def whole(self) -> bool:
        """True once every approach is known for every test; before that, nothing can be recommended."""
        tests = len(self.study.folds) == len(self.view.campaign.tests)
        return tests and self.study.config.approaches == self.config.approaches

    @property
    def window_ms(self) -> float:
        """Length of the rated window."""
        return self.view.display.window_ms

    @property
    def window(self) -> str:
        """The rated window in words."""
        return page_tables.window_label(self.window_ms)
