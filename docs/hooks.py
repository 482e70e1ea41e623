"""MkDocs hooks for what Markdown lacks: equations as MathML, which needs no script, and the command line's own help."""

import html
import re

from latex2mathml.converter import convert

from crashfuse.cli import parser

_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_HELP = re.compile(r"^<!-- help (\S+) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Insert the help of a command where a page asks for it."""
    return _HELP.sub(lambda found: f"```text\n{_help(found[1])}\n```", markdown)


def on_page_content(content: str, **_: object) -> str:
    """Convert LaTeX to MathML."""
    return _EQUATION.sub(
        lambda found: convert(html.unescape(found[2]), display="block" if found[1] == "div" else "inline"), content
    )


def _help(command: str) -> str:
    (commands,) = (action.choices for action in parser()._actions if isinstance(action.choices, dict))
    return str(commands[command].format_help()).strip()
