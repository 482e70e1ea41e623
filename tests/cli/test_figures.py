"""The command that writes the figures of a report as files."""

from pathlib import Path

import plotly.graph_objects as go
import pytest

from crashfuse import cli
from crashfuse.reporting import figure_files


@pytest.fixture
def report(tmp_path: Path) -> Path:
    """A report with one figure."""
    figure = go.Figure(go.Scatter(x=[0, 1], y=[0, 1]))
    drawn = figure.to_html(full_html=False, include_plotlyjs=False, div_id="figure-1")
    path = tmp_path / "report.html"
    path.write_text(f"<h1>Tiny</h1><h2>Result</h2>{drawn}", encoding="utf-8")
    return path


def test_each_figure_becomes_a_file_in_each_format(
    report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """SVG and PNG unless others are asked for; all that was written is listed."""
    monkeypatch.setattr(figure_files, "missing_for", lambda _: "")
    monkeypatch.setattr(figure_files, "_images", lambda figures, kinds: {k: [k.encode()] * len(figures) for k in kinds})
    out = tmp_path / "out"
    assert cli.main(["figures", str(report), "--out", str(out)]) == cli.DONE
    assert {path.name: path.read_bytes() for path in out.iterdir()} == {
        "01-result.svg": b"svg",
        "01-result.png": b"png",
    }
    assert capsys.readouterr().out == f"Written to {out}: 01-result.svg, 01-result.png\n"


def test_what_cannot_be_drawn_is_one_sentence(
    report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No report, no extra, a file where a folder should be; nothing is written."""
    monkeypatch.setattr(figure_files, "_browser", lambda: "chromium")
    out = ["--out", str(tmp_path / "out")]
    assert cli.main(["figures", str(tmp_path / "none.html"), *out]) == cli.WRONG_DATA
    assert "none.html: expected a report.html of crashfuse with figures, found no such file" in capsys.readouterr().err
    assert cli.main(["figures", str(report), "--out", str(report)]) == cli.WRONG_USAGE
    assert "is a file, not a folder" in capsys.readouterr().err
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert cli.main(["figures", str(report), *out]) == cli.WRONG_USAGE
    assert 'python -m pip install "crashfuse[figures]"' in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
