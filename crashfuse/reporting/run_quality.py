"""The quality of CAE runs as a table for pages and reports."""

import pandas as pd

from crashfuse.cae.quality import QualityVerdict
from crashfuse.wording import number

_OF = {
    "energy change": "energy at the start",
    "hourglass energy": "largest internal energy",
    "added mass": "mass at the start",
}


def quality_table(verdict: QualityVerdict) -> pd.DataFrame:
    """One row a quantity, as texts; empty if nothing is recorded for any run."""
    judged = verdict.limits is not None
    return pd.DataFrame(
        {
            "Quantity": f"{row['quantity'].capitalize()}, largest",
            "In % of": _OF[row["quantity"]],
            "Limit (%)": "none" if pd.isna(row["limit"]) else _limit(row),
            **({"Pass": f"{row['passed']:,}", "Fail": f"{row['failed']:,}"} if judged else {}),
            "Not recorded": f"{row['not_recorded']:,}",
            "At worst (%)": "–" if pd.isna(row["worst"]) else number(100 * row["worst"], ".3g"),
            "In run": row["worst_run"] or "–",
        }
        for row in verdict.table.to_dict("records")
    )


def _limit(row: dict[str, object]) -> str:
    sign = "≤" if row["quantity"] == "energy change" else "<"
    return f"{sign} {100 * float(str(row['limit'])):g}"
