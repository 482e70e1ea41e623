"""What every tab of the Certify page shows: verdicts, and what they were asked with."""

from collections.abc import Hashable
from dataclasses import dataclass

from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.verdicts import Verdicts
from crashfuse.study.config import StudyConfig


@dataclass(frozen=True, eq=False)
class Judgement:
    """Verdicts, the settings behind them, and how the reader wants to see them.

    Attributes
    ----------
    notes : tuple of Note
        On the campaign's tests.
    key : Hashable
        Equal for equal verdicts: the beginning of the key of a cached figure.
    """

    verdicts: Verdicts
    config: StudyConfig
    display: Display
    notes: tuple[Note, ...]
    key: Hashable

    @property
    def certification(self) -> Certification:
        """Verdicts, record and domain in SI."""
        return self.verdicts.certification
