"""The figures of a report come out as files that other programs read."""

import io
import json
import re
import struct
import threading
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from xml.etree import ElementTree

import plotly.graph_objects as go
import pytest

from crashfuse.errors import CrashfuseError, DataError, UsageError
from crashfuse.results.render import figure_files as module
from crashfuse.results.render.figure_files import (
    FiguresOfReport,
    ReportFigure,
    embedded,
    figure_files,
    missing_for,
    read_figures,
)

needs_browser = pytest.mark.skipif(bool(missing_for(("pptx",))), reason=missing_for(("pptx",)))


def drawn(name: str, height: int) -> go.Figure:
    """A figure of one curve."""
    return go.Figure(go.Scatter(x=[0, 1], y=[0, 1], name=name), {"height": height, "showlegend": True})


TABLE = (("Planned test", "Answer"), ("M1", "skip"))


def report_of(*figures: go.Figure, titles: Sequence[str] = ("Result", "Result: By test", "Limits")) -> FiguresOfReport:
    drawn = zip(titles, figures, strict=False)
    content = [ReportFigure(t, json.loads(f.to_json()), "Time (ms),Test\n0,1\n", t == "Limits") for t, f in drawn]
    notices, labels = ("It is odd.", "Made up & small."), ("T9 stands apart", "Made up")
    told = ("Skip one.",), TABLE, ("Odd: so.",), ("None wrong.", "Not sealed.")
    return FiguresOfReport("Tiny: a study", notices, labels, tuple(content), *told)


REPORT = report_of(drawn("a </script> <b", 300), drawn("c", 500), drawn("d", 400))


def written(report: FiguresOfReport, folder: Path) -> Path:
    """A report as a file, with other scripts around its data."""
    path = folder / "report.html"
    path.write_text(f"<h1>x</h1><script>figures</script>{embedded(report)}<script>run()</script>", encoding="utf-8")
    return path


def test_figures_are_read_from_the_data_of_a_report(tmp_path: Path) -> None:
    """As they were, whatever they say; of what the page says or runs nothing."""
    path = written(REPORT, tmp_path)
    assert read_figures(path) == REPORT
    assert path.read_text(encoding="utf-8").count("</script>") == 3


BEGIN = b'<script type="application/json" id="report">'


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "no figure"),
        (b"<h1>Nothing here</h1>", "no figure"),
        (b"\xff\xfe\x00", "cannot be read as one"),
        (BEGIN + b'{"figures": [{"x": 1', "cannot be read as one"),
        (BEGIN + b'{"figures": [{"x": 1}]}</script>', "cannot be read as one"),
        (BEGIN + b'{"title": "x"}</script>', "cannot be read as one"),
        (BEGIN + b"[" * 100_000 + b"</script>", "cannot be read as one"),
        (None, "no such file"),
    ],
)
def test_what_is_no_report_is_one_sentence(tmp_path: Path, content: bytes | None, found: str) -> None:
    """Empty, another page, not text, damaged, other data, nested without end, not there."""
    if content is not None:
        (tmp_path / "report.html").write_bytes(content)
    with pytest.raises(DataError, match=found):
        read_figures(tmp_path / "report.html")


@needs_browser
@pytest.mark.slow
def test_figures_become_files_in_every_format() -> None:
    import pptx

    files = figure_files(REPORT, ("svg", "png", "csv", "pptx"))
    names = ["01-result", "02-result-by-test", "03-limits"]
    assert set(files) == {f"{name}.{kind}" for name in names for kind in ("svg", "png", "csv")} | {"figures.pptx"}
    assert files["03-limits.csv"] == b"Time (ms),Test\n0,1\n"
    svg = ElementTree.fromstring(files["02-result-by-test.svg"])  # noqa: S314 - our own
    assert (svg.get("width"), svg.get("height")) == ("960", "500")
    assert "c" in [element.text for element in svg.iter("{http://www.w3.org/2000/svg}text")]
    png = files["02-result-by-test.png"]
    assert png.startswith(b"\x89PNG")
    assert struct.unpack(">II", png[16:24]) == (1920, 1000)
    slides = pptx.Presentation(io.BytesIO(files["figures.pptx"])).slides
    titles = ["Skip one.", "What it rests on", "Limits", "Result", "Result: By test"]
    assert [slide.shapes.title.text for slide in slides] == titles
    assert slides[1].shapes[-1].text_frame.text == "None wrong.\nNot sealed."
    _, below, pulse, table, notices = slides[0].shapes
    assert pulse.left + pulse.width <= table.left, "a narrow table stands beside the figure that answers"
    assert (below.text_frame.text, notices.text_frame.text) == (
        "Tiny: a study",
        "It is odd.\nMade up & small.\nOdd: so.",
    )
    assert tuple(tuple(cell.text for cell in row.cells) for row in table.table.rows) == TABLE
    for slide in list(slides)[2:]:
        (picture,) = [shape for shape in slide.shapes if hasattr(shape, "image")]
        assert picture.left >= 0
        assert picture.top + picture.height <= 7.5 * 914400
        assert "Made up" in [shape.text_frame.text for shape in slide.shapes if shape.has_text_frame][-1]
    assert next(shape for shape in slides[4].shapes if hasattr(shape, "image")).image.blob == png


@needs_browser
@pytest.mark.slow
def test_drawing_reaches_no_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing that a figure names is fetched, not even from this machine; what the browser would goes to no proxy."""
    asked: list[str] = []

    class Server(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_error(404)

        def do_CONNECT(self) -> None:
            self.do_GET()

        def log_message(self, *_: object) -> None:
            return

    with HTTPServer(("127.0.0.1", 0), Server) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        assert module._NO_NETWORK == "127.0.0.1:9"
        monkeypatch.setattr(module, "_NO_NETWORK", here := f"127.0.0.1:{server.server_port}")
        place = {"xref": "paper", "yref": "paper", "sizex": 1, "sizey": 1}
        images = [{**place, "source": f"http://{host}/mine.png"} for host in (here, "crash.test")]
        linked = {"type": "scatter", "x": [0, 1], "y": [0, 1], "name": f'<a href="http://{here}/mine">c</a>'}
        figures = [
            go.Figure([linked], {"images": images, "showlegend": True}),
            go.Figure([{"type": "image", "source": f"http://{here}/mine.jpg"}]),
        ]
        files = figure_files(read_figures(written(report_of(*figures), tmp_path)), ("svg",))
        with pytest.raises(CrashfuseError, match="did not draw"):  # a map, which would be fetched
            figure_files(report_of(go.Figure([{"type": "scattergeo", "lon": [0], "lat": [0]}])), ("svg",))
        server.shutdown()
        thread.join()
    assert not [path for path in asked if "mine" in path or "json" in path]
    assert len(files) == 2
    assert not any("<a" in svg.decode() for svg in files.values())


def test_what_a_format_needs_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="svg, png, csv, pptx, not as pdf"):
        figure_files(REPORT, ("pdf",))  # type: ignore[arg-type]
    monkeypatch.setattr(module, "_browser", lambda: None)
    with pytest.raises(UsageError, match="Chrome, Chromium or Edge, and none was found"):
        figure_files(REPORT, ("svg",))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "pptx" else object())
    with pytest.raises(UsageError, match=re.escape('python -m pip install ".[pptx]"')):
        figure_files(REPORT, ("pptx",))
