"""The figures of a report as SVG, PNG, slides and CSV, drawn by Plotly in a browser that reaches no network."""

import asyncio
import importlib.util
import io
import json
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, get_args

import pandas as pd
from markupsafe import Markup

from crashfuse.errors import CrashfuseError, DataError, UsageError, refusal
from crashfuse.files.csv_text import csv_bytes
from crashfuse.results.display import Display
from crashfuse.results.drawing import drawing_table
from crashfuse.results.plots.canvas import without_links
from crashfuse.results.render.text import against_lines
from crashfuse.results.result import Figure, Result

FigureFormat = Literal["svg", "png", "csv", "pptx"]
FIGURE_FORMATS: tuple[FigureFormat, ...] = get_args(FigureFormat)

_NEEDS = {"svg": ("kaleido",), "png": ("kaleido",), "csv": (), "pptx": ("kaleido", "pptx")}  # modules, by format
_BEGIN, _END = '<script type="application/json" id="report">', "</script>"
_WIDTH_PX, HEIGHT_PX, _DENSITY = 960, 540, 2  # of a figure that states no size; pixels of a PNG for each of these
# Of the first slide: rows of its table, sentences, columns beside a figure, letters of a cell that stay in a line.
_SLIDE_ROWS, _ANSWERS, _NARROW, _UNBROKEN = 12, 4, 6, 12
_NO_NETWORK = "127.0.0.1:9"  # a proxy that is not there: browsers have services of their own that call home
_POLICY = (  # the page loads its scripts and nothing that a figure names, from this machine neither, past any proxy
    "<meta http-equiv='Content-Security-Policy' content=\"default-src 'none'; script-src file: 'unsafe-inline' "
    "'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:\">"
)
_MOST_BYTES = 256 << 20


class ReportFigure(NamedTuple):
    """A figure of a report: its heading, what Plotly draws, and its numbers as CSV."""

    title: str
    drawn: dict[str, Any]
    table: str
    is_answer: bool = False

    @classmethod
    def of(cls, figure: Figure, display: Display) -> Self:
        """A figure of a result, drawn."""
        drawing = figure.draw(display)
        drawn = json.loads(without_links(drawing.figure().to_json()))
        return cls(display.words(figure.title), drawn, csv_bytes(drawing_table(drawing)).decode(), figure.is_answer)


class FiguresOfReport(NamedTuple):
    """The figures of a report with title, notices, labels, answer, and what speaks against it."""

    title: str
    notices: tuple[str, ...]
    labels: tuple[str, ...]
    figures: Sequence[ReportFigure]
    answers: tuple[str, ...] = ()
    table: tuple[tuple[str, ...], ...] = ()  # its headings, then its rows
    against: tuple[str, ...] = ()
    evidence: tuple[str, ...] = ()  # what the answer rests on


class Report(str):
    """A report as HTML; slides are made of its ``contents``."""

    contents: FiguresOfReport

    def __new__(cls, html: str, contents: FiguresOfReport) -> Self:  # noqa: D102
        report = super().__new__(cls, html)
        report.contents = contents
        return report


def contents_of(result: Result, display: Display) -> FiguresOfReport:
    """What a report and its slides have in common."""
    figures = [ReportFigure.of(figure, display) for figure in result.all_figures()]
    notices, answers = (tuple(map(display.words, texts)) for texts in (result.notices, result.answer))
    rows = result.tables[result.shown[0]].texts(display) if result.shown else pd.DataFrame()
    left = [("…",) * rows.shape[1]] if len(rows) > _SLIDE_ROWS else []
    table = tuple(tuple(map(str, row)) for row in (rows.columns, *rows.to_numpy()[:_SLIDE_ROWS], *left) if len(rows))
    labels, doubts = tuple(fact.label for fact in result.facts), tuple(against_lines(result, display))
    others = tuple(text for text in notices if text not in answers)  # a fact may be an answer, too
    limits, evidence = (tuple(map(display.words, result.sentences.get(place, ()))) for place in ("limits", "evidence"))
    answers = (*answers[:1], *limits, *answers[1:])
    return FiguresOfReport(display.words(result.heading), others, labels, figures, answers, table, doubts, evidence)


def read_figures(path: Path) -> FiguresOfReport:
    """The figures of a report's file; a DataError if there is none, or none in it."""

    def problem(found: str) -> DataError:
        expected, advice = "a report.html of crashfuse with figures", "name the report that a command has written"
        return refusal(str(path), expected, found, advice)

    if not path.is_file():
        raise problem("no such file")
    if path.stat().st_size > _MOST_BYTES:
        raise problem(f"{path.stat().st_size >> 20} MB")
    try:
        _, begin, rest = path.read_text(encoding="utf-8").rpartition(_BEGIN)
        if not begin:
            raise problem("no figure")
        values = {"evidence": (), **json.loads(without_links(json.dumps(json.loads(rest.partition(_END)[0]))))}
        figures = tuple(ReportFigure(**figure) for figure in values["figures"])
        names = {*FiguresOfReport._fields} - {"title", "figures", "table"}
        lines = {name: tuple(map(str, values[name])) for name in names}
        table = tuple(tuple(map(str, row)) for row in values["table"])
        report = FiguresOfReport(title=str(values["title"]), figures=figures, table=table, **lines)
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise problem(f"text that cannot be read as one ({error})") from error
    if not figures:
        raise problem("no figure")
    return report


def embedded(report: FiguresOfReport) -> Markup:
    """A report's data as a part of its page, which no text can end."""
    values = report._asdict() | {"figures": [figure._asdict() for figure in report.figures]}
    return Markup(_BEGIN + json.dumps(values, separators=(",", ":")).replace("<", "\\u003c") + _END)  # noqa: S704 - escaped


def missing_for(formats: Sequence[FigureFormat]) -> str:
    """A sentence on the extra or browser that these formats lack; empty if none."""
    instead = "Or save them from the report."
    if any(importlib.util.find_spec(module) is None for form in formats for module in _NEEDS[form]):
        extra = "pptx" if "pptx" in formats else "figures"
        wanted = f'need python -m pip install ".[{extra}]" in a checkout'
        return f"Figures as {', '.join(formats)} {wanted}. {instead}"
    if any(map(_NEEDS.__getitem__, formats)) and not _browser():
        return f"Figures are drawn by Chrome, Chromium or Edge, and none was found (BROWSER_PATH names one). {instead}"
    return ""


@cache
def _browser() -> str | None:
    from choreographer.browsers.chromium import Chromium

    return os.environ.get("BROWSER_PATH") or Chromium.find_browser(skip_local=False)


def figure_files(report: FiguresOfReport, formats: Sequence[FigureFormat]) -> dict[str, bytes]:
    """The figures as files, by name: ``01-heading.svg``, ``.png``, ``.csv``; ``figures.pptx`` has all in one.

    Raises a UsageError if what a format needs is not there, a CrashfuseError if the browser fails.
    """
    if unknown := [form for form in formats if form not in FIGURE_FORMATS]:
        raise UsageError(f"A figure is written as {', '.join(FIGURE_FORMATS)}, not as {unknown[0]}.")
    if missing := missing_for(formats):
        raise UsageError(missing)
    kinds = [kind for kind in ("svg", "png") if kind in formats or (kind == "png" and "pptx" in formats)]
    made = _images([figure.drawn for figure in report.figures], kinds) if kinds else {}
    if "csv" in formats:
        made["csv"] = [figure.table.encode() for figure in report.figures]
    written = {
        f"{file_name(number, figure.title)}.{kind}": contents[number - 1]
        for number, figure in enumerate(report.figures, start=1)
        for kind, contents in made.items()
        if kind in formats
    }
    if "pptx" in formats:
        written["figures.pptx"] = _slides(report, made["png"])
    return written


def file_name(number: int, title: str) -> str:
    """The name of a figure's files, by its first heading and its last."""
    title = " ".join(dict.fromkeys(title.split(": ")[:: max(title.count(": "), 1)]))
    return f"{number:02d}-{hyphened(title.lower())[:60].strip('-') or 'figure'}"


def hyphened(text: str, marks: str = "") -> str:
    """A text as a file name of its ASCII letters, digits and such ``marks``."""
    return "-".join("".join(c if c.isascii() and (c.isalnum() or c in marks) else " " for c in text).split())


def _images(figures: Sequence[dict[str, Any]], kinds: Sequence[str]) -> dict[str, list[bytes]]:
    from choreographer.errors import BrowserClosedError, BrowserFailedError
    from kaleido import Kaleido, PageGenerator
    from kaleido.errors import JavascriptError, KaleidoError

    class Page(PageGenerator):  # type: ignore[misc]  # Kaleido has no types
        def generate_index(self) -> str:
            return str(super().generate_index()).replace("<head>", f"<head>{_POLICY}", 1)

    def options(figure: dict[str, Any], kind: str) -> dict[str, Any]:
        layout, scale = figure["layout"], _DENSITY if kind == "png" else 1
        width, height = layout.get("width") or _WIDTH_PX, layout.get("height") or HEIGHT_PX
        return {"format": kind, "width": width, "height": height, "scale": scale}

    async def drawn() -> dict[str, list[bytes]]:
        async with Kaleido(n=1, page_generator=Page(mathjax=False), proxy_server=_NO_NETWORK) as browser:
            return {kind: [await browser.calc_fig(own, opts=options(own, kind)) for own in figures] for kind in kinds}

    try:
        with ThreadPoolExecutor(1) as pool:  # there may be a loop of events in this thread
            return pool.submit(asyncio.run, drawn()).result()
    except (BrowserClosedError, BrowserFailedError, JavascriptError, KaleidoError, OSError) as error:
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        raise CrashfuseError(f"The browser {_browser()} did not draw the figures: {reason}") from error


def _slides(report: FiguresOfReport, images: Sequence[bytes]) -> bytes:
    from pptx import Presentation
    from pptx.enum.text import PP_ALIGN
    from pptx.util import Emu, Inches, Pt

    deck = Presentation()
    deck.slide_width, deck.slide_height = Inches(13.333), Inches(7.5)
    only_title = deck.slide_layouts[5]
    left, width = Inches(0.6), Inches(12.1)

    def write(shape: Any, text: str, top: float, height: float, size: int) -> None:  # noqa: ANN401 - two classes
        shape.left, shape.top, shape.width, shape.height = left, Inches(top), width, Inches(height)
        shape.text_frame.word_wrap = True
        paragraph = shape.text_frame.paragraphs[0]
        paragraph.alignment, run = PP_ALIGN.LEFT, paragraph.add_run()
        run.text, run.font.size = text, Pt(size)

    def below(slide: Any, text: str, top: float, height: float, size: int) -> None:  # noqa: ANN401 - a factory there
        if text:  # else an empty box would stand there
            write(slide.shapes.add_textbox(0, 0, 0, 0), text, top, height, size)

    def draw(slide: Any, figure: ReportFigure, image: bytes, top: float, width: float, height: float) -> None:  # noqa: ANN401
        picture = slide.shapes.add_picture(io.BytesIO(image), left, Inches(top))
        scale = min(Inches(width) / picture.width, Inches(height) / picture.height)
        picture.width, picture.height = Emu(int(picture.width * scale)), Emu(int(picture.height * scale))
        picture.left, picture.name = Emu(left + (Inches(width) - picture.width) // 2), figure.title

    first, (headline, *details) = deck.slides.add_slide(only_title), report.answers[:_ANSWERS] or ("",)
    write(first.shapes.title, headline or report.title, 0.3, 0.7, 24 if len(headline) < 70 else 18)
    below(first, report.title if headline else "", 1.0, 0.3, 14)
    below(first, "\n".join(details), 1.35, 1.0, 12)
    drawn = sorted(zip(report.figures, images, strict=True), key=lambda own: not own[0].is_answer)
    n_columns = len(next(iter(report.table), ()))
    beside = any(figure.is_answer for figure, _ in drawn) and 0 < n_columns <= _NARROW
    width_in = min(1.4 * n_columns, 7.2) if beside else 12.1
    if beside:
        draw(first, *drawn[0], 2.4, 12.0 - width_in, 3.6)
    _add_table(first, report.table, 12.7 - width_in, width_in)
    below(first, "\n".join([*report.notices, *report.against]), 6.35, 1.0, 10)
    if report.evidence:
        slide = deck.slides.add_slide(only_title)
        write(slide.shapes.title, "What it rests on", 0.3, 0.75, 20)
        below(slide, "\n".join(report.evidence), 1.3, 5.5, 16)
    for figure, image in drawn:
        slide = deck.slides.add_slide(only_title)
        write(slide.shapes.title, figure.title, 0.3, 0.75, 20)
        draw(slide, figure, image, 1.15, 12.1, 5.75)
        below(slide, ". ".join(filter(None, (report.title, *report.labels))) + ".", 6.95, 0.4, 11)
    stream = io.BytesIO()
    deck.save(stream)
    return stream.getvalue()


def _add_table(slide: Any, rows: Sequence[Sequence[str]], left: float, width: float) -> None:  # noqa: ANN401 - has no types
    from pptx.util import Inches, Pt

    if not rows:
        return
    longest = [max(map(len, (*head.split(), *texts))) for head, *texts in zip(*rows, strict=True)]
    least = [0.25 + 0.077 * min(letters, _UNBROKEN) for letters in longest]  # of a wide font
    table = slide.shapes.add_table(len(rows), len(least), *map(Inches, (left, 2.5, width, 0.25 * len(rows)))).table
    for column, narrowest, letters in zip(table.columns, least, longest, strict=True):
        column.width = Inches(narrowest + max(width - sum(least), 0) * letters / sum(longest))
    for number, row in enumerate(rows):
        table.rows[number].height = Inches(0.25)
        for cell, text in zip(table.rows[number].cells, row, strict=True):
            cell.text, cell.margin_top, cell.margin_bottom = text, 0, 0
            cell.text_frame.paragraphs[0].font.size = Pt(9)
