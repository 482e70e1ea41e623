"""Entry point of the dashboard: ``streamlit run app.py``."""

from crashfuse.ui.frame import route

route()
