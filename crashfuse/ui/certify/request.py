"""What every tab of the Certify page shows: verdicts, and what they were asked with."""

from collections.abc import Hashable
from dataclasses import dataclass

import streamlit as st

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.certification.certify import Certification, is_computed
from crashfuse.certification.changes import Changes
from crashfuse.certification.criteria import Criteria, criteria_text
from crashfuse.certification.matrix import Matrix
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Watch
from crashfuse.reporting.certification_changes import changes_table
from crashfuse.reporting.certification_record import certification_json
from crashfuse.reporting.certification_tables import csv_as_given, matrix_table
from crashfuse.reporting.plots.display import Display
from crashfuse.reporting.report import certification_report
from crashfuse.reporting.verdicts import Verdicts, certify
from crashfuse.study.config import StudyConfig
from crashfuse.ui.kit.computation import Request, said_of
from crashfuse.ui.kit.files import download_bytes, download_report, download_table


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


@dataclass(frozen=True)
class CertificationRequest(Request[Verdicts]):
    """Judge criteria at the conditions of a matrix, by the first approach of the settings."""

    campaign: Campaign
    criteria: Criteria
    matrix: Matrix
    config: StudyConfig

    @property
    def key(self) -> Hashable:  # noqa: D102
        config = self.config
        settings = config.approaches[0], config.preset, config.seed, config.device
        return "certification", said_of(self.campaign), self.criteria, self.matrix, settings

    @property
    def title(self) -> str:  # noqa: D102
        return f"{self.campaign.name}: verdicts at {len(self.matrix.ids)} conditions"

    def work(self, watch: Watch) -> Verdicts:  # noqa: D102
        approach = self.config.approaches[0]
        return certify(self.campaign, self.criteria, self.matrix, approach=approach, config=self.config, watch=watch)

    def in_cache(self) -> bool:  # noqa: D102
        return is_computed(self.campaign, self.criteria, self.matrix, self.config, Cache())


def show_files(judgement: Judgement) -> None:
    """Offer them; criteria and matrix ask for the same again."""
    verdicts, certification = judgement.verdicts, judgement.certification
    of = certification.campaign.name
    with st.container(horizontal=True):
        download_bytes("certification.csv", lambda: csv_as_given(verdicts.table), of)
        download_table("track_record.csv", lambda: verdicts.track_record, of)
        if certification.since is not None:
            download_bytes("changes.csv", lambda: csv_as_given(changes_table(Changes.of(certification))), of)
        download_bytes("criteria.toml", lambda: criteria_text(certification.criteria).encode(), of)
        download_bytes("matrix.csv", lambda: csv_as_given(matrix_table(certification.matrix)), of)
        download_bytes("certification.json", lambda: certification_json(certification), of)
        download_report(lambda: certification_report(certification, judgement.display, judgement.notes), of)
