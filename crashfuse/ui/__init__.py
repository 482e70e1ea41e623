"""The dashboard, the only room that imports Streamlit: its server, the parts of its pages, the kit that they share."""
