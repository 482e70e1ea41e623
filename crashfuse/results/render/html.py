"""Rendering of a report's template with its own values and those common to all reports, and common sections."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal, get_args

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from crashfuse.approaches.registry import CLASSES
from crashfuse.campaign_folder.notes import Note
from crashfuse.errors import one_of, require_a, several
from crashfuse.results.display import Display
from crashfuse.results.plots.palette import VERDICT_COLOURS
from crashfuse.results.provenance import provenance
from crashfuse.results.render.figure_files import HEIGHT_PX, FiguresOfReport, Report, contents_of, embedded, file_name
from crashfuse.results.render.text import spreadsheet_text
from crashfuse.results.result import Result
from crashfuse.results.result_tables import about_cells
from crashfuse.results.table import Table


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
    shown = {
        heading: [Markup("<b>{}</b>").format(cell.unbroken) if cell.is_marked else cell.unbroken for cell in cells]
        for heading, (_, cells) in table.cells(display).items()
    }
    return pd.DataFrame(shown, dtype=object)


def report(result: Result, display: Display | None = None) -> Report:
    """The report of a result as one file, by default in the units of its campaign."""
    display = result.usual_display if display is None else display
    contents, draws = contents_of(result, display), [figure.draw for figure in result.all_figures()]
    values: dict[str, object] = {
        "result": result,
        "title": contents.title,
        "notices": contents.notices,
        "answers": contents.answers,
        # numbered, so that equal results give equal files
        "figure": lambda figure: Markup().join(_place(draws.index(draw) + 1, contents) for draw in figure.drawn),
        "data_of_report": partial(embedded, contents),
        "verdict_colours": VERDICT_COLOURS,
        "plotly": Markup(get_plotlyjs()),  # noqa: S704 - a library's script
    }
    template = _templates(display).get_template(f"{result.template or result.kind.replace(' ', '_')}.html.j2")
    return Report(template.render(values | _of_campaign(result, display)), contents)


def _place(number: int, contents: FiguresOfReport) -> Markup:
    drawn = contents.figures[number - 1]
    style = f"height: {drawn.drawn['layout'].get('height', HEIGHT_PX)}px; width: 100%"
    place = Markup('<div><div id="figure-{}" class="plotly-graph-div" data-name="{}" style="{}"></div></div>')
    return place.format(number, file_name(number, drawn.title), style)


def _of_campaign(result: Result, display: Display) -> dict[str, object]:
    campaign, config = result.campaign, result.config
    if campaign is None:
        return {}
    record = provenance(campaign, result.held_out, config)
    stated = about_cells(campaign.cae.about)
    return {
        "campaign": campaign,
        "config": config,
        **{name: next(iter(result.parts.get(name, ())), None) for name in ("data", "bias")},
        "methods": [(CLASSES[name].label, CLASSES[name].description) for name in config.approaches],
        "origin": {
            "Command": result.command(display.system),
            "Campaign fingerprint (SHA-256)": campaign.fingerprint,
            **{f"{name} of the CAE runs": stated.get(name, "not stated") for name in ("Solver", "Version")},
            "CAE runs: conditions and pulses (SHA-256)": record["cae_sha256"],
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


def _listed(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_listed(own)}" for name, own in value.items())
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


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
