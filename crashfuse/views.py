"""What data show of themselves: the tables, figures and files that rooms above make, imported when first asked for.

Their names and homes stand in ``views.pyi``. Methods such as ``study.plot`` and ``campaign.tests_frame`` go through
here, so that no module of data imports a view.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("crashfuse", __file__)
