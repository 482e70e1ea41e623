"""Where a campaign's tests check predictions, in words."""

from crashfuse.certification.domain import Domain
from crashfuse.wording import Sentence, joined, speed, weight

_ENDS = ", where the CAE runs end,"


def domain_sentences(domain: Domain) -> tuple[str, ...]:
    """Where the tests, left out with all others at about their speed, check predictions."""
    if not domain.speed_ranges_mps:
        return domain.too_few_tests or ("Nothing is checked: no test lies within the speeds of the CAE runs.",)
    speeds = joined([Sentence("{}", speed(*ends, between=" to ")) for ends in domain.speed_ranges_mps], " and ")
    masses = weight(*domain.checked_masses_kg, between=" to ")
    factors = "; ".join(f"{name} {', '.join(values)}" for name, values in domain.factors.items())
    slowest, fastest = (float(end[0]) for end in domain.cae.range)
    below, above = domain.speeds_mps[0] - slowest, fastest - domain.speeds_mps[-1]
    return (
        Sentence(
            f"Checked by the {domain.n_tests} tests, each left out with all others at about its speed: {{}}, front "
            "and rear weight together {}{}; and within the range of the CAE runs.",
            speeds,
            masses,
            f"; {factors}" if factors else "",
        ),
        Sentence(
            "A condition is at most {} from the nearest test, as far as left-out tests were from those that gave them "
            "a verdict; {} below the slowest{} and {} above the fastest{}.",
            speed(domain.reach_mps),
            speed(max(min(below, domain.below_mps), 0.0)),
            _ENDS * (below < domain.below_mps),
            speed(max(min(above, domain.above_mps), 0.0)),
            _ENDS.rstrip(",") * (above < domain.above_mps),
        ),
    )
