"""Which files belong to a result of each kind."""

RESULT_FILES = {
    "series of studies": ("studies.csv",),
    "study": ("study.json", "scores.csv", "speed_groups.csv", "pulses.csv", "metrics.csv", "report.html"),
    "prediction": ("prediction.json", "pulses.csv", "pulses.parquet", "metrics.csv", "report.html", "isomme/**/*"),
    "sweep": ("sweep.csv", "report.html"),
    "ranking of next tests": ("next_tests.csv", "report.html"),
}
"""By the kind of result: the file that it is recognised by, then patterns of the others, of which some may be missing.

Every command that writes, cleans or names the files of a folder of results goes by this list.
"""
