"""A terminal: commands as a user types them, and what they print."""

from dataclasses import dataclass

import pytest

from crashfuse import cli
from tests.conftest import Capture


def run(*arguments: object) -> int:
    """The exit code of a command."""
    return cli.main([str(argument) for argument in arguments])


@dataclass(frozen=True)
class Shell:
    """Runs commands that have to end in one way, and reads what they print."""

    capsys: Capture

    def prints(self, *arguments: object) -> str:
        """What a command says that does its work."""
        assert run(*arguments) == cli.DONE
        return self.capsys.readouterr().out

    def wrong_usage(self, *arguments: object) -> str:
        """What a command complains of that asks for what there is not."""
        assert run(*arguments) == cli.WRONG_USAGE
        return self.capsys.readouterr().err

    def wrong_data(self, *arguments: object) -> str:
        """What a command complains of whose data are wrong."""
        assert run(*arguments) == cli.WRONG_DATA
        return self.capsys.readouterr().err

    def no_command(self, *arguments: object) -> str:
        """What the parser complains of, before anything is computed or a server starts."""
        with pytest.raises(SystemExit) as ended:
            run(*arguments)
        assert ended.value.code == cli.WRONG_USAGE
        return self.capsys.readouterr().err


@pytest.fixture
def shell(capsys: Capture) -> Shell:
    """The terminal of this test."""
    return Shell(capsys)
