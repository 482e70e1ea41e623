"""Code shared by the dashboard's pages; the only part of the package that imports Streamlit."""
