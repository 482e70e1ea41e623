"""Entry point of the dashboard: ``streamlit run app.py`` imports it as the server, and runs it for each session."""

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

if get_script_run_ctx(suppress_warning=True) is None:
    from crashfuse.ui.server import lifespan, prepare, tell

    app = st.App(__file__, middleware=prepare(), lifespan=lifespan, on_script_error=tell)
else:
    from crashfuse.ui.server import run

    run()
