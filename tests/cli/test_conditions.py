"""Numbers on the command line."""

import pytest

from crashfuse import cli
from tests.conftest import Capture

PREDICT = ["predict", "c", "--out", "o", "--front-weight-kg", "950", "--rear-weight-kg", "700"]


@pytest.mark.parametrize("text", ["56,5", "much", "nan", "inf"])
@pytest.mark.parametrize(
    "command",
    [
        [*PREDICT, "--speed-kph"],
        [*PREDICT, "--speed-kph", "56", "--start-ms"],
        ["import", "x.csv", "--out", "c", "--mass-kg"],
        ["import", "x.csv", "--out", "c", "--channel-filter-class"],
        ["rate", "a.csv", "b.csv", "--windows-ms"],
        ["study", "c", "--out", "o", "--windows-ms"],
    ],
)
def test_a_text_that_is_no_number_is_wrong_usage(command: list[str], text: str, capsys: Capture) -> None:
    """The last line names the option and what was given, a decimal comma too; nothing of how it is parsed."""
    with pytest.raises(SystemExit) as ended:
        cli.main([*command, text])
    assert ended.value.code == cli.WRONG_USAGE
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert command[-1] in said
    assert said.endswith(f"must be a number with a decimal point, if any, not {text!r}")


def test_a_seed_is_a_whole_number(capsys: Capture) -> None:
    """Neither a fraction nor a word."""
    with pytest.raises(SystemExit):
        cli.main(["train", "c", "--out", "o", "--seed", "1.5"])
    assert "must be a whole number, between 0 and 4294967295, not '1.5'" in capsys.readouterr().err
