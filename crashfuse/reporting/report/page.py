"""The pieces a report is written with: text, tables, figures, and the page around them."""

import html
import re
from collections.abc import Callable, Iterable, Mapping, Sequence

import pandas as pd
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from crashfuse.campaign import Campaign

_FIGURE = re.compile(r'id="([0-9a-f-]{36})" class="plotly-graph-div"')
_STYLE = """
body { font: 15px/1.5 system-ui, "Segoe UI", sans-serif; color: #262a33; background: #fff; max-width: 62rem;
       margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.7rem; line-height: 1.25 }
h2 { font-size: 1.25rem; margin-top: 2.2rem; border-bottom: 1px solid #d5d9e0 }
h3 { font-size: 1.05rem; margin: 1.4rem 0 .3rem }
table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #e3e6ea; text-align: right; vertical-align: top }
th:first-child, td:first-child { text-align: left }
thead th { border-bottom: 2px solid #262a33 }
table.words td { text-align: left }
table.ratings td:nth-child(2), table.ratings th:nth-child(2) { text-align: left }
.notice { background: #fff4d6; border-left: 4px solid #d9a400; padding: .6rem 1rem }
.verdict { background: #eef4f9; border-left: 4px solid #0072b2; padding: .1rem 1rem }
.quiet { color: #5a6270 }
nav { margin: 1rem 0 }
nav a { margin-right: 1.2rem }
code { overflow-wrap: anywhere }
@page { size: A4; margin: 14mm }
@media print {
  body { font-size: 10pt; margin: 0; padding: 0; max-width: none }
  nav, details { display: none }
  h2, h3 { break-after: avoid }
  table, .plotly-graph-div, .verdict { break-inside: avoid }
  table.ratings { break-inside: auto }
  tr { break-inside: avoid }
  section.test { break-before: page }
  .modebar { display: none !important }
}
"""

# Paper is narrower than the window and a page shorter than a stack of figures; afterwards all is as it was.
_PRINTING = """
const figures = () => document.querySelectorAll(".plotly-graph-div");
addEventListener("beforeprint", () => figures().forEach(figure => {
  figure.dataset.height = figure.layout.height;
  Plotly.relayout(figure, { autosize: false, width: 680, height: Math.min(figure.layout.height, 600) });
}));
addEventListener("afterprint", () => figures().forEach(figure => {
  Plotly.relayout(figure, { autosize: true, width: null, height: Number(figure.dataset.height) });
}));
"""


def page(title: str, campaign: Campaign, parts: Sequence[str]) -> str:
    """The whole file; figures are numbered, so that equal content gives equal bytes."""
    body = "".join(parts)
    for number, drawn in enumerate(dict.fromkeys(_FIGURE.findall(body)), start=1):
        body = body.replace(drawn, f"figure-{number}")
    notice = f"<p class=notice>{text(campaign.notice)}</p>" if campaign.notice else ""
    return (
        f"<!doctype html><html lang=en><head><meta charset=utf-8>"
        f"<meta name=viewport content='width=device-width'><title>{text(title)}</title><style>{_STYLE}</style>"
        f"<script>{get_plotlyjs()}</script><script>{_PRINTING}</script></head>"
        f"<body><h1>{text(title)}</h1>{notice}{body}</body></html>\n"
    )


def section(title: str, *parts: str, name: str = "", kind: str = "") -> str:
    """A part of the report under a heading, with a name to link to."""
    marks = f" id={name}" * bool(name) + f" class={kind}" * bool(kind)
    return f"<section{marks}><h2>{text(title)}</h2>{''.join(parts)}</section>"


def paragraphs(sentences: Iterable[str], kind: str = "") -> str:
    """Each on its own."""
    mark = f" class={kind}" if kind else ""
    return "".join(f"<p{mark}>{text(sentence)}</p>" for sentence in sentences)


def bullets(sentences: Iterable[str]) -> str:
    """A list."""
    return f"<ul>{''.join(f'<li>{text(sentence)}</li>' for sentence in sentences)}</ul>"


def table(frame: pd.DataFrame, *, escape: bool = True, kind: str = "") -> str:
    """A table of text and numbers as they are; ``escape=False`` for cells that hold markup of ours."""
    clean: Callable[[object], str] = text if escape else str
    head = "".join(f"<th>{text(column)}</th>" for column in frame.columns)
    body = "".join("<tr>" + "".join(f"<td>{clean(cell)}</td>" for cell in row) + "</tr>" for row in frame.to_numpy())
    mark = f" class={kind}" if kind else ""
    return f"<table{mark}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def pairs_table(rows: Mapping[str, object]) -> str:
    """Names and values below each other."""
    items = "".join(
        f"<tr><td>{text(name)}</td><td><code>{text(_listed(value))}</code></td></tr>" for name, value in rows.items()
    )
    return f"<table class=words><tbody>{items}</tbody></table>"


def _listed(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_listed(own)}" for name, own in value.items())
    if isinstance(value, list | tuple):
        return " ".join(map(str, value))
    return str(value)


def figure(drawn: go.Figure) -> str:
    """A figure that can be zoomed; Plotly itself stands once in the page."""
    markup: str = drawn.to_html(
        full_html=False, include_plotlyjs=False, config={"displaylogo": False, "responsive": True}
    )
    return markup


def text(value: object) -> str:
    """What a reader typed or computed, as text."""
    return html.escape(str(value))
