"""A campaign as a result: what every report says of the data that it rests on."""

import pandas as pd

from crashfuse.cae.model import cae_pulses
from crashfuse.campaign import Campaign
from crashfuse.execution.cache import remembered
from crashfuse.execution.run import Run
from crashfuse.results.result import Deferred, Figure, Result
from crashfuse.results.result_tables import about_table, archive_table, quality_table, tests_table, wall_table
from crashfuse.results.table import CONDITION, Column, Table, of_condition
from crashfuse.signals.metrics import METRIC_UNITS, checked_metrics
from crashfuse.signals.pulse import DT_S, GRID_S, Pulse
from crashfuse.signals.rating import rate_windows
from crashfuse.study.config import WINDOWS_MS
from crashfuse.units import Sentence, counted, speed, weight
from crashfuse.vehicle_archive import record_sentence

_SHOWN = {"peak": "Peak", "max_crush": "Crush", "t0": "TTZV", "olc": "OLC", "sm25": "SM25"}


@remembered
def cae_errors_table(campaign: Campaign, window_ms: float = WINDOWS_MS[-1]) -> Table:
    """Metrics of each test and its CAE pulse, their differences, and the pulse's rating."""
    tests, rows = campaign.tests, []
    pulses = cae_pulses(campaign.cae, [test.condition for test in tests], Run.of(campaign))
    for test, accel_mps2 in zip(tests, pulses, strict=True):
        of_cae = checked_metrics(accel_mps2, test.condition.speed_mps, dt_s=DT_S, occupant=campaign.occupant)
        both = zip(of_cae, campaign.metrics_of(test), strict=True)
        row = {
            end: own.value for cae, measured in both for end, own in ((cae.name, cae), (f"{cae.name} test", measured))
        }
        rated = rate_windows(test.pulse, Pulse(GRID_S, accel_mps2), [window_ms])[window_ms].overall
        rows.append({"Test": test.id, "speed_mph": of_condition(test.condition)["speed_mph"], **row, "rating": rated})
    metrics = (
        Column(title, "pair", METRIC_UNITS[name], form, name, further=(f"{name} test",))
        for name, title in _SHOWN.items()
        for form in [".0f" if name == "max_crush" else ".1f"]
    )
    rating = Column(f"Rating, 0–{window_ms:g} ms", "grade", source="rating")
    return Table("CAE errors", pd.DataFrame(rows), (Column("Test"), CONDITION[0], *metrics, rating))


def campaign_result(campaign: Campaign) -> Result:
    """Tests, CAE runs and their quality, barrier forces, past vehicles."""
    speeds, front, rear = zip(*campaign.cae.range, strict=True)
    library = Sentence("CAE runs: {}, front {}, rear {}.", speed(*speeds), weight(*front), weight(*rear))
    past = pd.DataFrame() if campaign.prior is None else campaign.prior.record
    quality, cfc = campaign.quality, campaign.channel_filter_class
    filtering = "not filtered further" if cfc is None else f"filtered whole with CFC {cfc:g} (SAE J211-1)"
    has_walls = any(test.wall is not None for test in campaign.tests)
    wall = Figure("The force of the barrier", lambda display: campaign.draw("wall", display=display))
    return Result(
        kind="campaign",
        title=f"{counted(len(campaign.tests), 'test')}, {len(campaign.cae):,} CAE runs",
        campaign=campaign,
        answer=(library, f"Fingerprint {campaign.fingerprint[:12]}."),
        shown=("tests", "cae_errors"),
        sentences={
            "library": (library,),
            "quality": (quality.summary, quality.checks, *quality.named),
            "archive": () if past.empty else (record_sentence(past),),
        },
        tables=Deferred[Table](
            tests=lambda: tests_table(campaign),
            cae_errors=lambda: cae_errors_table(campaign),
            origins=lambda: about_table(campaign),
            walls=lambda: wall_table(campaign),
            archive=lambda: archive_table(past),
            quality=lambda: quality_table(quality),
        ),
        figures={"wall": wall} if has_walls else {},
        values={"filtering": filtering},
    )
