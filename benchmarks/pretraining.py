"""Train the network of the fused prediction on simulated vehicles: ``python benchmarks/pretraining.py WEIGHTS``.

Simulates vehicles of many kinds (``many_vehicles.py``) on all cores, then trains on a GPU if there is one. In each step
some tests of each vehicle are known, most often few, and the others are predicted. The shipped weights took a minute
and a half of 16 cores for 28,672 vehicles and five minutes of an H200 for 11,000 steps. Printed are mean errors on
vehicles that are not trained on, in units of 15/s times the impact speed, with 1, 3 and 8 known tests. The file's
SHA-256 belongs into ``crashfuse/approaches/pretrained.py``.
"""

import argparse
import hashlib
import math
import os
from pathlib import Path

import numpy as np
import torch
from joblib import Parallel, delayed
from many_vehicles import AT_ONCE, TESTS, Pulses, pulses
from safetensors.torch import save_file
from torch import Tensor

from crashfuse.approaches.pretrained import PretrainedNetwork
from crashfuse.approaches.pretrained_tuning import losses

_FIRST_SEED = 40_000_000
_KNOWN, _OFTEN = (1, 2, 3, 4, 6, 8, 10, 12), (0.2, 0.18, 0.15, 0.13, 0.12, 0.1, 0.07, 0.05)
_UNSEEN = 512  # vehicles kept for judging
_RATE, _WARM_UP, _LEAST = 1.2e-3, 500, 0.02
_AVERAGED = 10  # steps between those whose weights are averaged
_LOOKS = 12


def main() -> None:
    """Simulate, train, write the weights."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("weights", type=Path)
    arguments.add_argument("--vehicles", type=int, default=28_672)
    arguments.add_argument("--steps", type=int, default=11_000)
    arguments.add_argument("--batch", type=int, default=256, help="vehicles of a step")
    arguments.add_argument("--workers", type=int, default=os.cpu_count())
    chosen = arguments.parse_args()
    firsts = range(_FIRST_SEED, _FIRST_SEED + chosen.vehicles, AT_ONCE)
    parts = Parallel(chosen.workers)(delayed(pulses)(first) for first in firsts)
    data = Pulses(*(np.concatenate(own) for own in zip(*parts, strict=True)))
    print(f"{len(data.cae)} of {chosen.vehicles} vehicles can be used.")
    network = _trained(data, chosen.steps, chosen.batch)
    save_file({name: weight.half().contiguous() for name, weight in network.state_dict().items()}, chosen.weights)
    print("SHA-256", hashlib.sha256(chosen.weights.read_bytes()).hexdigest())


def _trained(data: Pulses, steps: int, batch: int) -> PretrainedNetwork:
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    arrays = [torch.from_numpy(own).to(device) for own in data]
    network = PretrainedNetwork().to(device)
    average = {name: weight.clone() for name, weight in network.state_dict().items()}
    optimiser = torch.optim.AdamW(network.parameters(), lr=_RATE, betas=(0.9, 0.98), weight_decay=0.02)
    n = len(data.cae) - _UNSEEN
    print("| step | with 1 known test: first, mean, band, raw CAE | with 3 | with 8 |\n|---:|---|---|---|")
    for step in range(1, steps + 1):
        share = _LEAST + (1 - _LEAST) * 0.5 * (1 + math.cos(math.pi * step / steps))
        optimiser.param_groups[0]["lr"] = _RATE * min(1, step / _WARM_UP) * share
        chosen = torch.randint(0, n, (batch,), device=device)
        known = _some(batch, int(rng.choice(_KNOWN, p=_OFTEN)), device)
        loss = losses(network, [own[chosen].float() for own in arrays], known).total
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        if torch.isfinite(torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)):
            optimiser.step()
        if step % _AVERAGED == 0:
            kept = min(0.97, step / (step + 50))
            for name, weight in network.state_dict().items():
                average[name].lerp_(weight, 1 - kept)
        if step % max(1, steps // _LOOKS) == 0:
            print(f"| {step} | {_judged(network, arrays)} |", flush=True)
    network.load_state_dict(average)
    print(f"| averaged | {_judged(network, arrays)} |")
    return network


def _some(n: int, known: int, device: torch.device, generator: torch.Generator | None = None) -> Tensor:
    """Which tests of each vehicle are known."""
    return (torch.rand(n, TESTS, generator=generator).argsort(1) < known).to(device)


@torch.no_grad()
def _judged(network: PretrainedNetwork, arrays: list[Tensor]) -> str:
    cells = []
    for n in (1, 3, 8):
        known = _some(_UNSEEN, n, arrays[0].device, torch.Generator().manual_seed(n))
        parts = zip(*(torch.split(own[-_UNSEEN:].float(), 128) for own in arrays), torch.split(known, 128), strict=True)
        means = torch.stack([torch.stack(losses(network, own, told)) for *own, told in parts]).mean(0)
        cells.append(", ".join(f"{loss:.4f}" for loss in means.tolist()))
    return " | ".join(cells)


if __name__ == "__main__":
    main()
