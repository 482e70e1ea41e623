"""Study: every test left out in turn, alone and with all others at about the same speed."""

from crashfuse.ui import study
from crashfuse.ui.kit import frame

study.show(frame.enter_with_campaign("Study", lambda view: f"{len(view.campaign.tests)} tests, each left out in turn"))
