"""Why another program's score differs: ``python benchmarks/score_differences.py``.

The sample's tests T09 (reference) and T10 are rated by ISO/TS 18571, then with one thing changed at a time. With
``--data`` the table is written to ``score_differences.csv``.
"""

import argparse
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from tables import add_data_option, write

from crashfuse.campaign_folder.load import load_campaign
from crashfuse.signals import rating
from crashfuse.signals.pulse import DT_S, FloatArray, Pulse
from crashfuse.signals.rating import RATING_DT_S, rate_iso18571
from crashfuse.units import MS

_END_S, _LONG_S, _REST_S = 60 * MS, 100 * MS, 20 * MS
_SHARE = 0.05  # of the reference's peak


def _between(pulse: Pulse, start_s: float, end_s: float) -> FloatArray:
    """The curve at 10 kHz, at rest before contact."""
    time_s = np.arange(start_s, end_s - 1e-9, RATING_DT_S)
    return np.asarray(np.interp(time_s, pulse.time_s, pulse.accel_mps2, left=0.0))


def _overall(reference: Pulse, comparison: Pulse, start_s: float = 0.0, end_s: float = _END_S) -> str:
    first, second = (_between(pulse, start_s, end_s) for pulse in (reference, comparison))
    return f"{rate_iso18571(first, second, dt_s=RATING_DT_S).overall:.3f}"


def main() -> None:
    """Rate, print and write."""
    arguments = argparse.ArgumentParser(description=__doc__)
    add_data_option(arguments)
    chosen = arguments.parse_args()
    campaign = load_campaign(Path("sample_data"))
    t09, t10 = (campaign.test(name).pulse for name in ("T09", "T10"))
    size = np.abs(t09.accel_mps2)
    start_s, end_s = t09.time_s[np.flatnonzero(size > _SHARE * size.max())[[0, -1]]].tolist()
    shown = f"here {start_s / MS:.1f}–{end_s / MS:.1f} ms"
    n = round(_END_S / DT_S)
    as_it_is = rate_iso18571(t09.accel_mps2[:n], t10.accel_mps2[:n], dt_s=RATING_DT_S)
    bands = []
    for band in (0.05, 0.2):
        with patch.object(rating, "WARP_BAND", band):
            bands.append(_overall(t09, t10))
    rows = {
        "nothing: 0–60 ms": _overall(t09, t10),
        "interval 0–40 ms": _overall(t09, t10, end_s=40 * MS),
        "interval 0–100 ms": _overall(t09, t10, end_s=_LONG_S),
        f"interval that a program chooses: where the reference exceeds 5 % of its peak, {shown}": _overall(
            t09, t10, start_s, end_s
        ),
        "20 ms of rest before contact included: −20–100 ms": _overall(t09, t10, -_REST_S, _LONG_S),
        "time zero of one of them 1 ms later": _overall(t09, Pulse(t10.time_s + 1 * MS, t10.accel_mps2)),
        "reference and comparison exchanged": _overall(t10, t09),
        "12.5 kHz taken as it is, without bringing it to 10 kHz": f"{as_it_is.overall:.3f}",
        "window of the warping 5 % or 20 % instead of 10 %": ", ".join(bands),
    }
    table = pd.DataFrame({"what is changed": rows.keys(), "overall": rows.values()})
    print(table.to_string(index=False))
    if chosen.data is not None:
        write(table, chosen.data / "score_differences.csv", "what is changed")


if __name__ == "__main__":
    main()
