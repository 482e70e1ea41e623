"""Start of the dashboard's server in this process, so that stopping the process stops the server."""

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from click import Abort
from streamlit.web.cli import main

from crashfuse.ui import journal, login

_PACKAGE = Path(__file__).resolve().parents[1]
_PLACES = (_PACKAGE / "dashboard", _PACKAGE.parent)  # in an installed wheel, in a checkout

_HOSTS = ("localhost", "127.0.0.1")  # else a page elsewhere reaches the server under a name of its own (DNS rebinding)


def launch(
    port: int,
    campaign: Path | None = None,
    *,
    roots: Sequence[Path] = (),
    hosts: Sequence[str] = (),
    secrets: Path | None = None,
    log: Path | None = None,
) -> None:
    """Serve the dashboard on 127.0.0.1 until interrupted.

    Parameters
    ----------
    port : int
        Port to listen on.
    campaign : Path, optional
        Folder to open at start-up.
    roots : sequence of Path, optional
        Folders that the pages may open and write to, with all in them; none for no restriction.
    hosts : sequence of str, optional
        Names under which a reverse proxy makes it known.
    secrets : Path, optional
        Secrets file whose section ``[auth]`` says how to log in; without it, nobody has to.
    log : Path, optional
        File to append the log to, instead of standard error.

    Raises
    ------
    DataError
        If nobody could log in by that file.
    OSError
        If the log cannot be written.
    """
    if secrets is not None:
        login.check([secrets], required=True)
    if log is not None:
        log.open("a").close()
    given = {
        "CRASHFUSE_CACHE": os.environ.get("CRASHFUSE_CACHE"),
        "CRASHFUSE_CAMPAIGN": campaign,
        journal.LOG: log,
    }
    os.environ |= {name: str(Path(path).resolve()) for name, path in given.items() if path is not None}
    if roots:
        os.environ[journal.ROOTS] = "\n".join(str(root.resolve()) for root in roots)
    options = [  # includes the security settings of config.toml, which the user's own settings can't override here
        ("server.address", "127.0.0.1"),
        ("server.port", port),
        ("server.showEmailPrompt", "false"),
        ("server.enableXsrfProtection", "true"),
        ("server.enableCORS", "true"),
        ("browser.gatherUsageStats", "false"),
        ("client.showErrorDetails", "none"),
        ("client.showSidebarNavigation", "false"),
        *(("server.allowedHosts", host) for host in (*_HOSTS, *hosts)),
    ]
    if secrets is not None:
        options.append(("secrets.files", secrets.resolve()))
    os.chdir(next(place for place in _PLACES if (place / "app.py").is_file()))  # the folder with the pages and settings
    with suppress(Abort):  # Ctrl-C
        main(["run", "app.py", *(f"--{name}={value}" for name, value in options)], standalone_mode=False)
