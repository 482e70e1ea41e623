"""A campaign as a result: what every report says of the data that it rests on."""

import pandas as pd

from crashfuse.campaign import Campaign
from crashfuse.results.result import Deferred, Figure, Result
from crashfuse.results.result_tables import about_table, archive_table, quality_table, tests_table, wall_table
from crashfuse.results.table import Table
from crashfuse.units import Sentence, counted, speed, weight
from crashfuse.vehicle_archive import record_sentence


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
        shown=("tests",),
        sentences={
            "library": (library,),
            "quality": (quality.summary, *quality.named),
            "archive": () if past.empty else (record_sentence(past),),
        },
        tables=Deferred[Table](
            tests=lambda: tests_table(campaign),
            origins=lambda: about_table(campaign),
            walls=lambda: wall_table(campaign),
            archive=lambda: archive_table(past),
            quality=lambda: quality_table(quality),
        ),
        figures={"wall": wall} if has_walls else {},
        values={"filtering": filtering},
    )
