"""MkDocs hook: each notebook in docs/notebooks becomes a page, run from top to bottom in a Jupyter kernel of its own.

The notebooks are kept without outputs. What a cell shows when the site is built is what its page shows: figures stay
interactive, drawn by our own copy of plotly.js. The notebook itself is beside its page, to be downloaded.
"""

import html
import os
import re
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import nbformat
import plotly.graph_objects as go
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from plotly.offline import get_plotlyjs

_SCRIPT = "notebooks/plotly.min.js"
_STRICT = """
import warnings
warnings.simplefilter("error")
warnings.filterwarnings("ignore", module="ipykernel")
"""  # run before the first cell, and not shown
_FIGURE = "application/vnd.plotly.v1+json"
_MARK = "<!-- figure {} -->"
_COLOURS = re.compile(r"\x1b\[[\d;]*m")  # of a terminal
_LONGEST_S = 600  # for one cell

_DOWNLOAD = """
[Download this notebook]({name}), and run it where `python -m pip install crashfuse jupyterlab` was run. All that it
shows below was computed when this page was built.
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and the script that draws their figures."""
    for file in [file for file in files if file.src_uri.endswith(".ipynb")]:
        page = file.src_uri.removesuffix(".ipynb") + ".md"
        files.append(File.generated(config, page, content=_markdown(Path(str(file.abs_src_path)))))
    files.append(File.generated(config, _SCRIPT, content=get_plotlyjs()))
    return files


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Put the figures in, which neither Markdown nor the search has to read."""
    source = Path(config.docs_dir, page.file.src_uri).with_suffix(".ipynb")
    if not source.is_file():
        return output
    for number, figure in enumerate(_figures(executed(source.read_text(encoding="utf-8"), source.name))):
        output = output.replace(_MARK.format(number), _drawn(figure, number))
    return output.replace("</head>", '<script src="plotly.min.js"></script></head>')


@cache
def executed(text: str, name: str) -> nbformat.NotebookNode:
    """Run a notebook in an empty folder; an error, a warning, or anything on its standard error stops the build."""
    notebook: nbformat.NotebookNode = nbformat.reads(text, as_version=4)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(_STRICT))
    environment = {**os.environ, "PLOTLY_RENDERER": "plotly_mimetype"}
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(notebook, timeout=_LONGEST_S, resources={"metadata": {"path": folder}})
        client.extra_arguments = ["--log-level=ERROR"]
        client.coalesce_streams = True
        try:
            client.execute(env=environment)
        except CellExecutionError as error:
            raise PluginError(f"{name}: {_COLOURS.sub('', str(error))}") from None
    del notebook.cells[0]
    for output in _outputs(notebook):
        if output.get("name") == "stderr":
            raise PluginError(f"{name} writes to its standard error: {output.text}")
    return notebook


def _markdown(path: Path) -> str:
    """The page of a notebook: its text, its code, and what each cell shows, with marks for the figures."""
    parts, figures = [], 0
    for cell in executed(path.read_text(encoding="utf-8"), path.name).cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source.replace(".ipynb)", ".md)"))  # a link to another notebook leads to its page
            if len(parts) == 1:  # below the heading
                parts.append(_DOWNLOAD.format(name=path.name))
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            if _FIGURE in output.get("data", {}):
                parts.append(f'<div class="shown">{_MARK.format(figures)}</div>')
                figures += 1
            else:
                parts.append(f'<div class="shown">{_html(output)}</div>')
    return "\n\n".join(parts)


def _html(output: nbformat.NotebookNode) -> str:
    """What a cell shows, as HTML; a table on one line, for a blank one would end it in Markdown."""
    if output.output_type == "stream":
        return _preformatted(output.text)
    if output.output_type == "error":
        return _preformatted("\n".join(output.traceback))
    if "text/html" in output.data:
        return re.sub(r"<style.*?</style>", "", output.data["text/html"], flags=re.DOTALL).replace("\n", " ")
    return _preformatted(output.data["text/plain"])


def _preformatted(text: str) -> str:
    return f"<pre>{html.escape(_COLOURS.sub('', text)).rstrip()}</pre>"


def _drawn(figure: dict[str, Any], number: int) -> str:
    """A figure that can be zoomed; its data go nowhere."""
    config = {"displaylogo": False, "showSendToCloud": False, "responsive": True}
    drawn = go.Figure(figure["data"], figure["layout"])
    return str(drawn.to_html(full_html=False, include_plotlyjs=False, div_id=f"figure-{number}", config=config))


def _outputs(notebook: nbformat.NotebookNode) -> Iterator[nbformat.NotebookNode]:
    yield from (output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs)


def _figures(notebook: nbformat.NotebookNode) -> Iterator[dict[str, Any]]:
    yield from (output.data[_FIGURE] for output in _outputs(notebook) if _FIGURE in output.get("data", {}))
