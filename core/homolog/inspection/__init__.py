"""Where corresponding particles may not correspond: suspects, and how to mend them."""

from homolog.inspection.find import inspect
from homolog.inspection.types import Inspection, Kind, Suspect

__all__ = ["Inspection", "Kind", "Suspect", "inspect"]
