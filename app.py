"""Entry point of the dashboard: ``streamlit run app.py`` imports it as the server, and runs it for each session."""

import streamlit as st
from streamlit.runtime.scriptrunner import get_script_run_ctx

from crashfuse.ui.frame import route
from crashfuse.ui.server import lifespan, prepare, tell

if get_script_run_ctx(suppress_warning=True) is None:
    app = st.App(__file__, middleware=prepare(), lifespan=lifespan, on_script_error=tell)
else:
    route()
