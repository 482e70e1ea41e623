"""Rendering of a report's template with its own values and those common to all reports, and common sections."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Literal, get_args

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from crashfuse.approaches.registry import CLASSES, LABELS
from crashfuse.campaign import Campaign
from crashfuse.campaign_folder.notes import Note
from crashfuse.crash_test import CrashTest
from crashfuse.errors import one_of, require_a, several
from crashfuse.results import fit_explanations
from crashfuse.results.campaign import campaign_result
from crashfuse.results.display import Display
from crashfuse.results.drawing import Drawing
from crashfuse.results.plots.palette import VERDICT_COLOURS
from crashfuse.results.provenance import provenance
from crashfuse.results.render.figure_files import (
    HEIGHT_PX,
    FiguresOfReport,
    Report,
    ReportFigure,
    contents_of,
    embedded,
    file_name,
)
from crashfuse.results.render.text import spreadsheet_text
from crashfuse.results.result import Figure, Result
from crashfuse.results.result_tables import (
    metrics_shown,
)
from crashfuse.results.table import Table
from crashfuse.study.config import StudyConfig
from crashfuse.study.estimate import Estimate
from crashfuse.study.facts import Fact
from crashfuse.units import joined


@cache
def _templates(display: Display) -> Environment:
    templates = Environment(
        loader=PackageLoader("crashfuse.results.render"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: display.words(value) if hasattr(value, "in_units") else value,
    )
    templates.filters["tabbed"] = partial(spreadsheet_text, display=display)
    templates.filters["shown"] = partial(_shown, display=display)
    return templates


def _shown(table: Table, display: Display) -> pd.DataFrame:
    """A table's headings and cells: what stands out in bold, no line broken within an interval."""
    shown = {
        heading: [Markup("<b>{}</b>").format(cell.unbroken) if cell.is_marked else cell.unbroken for cell in cells]
        for heading, (_, cells) in table.cells(display).items()
    }
    return pd.DataFrame(shown, dtype=object)


def report(result: Result, display: Display | None = None) -> Report:
    """The report of a result as one file, by default in the units of its campaign."""
    display = Display(system=result.campaign.units) if display is None else display
    pages = _Page(display, contents_of(result, display), [figure.draw for figure in result.all_figures()])
    return pages.render(result.template or result.kind.replace(" ", "_"), result=result, **_common(result, display))


def render(
    template: str,
    title: str,
    campaign: Campaign,
    config: StudyConfig,
    command: str,
    display: Display,
    held_out: Sequence[str] = (),
    answers: Sequence[str] = (),
    **own: object,
) -> Report:
    """The complete file, from a report's template and values; the command is the one that reproduces it."""
    data = campaign_result(campaign)
    plain = Result(
        kind="", title=title, campaign=campaign, config=config, command=lambda _: command, held_out=tuple(held_out),
        parts={"data": (data,)}, answer=tuple(answers),
    )  # fmt: skip
    more: dict[str, Any] = _common(plain, display) | own
    return render_in_frame(template, f"{campaign.name}: {title}", display, facts=plain.facts, answers=answers, **more)


def _common(result: Result, display: Display) -> dict[str, object]:
    """What the templates of all reports take besides the result itself."""
    campaign, config = result.campaign, result.config
    record = provenance(campaign, result.held_out, config)
    return {
        "campaign": campaign,
        "config": config,
        "data": next(iter(result.parts.get("data", ())), None),
        "methods": [(CLASSES[name].label, CLASSES[name].description) for name in config.approaches],
        "origin": {
            "Command": result.command(display.system),
            "Campaign fingerprint (SHA-256)": campaign.fingerprint,
            **({"Archive of past vehicles": record["archive"]} if record["archive"] else {}),
            "crashfuse": record["crashfuse"],
            "Python, platform": f"{record['python']}, {record['platform']}",
            "Packages": _listed(record["packages"]),
            "Seed and settings": _listed(record["config"]),
        },
        "shown_otherwise": ""
        if display.unit == "g" and not display.deceleration
        else f"Shown in {display.unit}{', braking positive' * display.deceleration}; files have g and the data's sign.",
    }


class _Page:
    """What a template places figures with: ids are numbered, so that equal results give equal files."""

    def __init__(self, display: Display, contents: FiguresOfReport, draws: Sequence[object]) -> None:
        self.display, self.contents, self.draws = display, contents, [*draws]

    def place(self, figure: Figure) -> Markup:
        """Where the page draws a figure of the result."""
        number = self.draws.index(figure.draw)
        return self.numbered(number + 1)

    def numbered(self, number: int) -> Markup:
        """Where the page draws the figure of this number, the first is 1."""
        drawn = self.contents.figures[number - 1]
        style = f"height: {drawn.drawn['layout'].get('height', HEIGHT_PX)}px; width: 100%"
        place = Markup('<div><div id="figure-{}" class="plotly-graph-div" data-name="{}" style="{}"></div></div>')
        return place.format(number, file_name(number, drawn.title), style)

    def render(self, template: str, **values: object) -> Report:
        """The complete file."""
        common: dict[str, object] = {
            "title": self.contents.title,
            "notices": self.contents.notices,
            "answers": self.contents.answers,
        }
        common |= {"figure": self.place, "data_of_report": partial(embedded, self.contents)}
        common |= {"verdict_colours": VERDICT_COLOURS, "plotly": Markup(get_plotlyjs())}  # noqa: S704
        html = _templates(self.display).get_template(f"{template}.html.j2").render(common | values)
        return Report(html, self.contents)


def render_in_frame(
    template: str,
    title: str,
    display: Display,
    *,
    facts: Sequence[Fact] = (),
    cautions: Sequence[str] = (),
    answers: Sequence[str] = (),
    **own: object,
) -> Report:
    """The complete file of a report that has nothing but its frame in common with the others."""
    figures, notices = list[ReportFigure](), [*(fact.sentence for fact in facts), *cautions]
    told, answered = (tuple(map(display.words, texts)) for texts in (notices, answers))
    contents = FiguresOfReport(title, told, tuple(fact.label for fact in facts), figures, answered)
    page = _Page(display, contents, [])

    def words(heading: str | Sequence[str]) -> str:
        return display.words(heading) if isinstance(heading, str) else " ".join(map(display.words, heading))

    def figure(drawing: Drawing | Figure, *headings: str | Sequence[str], is_answer: bool = False) -> Markup:
        if isinstance(drawing, Figure):
            headings, drawing = (drawing.title,), drawing.draw(display)
        figures.append(ReportFigure.of(": ".join(map(words, headings)) or title, drawing, is_answer=is_answer))
        return page.numbered(len(figures))

    placed: dict[str, object] = {"figure": figure, "notices": notices, "answers": answers}
    return page.render(template, **own | placed)


def _listed(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_listed(own)}" for name, own in value.items())
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def details(
    campaign: Campaign,
    estimates: Sequence[Estimate],
    test: CrashTest | None = None,
    *,
    said: Sequence[str] = (),
) -> dict[str, object]:
    """Metrics by approach (and of the test), the main ones and the others; notes not ``said`` yet; their fits."""
    columns = [] if test is None else [("Measured", campaign.metrics_of(test))]
    columns += [(LABELS[estimate.approach], estimate.metrics) for estimate in estimates]
    of_test = "" if test is None else f", {test.id}"  # on paper the table may begin a page
    metrics, more_metrics = metrics_shown(columns, campaign, f"Pulse metric{of_test}")
    missing, more_missing = fit_explanations.metric_remarks(columns)
    makers = fit_explanations.notes_by_makers(estimates).items()
    remarks = [joined([", ".join(who), note], ": ") for note, who in makers if note not in said]
    return {
        "whole": fit_explanations.whole_sentences(estimates),
        "metrics": metrics,
        "more_metrics": more_metrics,
        "more_missing": more_missing,
        "remarks": [*missing, *remarks],
        "fits": [
            (LABELS[estimate.approach], sentences, fit_explanations.fit_table(estimate.approach, estimate.state))
            for estimate in estimates
            if (sentences := fit_explanations.fit_sentences(estimate.state))
        ],
    }


ReportForm = Literal["short", "whole"]
REPORT_FORMS: tuple[ReportForm, ...] = get_args(ReportForm)


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """Form and content of a report; a UsageError if there is no such form.

    Parameters
    ----------
    form : {"whole", "short"}
        Short: two or three pages with result, recommendation, ratings, and the test that was predicted worst.
    tests : tuple of str
        Tests that are shown one by one; none: the worst in a short report, every test in a whole one.
    notes : tuple of Note
        On the campaign's tests; those with a time are drawn on the figures over time.
    """

    form: ReportForm = "whole"
    tests: tuple[str, ...] = ()
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        one_of("form of a report", self.form, dict.fromkeys(REPORT_FORMS))
        object.__setattr__(self, "tests", several(self.tests))
        for note in self.notes:
            require_a(Note, note, "crashfuse.Note(test, text)")
