"""Start of the dashboard's server in this process, so that stopping the process stops the server."""

import os
from pathlib import Path

from streamlit import net_util
from streamlit.web.cli import main

_PACKAGE = Path(__file__).resolve().parents[1]
_PLACES = (_PACKAGE / "dashboard", _PACKAGE.parent)  # in an installed wheel, in a checkout

_HOSTS = ("localhost", "127.0.0.1")  # else a page elsewhere reaches the server under a name of its own (DNS rebinding)


def launch(port: int, campaign: Path | None) -> None:
    """Serve the dashboard on 127.0.0.1 until interrupted; ``campaign`` is a folder to open at start-up."""
    if "CRASHFUSE_CACHE" in os.environ:
        os.environ["CRASHFUSE_CACHE"] = str(Path(os.environ["CRASHFUSE_CACHE"]).resolve())
    if campaign is not None:
        os.environ["CRASHFUSE_CAMPAIGN"] = str(campaign.resolve())
    os.chdir(next(place for place in _PLACES if (place / "app.py").is_file()))  # the folder with the pages and settings
    options = {  # includes the security settings of config.toml, which the user's own settings can't override here
        "server.address": "127.0.0.1",
        "server.port": port,
        "server.showEmailPrompt": "false",
        "server.enableXsrfProtection": "true",
        "server.enableCORS": "true",
        "browser.gatherUsageStats": "false",
        "client.showErrorDetails": "none",
    }
    # on refusing a page of another origin, Streamlit would ask a server on the network for this machine's address
    net_util._external_ip = ""
    given = [*(("server.allowedHosts", host) for host in _HOSTS), *options.items()]
    main(["run", "app.py", *(f"--{name}={value}" for name, value in given)], standalone_mode=False)
