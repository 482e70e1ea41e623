"""A campaign from wherever it lies: its folder, or a zip of it."""

import tempfile
from pathlib import Path

from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.folder import read_folder
from crashfuse.campaign_folder.upload import lay_out


def load_campaign(path: str | Path) -> Campaign:
    """Read and check a campaign folder, or a zip of one.

    Parameters
    ----------
    path : str or Path
        Contains ``tests.csv`` and ``cae.csv``, the pulses of each as ``<role>/<id>.csv`` (or ``.parquet``) or
        ``<role>_pulses.parquet`` (or ``.csv``), and optionally ``campaign.toml``.

    Returns
    -------
    Campaign
        All pulses on the study grid, m/s².

    Raises
    ------
    DataError
        With every problem, not only the first.
    """
    path = Path(path)
    if not (path.is_file() and path.suffix.lower() == ".zip"):
        return read_folder(path)
    with tempfile.TemporaryDirectory(prefix="crashfuse-") as scratch:
        return read_folder(lay_out([(path.name, path.read_bytes())], Path(scratch)))
