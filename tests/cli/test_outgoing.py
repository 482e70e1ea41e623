"""Pulses for an occupant model, as the commands predict and sweep write them."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

from crashfuse import cli
from crashfuse.cli.arguments import parser
from crashfuse.cli.output import pulse_export
from crashfuse.results.render import figure_files
from crashfuse.units import MS, G
from tests.cli.conftest import Shell, run
from tests.conftest import not_none

WEIGHTS = ["--front-weight-lb", "2060", "--rear-weight-lb", "1520"]
LSDYNA = ["--export", "lsdyna", "--unit-system", "mm-ms-kg"]


def names(folder: Path) -> set[str]:
    """The files in a folder and below, by relative path."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_predict_exports_the_pulse_that_stands_in_its_table(
    campaign_on_disk: Path, tmp_path: Path, shell: Shell
) -> None:
    """In the units, with the sign and the id that were asked for; a later export leaves nothing of an earlier one."""
    command = ["predict", campaign_on_disk, "--speed-mph", 30, *WEIGHTS, "--out", tmp_path]
    command += ["--approach", "displacement_domain", "--deceleration-sign", "positive", "--curve-id", 90]
    everything = ["--export", "lsdyna", "radioss", "isomme", "--unit-system", "mm-ms-kg", "--draws", 2]
    said = shell.prints(*command, *everything, "--isomme-location", "11SEATLERE00")
    assert said.endswith("metrics.csv, report.html, isomme/, lsdyna/, radioss/, prediction.json\n")
    for folder, suffix in (("lsdyna", ".k"), ("radioss", ".inc")):
        assert len([name for name in names(tmp_path / folder) if name.endswith(suffix)]) == 4
    assert len(list((tmp_path / "isomme").iterdir())) == 4 + 2
    assert "11SEATLERE00ACXS" in next((tmp_path / "isomme").rglob("*.001")).read_text(encoding="latin-1")

    lines = (tmp_path / "lsdyna" / "displacement_domain_30mph_expected.k").read_text(encoding="ascii").splitlines()
    assert any(line.startswith("        90         0") for line in lines)
    points = np.array([list(map(float, line.split())) for line in lines[-1253:-1]])
    table = pd.read_csv(tmp_path / "pulses.csv")
    np.testing.assert_allclose(points[:-2, 0], table["time_ms"], rtol=1e-5)
    np.testing.assert_allclose(points[:-2, 1], -table["acceleration_g"] * G * MS, rtol=1e-4, atol=1e-8)

    assert "radioss" not in shell.prints(*command, *LSDYNA)
    assert names(tmp_path / "lsdyna") == {f"displacement_domain_30mph_{p}.k" for p in ("expected", "representative")}
    assert not (tmp_path / "radioss").exists()
    assert not (tmp_path / "isomme").exists()


@pytest.mark.slow
def test_a_sweep_exports_the_pulses_at_each_speed(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    command = ["sweep", campaign_on_disk, "--out", tmp_path, "--approach", "cae", "--speed-mph", 24.95, 27, *WEIGHTS]
    assert shell.prints(*command, *LSDYNA).endswith(f"Written to {tmp_path}: lsdyna/, report.html, sweep.csv\n")
    assert names(tmp_path / "lsdyna") == {f"{v}mph/cae_{v}mph_expected.k" for v in ("24.95", "25", "26", "27")}
    assert "25 mph" in (tmp_path / "lsdyna/25mph/cae_25mph_expected.k").read_text(encoding="ascii")
    assert run(*command) == cli.DONE
    assert names(tmp_path) == {"report.html", "sweep.csv"}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--export", "lsdyna"], "Name the units of the solver's model: --unit-system mm-ms-kg, mm-s-t"),
        (["--start-ms", "5"], "--start-ms is about curves of a solver; add --export lsdyna"),
        ([*LSDYNA, "--isomme-location", "10VEHC000000"], "add --export isomme"),
        ([*LSDYNA, "--scale", "0"], "scaled by a number above 0"),
        ([*LSDYNA, "--draws", "-2"], "0 or more"),
        ([*LSDYNA, "--draws", "2"], "no draws of cae"),
        (["--isomme-location", "VEHC"], "12 digits and capitals"),
    ],
)
def test_an_export_that_is_impossible_is_one_sentence(
    campaign_on_disk: Path, tmp_path: Path, options: list[str], sentence: str, shell: Shell
) -> None:
    command = ["predict", campaign_on_disk, "--speed-mph", 30, *WEIGHTS, "--out", tmp_path / "out"]
    assert sentence in shell.wrong_usage(*command, "--approach", "cae", *options)
    assert not (tmp_path / "out").exists()


def test_draws_of_a_sweep_need_a_format(campaign_on_disk: Path, tmp_path: Path, shell: Shell) -> None:
    command = ["sweep", campaign_on_disk, *WEIGHTS, "--out", tmp_path / "out", "--draws", 3]
    assert "name their format with --export" in shell.wrong_usage(*command)


def test_a_curve_starts_and_is_scaled_as_asked() -> None:
    command = f"predict X --speed-mph 30 {' '.join(WEIGHTS)} --out Y {' '.join(LSDYNA)} --start-ms 25 --scale 1.2"
    curve = not_none(pulse_export(parser().parse_args(command.split())).curve)
    assert (curve.start_s, curve.scale, curve.number) == (0.025, 1.2, 1)


@pytest.fixture
def report(tmp_path: Path) -> Path:
    """A report with one figure."""
    figure = figure_files.ReportFigure("Result", json.loads(go.Figure(go.Scatter(x=[0, 1], y=[0, 1])).to_json()), "")
    path = tmp_path / "report.html"
    path.write_text(figure_files.embedded(figure_files.FiguresOfReport("Tiny", (), (), (figure,))), encoding="utf-8")
    return path


def test_each_figure_becomes_a_file_in_each_format(
    report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    """SVG and PNG unless others are asked for; all that was written is listed."""
    monkeypatch.setattr(figure_files, "missing_for", lambda _: "")
    monkeypatch.setattr(figure_files, "_images", lambda figures, kinds: {k: [k.encode()] * len(figures) for k in kinds})
    out = tmp_path / "out"
    assert shell.prints("figures", report, "--out", out) == f"Written to {out}: 01-result.svg, 01-result.png\n"
    written = {path.name: path.read_bytes() for path in out.iterdir()}
    assert written == {"01-result.svg": b"svg", "01-result.png": b"png"}


def test_what_cannot_be_drawn_is_one_sentence(
    report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    """No report, no extra, a file where a folder should be; nothing is written."""
    monkeypatch.setattr(figure_files, "_browser", lambda: "chromium")
    out = ["--out", tmp_path / "out"]
    none = "none.html: expected a report.html of crashfuse with figures, found no such file"
    assert none in shell.wrong_data("figures", tmp_path / "none.html", *out)
    assert "Not a folder, but a file, is" in shell.wrong_usage("figures", report, "--out", report)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert 'python -m pip install ".[figures]"' in shell.wrong_usage("figures", report, *out)
    assert not (tmp_path / "out").exists()
