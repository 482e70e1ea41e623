"""crashfuse: fuse CAE crash pulses with a handful of physical tests, and prove how good the result is.

>>> import crashfuse
>>> campaign = crashfuse.load_campaign("sample_data")
>>> study = crashfuse.run_study(campaign, held_out=["T09"])
>>> study.fold("T09").ratings["displacement_domain"][60.0]
"""

import lazy_loader

# The public names and their homes stand in __init__.pyi. Each is imported when it is first asked for: rating two
# pulses must not wait for torch.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
