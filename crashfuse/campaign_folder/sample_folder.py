"""Where the sample campaign lies: shipped with the program, or written once into the cache folder."""

import tempfile
from pathlib import Path

from crashfuse.execution.cache import default_folder

SHIPPED = Path(__file__).parents[2] / "sample_data"


def sample_folder() -> Path:
    """The folder of the sample campaign, which is written first if it is not shipped."""
    if (SHIPPED / "tests.csv").is_file():
        return SHIPPED
    folder = _in_the_cache()
    if not (folder / "tests.csv").is_file():
        from crashfuse.synthetic import write_sample

        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
            write_sample(Path(scratch) / "sample")
            (Path(scratch) / "sample").rename(folder)  # all or nothing
    return folder


def is_sample(folder: Path) -> bool:
    """True if a folder is the sample's own or lies inside it: it is never changed."""
    folder = folder.resolve()
    return bool({folder, *folder.parents} & {SHIPPED.resolve(), _in_the_cache().resolve()})


def _in_the_cache() -> Path:
    return default_folder() / "sample"
