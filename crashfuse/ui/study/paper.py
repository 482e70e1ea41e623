"""Every rating of a study, in the form of the paper's tables."""

import streamlit as st

from crashfuse.reporting import glossary
from crashfuse.reporting.rating_tables import TABLE_3, TABLE_5
from crashfuse.ui import page_tables
from crashfuse.ui.study.outcome import Outcome
from crashfuse.ui.study.ratings import choose_way
from crashfuse.ui.tables import show_table


def show(outcome: Outcome) -> None:
    """Show the tables of what was predicted, by one way of leaving tests out."""
    study, _ = choose_way(outcome)
    st.subheader("Table 5: approaches against the CAE")
    show_table(page_tables.paper_table(study, TABLE_5), "table 5")
    if TABLE_3.keys() & study.config.approaches:
        st.subheader("Table 3: the network before and after the tests")
        show_table(page_tables.paper_table(study, TABLE_3), "table 3")
        st.caption(f"{glossary.LF} MF TCN: multi-fidelity (MF) network, the LF network fine-tuned on tests.")
