"""Workbooks that mean harm: refused in a sentence, in a moment and within little memory."""

import random
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from crashfuse.errors import DataError
from crashfuse.readers import table_sheet
from crashfuse.readers.tables import read_sheets
from tests.conftest import ROOT

_MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_XML = "application/vnd.openxmlformats-officedocument.spreadsheetml"
_PARTS = {
    "[Content_Types].xml": f'<Types xmlns="{_PACKAGE}/content-types">'
    '<Default Extension="xml" ContentType="application/xml"/>'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    f'<Override PartName="/xl/workbook.xml" ContentType="{_XML}.sheet.main+xml"/>'
    f'<Override PartName="/xl/sharedStrings.xml" ContentType="{_XML}.sharedStrings+xml"/></Types>',
    "_rels/.rels": f'<Relationships xmlns="{_PACKAGE}/relationships">'
    f'<Relationship Id="r1" Type="{_OFFICE}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
    "xl/workbook.xml": f'<workbook xmlns="{_MAIN}" xmlns:r="{_OFFICE}"><sheets>'
    '<sheet name="A" sheetId="1" r:id="r1"/></sheets></workbook>',
    "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{_PACKAGE}/relationships">'
    f'<Relationship Id="r1" Type="{_OFFICE}/worksheet" Target="worksheets/sheet1.xml"/>'
    f'<Relationship Id="r2" Type="{_OFFICE}/sharedStrings" Target="sharedStrings.xml"/></Relationships>',
}
_TEXT = '<c r="{}1" t="inlineStr"><is><t>{}</t></is></c>'
HEADER = f'<row r="1">{_TEXT.format("A", "Time [ms]")}{_TEXT.format("B", "g")}</row>'
MOST = 400 << 20  # bytes beyond the modules, for a workbook of a megabyte


def rows(count: int, first: int = 2) -> str:
    return "".join(
        f'<row r="{i}"><c r="A{i}"><v>{0.1 * (i - first)}</v></c><c r="B{i}"><v>{-i % 7}</v></c></row>'
        for i in range(first, first + count)
    )


def sheet(data: str, before: str = "") -> str:
    return f'<worksheet xmlns="{_MAIN}">{before}<sheetData>{HEADER}{data}</sheetData></worksheet>'


def workbook(path: Path, worksheet: str, strings: str = "") -> Path:
    """A workbook of one sheet, padded so that its parts may unpack to a hundred times their size."""
    parts = _PARTS | {
        "xl/worksheets/sheet1.xml": worksheet,
        "xl/sharedStrings.xml": f'<sst xmlns="{_MAIN}">{strings}</sst>',
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("docProps/padding.bin", random.Random(1).randbytes(1 << 20))  # noqa: S311  (no secret)
        for name, text in parts.items():
            archive.writestr(name, text)
    return path


HOSTILE: dict[str, tuple[Callable[[], str], str]] = {
    "a gap of two thousand million rows": (
        lambda: sheet(rows(9) + '<row r="2000000000"><c r="A2000000000"><v>1</v></c></row>'),
        "expected at most 500000 cells, found more",
    ),
    "an empty row far below": (lambda: sheet(rows(9) + '<row r="2000000000"/>'), "expected at most 500000 cells"),
    "a cell in the last column of each row": (
        lambda: sheet("".join(f'<row r="{i}"><c r="ZZZ{i}"><v>1</v></c></row>' for i in range(2, 99))),
        "expected at most 500000 cells, found more",
    ),
    "entities": (
        lambda: f'<!DOCTYPE l [<!ENTITY a "{"x" * 10_000}"><!ENTITY b "{"&a;" * 10_000}">]>{sheet("&b;")}',
        "expected the XML of a workbook, found more than",
    ),
    "elements within elements": (
        lambda: sheet("<a>" * 4_100_000),
        "more than 2000000 elements, or what no workbook has",
    ),
    "attributes": (lambda: sheet("<a " + 'b="" ' * 99_999 + "/>"), "more than"),
}


def test_a_gap_of_a_few_rows_is_a_gap(tmp_path: Path) -> None:
    text = sheet(rows(40) + rows(40, first=50), '<dimension ref="A1:XFD2000000000"/>')
    text = text.replace('<c r="B60"><v>3</v></c>', "", 1)
    (table,) = read_sheets(workbook(tmp_path / "gap.xlsx", text))
    assert table.columns == ("Time [ms]", "g")
    assert len(table.cells) == 88
    assert table.cells[1].tolist()[57:60] == ["4", "", "2"]
    assert table.cells[1].tolist()[39:49] == ["1", *[""] * 8, "6"]


@pytest.mark.slow
def test_each_is_refused_early(tmp_path: Path) -> None:
    """Before the rows of its gaps are made, or its elements, in one process of bounded memory and time."""
    sentences = {
        workbook(tmp_path / f"{name}.xlsx", worksheet()): sentence for name, (worksheet, sentence) in HOSTILE.items()
    }
    strings = workbook(tmp_path / "strings.xlsx", sheet(rows(9)), "<si><t/></si>" * 300_000)
    sentences[strings] = "sharedStrings.xml: expected the XML of a workbook, found more than 250000 elements"
    code = (
        "import sys; from pathlib import Path; import openpyxl, pandas, psutil\n"
        "from crashfuse.errors import DataError; from crashfuse.readers.tables import read_sheets\n"
        "if sys.platform == 'linux':\n"
        f"    import resource; most = psutil.Process().memory_info().vms + {MOST}\n"
        "    resource.setrlimit(resource.RLIMIT_AS, (most, most))\n"
        "for path in sys.argv[1:]:\n"
        "    try: read_sheets(Path(path))\n"
        "    except DataError as error: print(error)\n"
    )
    command = [sys.executable, "-c", code, *map(str, sentences)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, cwd=ROOT)
    printed = done.stdout.splitlines()
    assert len(printed) == len(sentences), done.stderr[-500:]
    for line, (path, sentence) in zip(printed, sentences.items(), strict=True):
        assert line.startswith(path.name)
        assert sentence in line


def test_too_much_in_all_sheets_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crashfuse.readers.table_sheet._MOST_CELLS_IN_ALL", 100)
    with pytest.raises(DataError, match="at most 100 cells, found more; save the sheet as CSV"):
        read_sheets(workbook(tmp_path / "t.xlsx", sheet(rows(60))))


@pytest.mark.slow
def test_a_text_of_a_hundred_thousand_columns_is_refused_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of its cells at most are tried as numbers, not each with each delimiter."""
    path, tried = tmp_path / "wide.csv", 0
    path.write_text("\n".join([",".join(["1"] * 120_000)] * 200))
    is_number = table_sheet.is_number

    def counting(cell: str, decimal: str) -> bool:
        nonlocal tried
        tried += 1
        return is_number(cell, decimal)

    monkeypatch.setattr(table_sheet, "is_number", counting)
    with pytest.raises(DataError, match="at most 2000 columns, found 120000"):
        read_sheets(path)
    assert tried < 120_000 * 200 / 10
