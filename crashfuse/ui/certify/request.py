"""The computation behind the Certify page."""

from collections.abc import Hashable
from dataclasses import dataclass

from crashfuse.campaign import Campaign
from crashfuse.certification.certify import is_computed
from crashfuse.certification.criteria import Criteria
from crashfuse.certification.matrix import Matrix
from crashfuse.execution.cache import Cache
from crashfuse.execution.progress import Watch
from crashfuse.reporting.verdicts import Verdicts, certify
from crashfuse.study.config import StudyConfig
from crashfuse.ui.kit.computation import Request, said_of


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
