"""The simulated lumped-parameter vehicle behind the sample campaign; not a real car."""

from crashfuse.synthetic.sample import TABLE_1, sample_campaign, write_sample
from crashfuse.synthetic.specimens import CAE_MODEL, TRUTH, cae_pulses, measured_pulses
from crashfuse.synthetic.vehicle import Coupling, Crash, CrushZone, Vehicle, simulate

__all__ = [
    "CAE_MODEL",
    "TABLE_1",
    "TRUTH",
    "Coupling",
    "Crash",
    "CrushZone",
    "Vehicle",
    "cae_pulses",
    "measured_pulses",
    "sample_campaign",
    "simulate",
    "write_sample",
]
