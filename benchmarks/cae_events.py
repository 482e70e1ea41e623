"""Whether a known fault of a CAE model is found: random vehicles whose CAE model differs from them in one zone only.

    python benchmarks/cae_events.py [--vehicles 12] [--tests 8]

The rails of the CAE model have 15 % of the vehicle's mean force more or less over a known range of crush, and no rates;
tests scatter, and fold elsewhere, as they do in ``vehicles.py``. The sensor is on the body, so force times mass over
the body's mass is what a test shows where the change begins, and less once its joints follow.
"""

import argparse
from dataclasses import replace

import numpy as np
from vehicles import CRUSH_M, World, recorded

from crashfuse.approaches.displacement_domain.events import cae_events
from crashfuse.cae_library import CaeLibrary
from crashfuse.campaign import Campaign


def faulty(seed: int, n_tests: int) -> tuple[Campaign, tuple[float, float, float, float]]:
    """A campaign, and the range in m, the force that its CAE model lacks in N, and mass over the body's mass."""
    world, rng = World.any(seed), np.random.default_rng([seed, 48])
    middle = 0.5 * (world.range.low.vector + world.range.high.vector)
    mass = float(middle[1:].sum())
    start = rng.uniform(0.06, 0.25)
    stop = start + rng.uniform(0.06, 0.16)
    force = float(rng.choice([-1, 1]) * 0.15 * mass * 15.6**2 / 2 / 0.65)
    knots = np.sort(np.concatenate([CRUSH_M, np.array([start, stop]) - 5e-4, np.array([start, stop]) + 5e-4]))
    rails = replace(world.truth.rails, rate_mps=np.inf)
    curve = np.interp(knots, CRUSH_M, rails.force_n) - force * ((knots >= start) & (knots <= stop))
    truth = replace(world.truth, rails=rails)
    model = replace(truth, rails=replace(rails, crush_m=tuple(knots.tolist()), force_n=tuple(curve.tolist())))
    pulses = recorded([model], world.cae.conditions, None).astype(np.float32)
    library = CaeLibrary(world.cae.ids, world.cae.conditions, pulses)
    body = mass - truth.powertrain_kg - truth.rear_share * middle[2]
    world = replace(world, truth=truth, model=model, cae=library)
    return world.campaign(n_tests), (start, stop, force, mass / body)


def main() -> None:
    """One line a vehicle: what was changed, and the most expensive event."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=12)
    parser.add_argument("--tests", type=int, default=8)
    args = parser.parse_args()
    for seed in range(args.vehicles):
        campaign, (start, stop, force, ratio) = faulty(seed, args.tests)
        found = cae_events(campaign, 60.0)
        line = f"{seed:3d}: {1e3 * start:3.0f}-{1e3 * stop:3.0f} mm {force / 1e3:4.0f} kN (x {ratio:.2f})"
        if found.events:
            event = found.events[0]
            line += f" | {1e3 * event.from_m:3.0f}-{1e3 * event.to_m:3.0f} mm {event.force_n / 1e3:4.0f} kN"
            line += f" = x {event.force_n / force:.2f}, {event.conditions} {len(event.tests)}/{len(event.reached)}"
            line += f" of {len(campaign.tests)}, share {event.share:.2f}, {len(found.events)} events"
        print(
            line, f"rating {found.rating_cae:.3f} -> {found.rating_mended:.3f}, all {found.rating_all:.3f}", flush=True
        )


if __name__ == "__main__":
    main()
