"""The command `crashfuse import` hands on what it is told, and prints what was done."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from nptdms import ChannelObject

from crashfuse import cli
from crashfuse.campaign_folder.condition_tables import read_conditions
from crashfuse.units import KPH
from tests.cli.conftest import Shell, run
from tests.importing.crash_files import german
from tests.importing.crashes import clock, half_sine_g
from tests.readers import test_tdms


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A table as a German laboratory writes it: semicolons, decimal commas."""
    path = tmp_path / "Versuch 7.csv"
    path.write_bytes(german(clock(), half_sine_g(clock())))
    return path


def test_a_foreign_table_becomes_a_test_of_a_new_campaign(source: Path, tmp_path: Path, shell: Shell) -> None:
    """Condition from the options, steps on the terminal and in campaign.toml, pulse from contact on."""
    out = tmp_path / "campaign"
    condition = ["--speed-kph", 56, "--mass-kg", 1500, "--front-share", 0.6]
    said = shell.prints("import", source, "--out", out, "--id", "V7", *condition, "--channel-filter-class", "none")
    assert "Added: 1 test (" in said
    assert "V7: 34.8 mph (56.0 km/h)" in said
    assert "[[imported]]" in (out / "campaign.toml").read_text()
    (written,) = read_conditions(out / "tests.csv").conditions
    np.testing.assert_allclose(written.vector, [56 * KPH, 900.0, 600.0], rtol=1e-6)
    assert (out / "tests" / "V7.csv").exists() or (out / "tests" / "V7.parquet").exists()


def test_all_that_is_missing_is_asked_for_at_once(tmp_path: Path, shell: Shell) -> None:
    """Speed, weights, channel and unit: a line each that names the option, and nothing is left for a second round."""
    wave = {"wf_increment": 1e-4, "wf_start_offset": -0.05}
    channels = [ChannelObject("Car", name, half_sine_g(clock()), properties=wave) for name in ("CH1", "CH2")]
    source, out = tmp_path / "car.tdms", tmp_path / "campaign"
    source.write_bytes(test_tdms.written(channels))
    said = shell.wrong_data("import", source, "--out", out).splitlines()
    assert said[-1] == "4 problems found."
    for line, options in zip(said[:4], ("--speed-kph", "--front-weight-kg", "--channel", "--unit"), strict=True):
        assert options in line
    given = ["--speed-kph", 56, "--front-weight-kg", 950, "--rear-weight-kg", 750, "--channel", "CH1", "--unit", "g"]
    printed = shell.prints("import", source, "--out", out, *given)
    assert "Choose one of 2 channels; none states its unit." in printed


def test_tables_columns_and_condition_are_asked_for_at_once(tmp_path: Path, shell: Shell) -> None:
    """Two accelerations, no speed, no weights: one message, and its options, with values, are all it takes."""
    source, out = tmp_path / "car.csv", tmp_path / "campaign"
    rows = [f"{t:.4f},{a:.4f},{a:.4f}" for t, a in zip(clock(), half_sine_g(clock()), strict=True)]
    source.write_text("\n".join(["Time  (s),Acc   X left (g),Acc   X right (g)", *rows]))
    said = shell.wrong_data("import", source, "--out", out)
    option = "--channel 'Acc X left (g)'"
    for asked in ("3 problems found.", f"choose ({option})", "(--speed-kph V,", "--front-share)"):
        assert asked in said
    given = f'{option} --speed-kph 56 --mass-kg 1700 --front-share 0.56 --out "{out}"'
    assert "Channels chosen by the user: Acc X left (g)." in shell.prints("import", source, *shlex.split(given))


def test_the_sign_of_deceleration_is_an_option(source: Path, tmp_path: Path, shell: Shell) -> None:
    """A sign that the record contradicts is refused, with the option to remove."""
    command = ["import", source, "--out", tmp_path / "c", "--speed-kph", 56, "--mass-kg", 1500, "--front-share", 0.6]
    assert "remove --deceleration-sign" in shell.wrong_data(*command, "--deceleration-sign", "positive")
    assert run(*command, "--deceleration-sign", "negative") == cli.DONE
