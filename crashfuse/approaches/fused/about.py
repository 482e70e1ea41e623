"""What the mixture says of itself: known without PyTorch, which takes seconds to import."""

from crashfuse.approaches.base import Approach
from crashfuse.approaches.displacement_domain.approach import DisplacementDomain
from crashfuse.approaches.time_domain.about import AboutTimeDomain


class AboutFused(Approach):
    """All that is shown of the fused approach."""

    name = "fused"
    label = "Fused"
    in_words = "the fused prediction"
    description = (
        "time domain, displacement domain, a network pre-trained on simulated vehicles and raw CAE, averaged with "
        "weights that left-out tests decide (by CRPS) and narrow bands increase; the band is the mixture's."
    )
    colour = "#009E73"
    preference = 10
    trains_networks = True
    made_of = (AboutTimeDomain, DisplacementDomain)
