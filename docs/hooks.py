"""MkDocs hooks for what Markdown lacks: equations as MathML, commands' help, the documentation of public names."""

import html
import re

from latex2mathml.converter import convert
from mkdocs.structure.pages import Page

from crashfuse.cli import parser

_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_HELP = re.compile(r"^<!-- help (\S+) -->$", re.MULTILINE)
_CALLS = re.compile(r"^- `(\w+)`: .*(?:\n  .*)*$", re.MULTILINE)  # on the page of the library
_BLOCK = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)  # as public forges show equations
_INLINE = re.compile(r"\$`(.+?)`\$")


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Insert the help of commands and the documentation of public names, and mark equations as the site wants them."""
    if page.file.src_uri == "reference/library.md":
        markdown = _CALLS.sub(lambda found: _documented(found[1]) + "\n", markdown)
    markdown = _BLOCK.sub(lambda found: f"\\[\n{found[1]}\n\\]", markdown)
    markdown = _INLINE.sub(lambda found: f"\\({found[1]}\\)", markdown)
    return _HELP.sub(lambda found: f"```text\n{_help(found[1])}\n```", markdown)


def on_page_content(content: str, **_: object) -> str:
    """Convert LaTeX to MathML."""
    return _EQUATION.sub(
        lambda found: convert(html.unescape(found[2]), display="block" if found[1] == "div" else "inline"), content
    )


def _documented(name: str) -> str:
    """What mkdocstrings replaces by the documentation of a public name, one level below the headings of the page."""
    return f"::: crashfuse.{name}\n    options:\n      heading_level: 3"


def _help(command: str) -> str:
    (commands,) = (action.choices for action in parser()._actions if isinstance(action.choices, dict))
    return str(commands[command].format_help()).strip()
