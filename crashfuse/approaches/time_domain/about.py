"""What the networks' approaches say of themselves: known without PyTorch, which takes seconds to import."""

from crashfuse.approaches.base import Approach


class AboutLfTcn(Approach):
    """All that is shown of the LF TCN."""

    name = "lf_tcn"
    label = "LF TCN"
    in_words = "the LF TCN"
    description = (
        "the low-fidelity (LF) networks: temporal convolutional networks (TCN) trained on the CAE runs and on no test "
        "(Eq. 5)."
    )
    colour, dash = "#C871A1", "dot"
    preference = 40
    learns_from_tests = False
    trains_networks = True


class AboutTimeDomain(Approach):
    """All that is shown of the time domain."""

    name = "time_domain"
    label = "Time domain"
    in_words = "the time domain"
    description = (
        "the multi-fidelity (MF) networks: those of the LF TCN with increments of their weights learned from the "
        "tests (Eq. 6); under the fast preset in closed form, their strength chosen by leaving tests out, with the "
        "posterior, widened until it holds on left-out tests, as the band."
    )
    colour, dark_colour = "#0072B2", "#2E93D6"
    preference = 30
    trains_networks = True
