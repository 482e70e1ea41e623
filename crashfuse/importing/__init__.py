"""Import of foreign files into a campaign: read, settle, add."""

from crashfuse.importing.campaign_import import add_settled, import_source, settle_each
from crashfuse.importing.detection import Choices
from crashfuse.importing.pulse_conversion import Settled, settle
from crashfuse.importing.sources import ColumnChoice, Reading, format_of, read_each, read_records

__all__ = ["Choices", "ColumnChoice", "Reading", "Settled", "add_settled", "format_of", "import_source", "read_each"]
__all__ += ["read_records", "settle", "settle_each"]
