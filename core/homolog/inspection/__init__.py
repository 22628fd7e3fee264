"""Where corresponding particles may not correspond: suspects, and how to mend them."""

from homolog.inspection.find import inspect, judge
from homolog.inspection.neighbourhood import Neighbourhood
from homolog.inspection.places import Places, find_places
from homolog.inspection.types import Inspection, Kind, Suspect

__all__ = ["Inspection", "Kind", "Neighbourhood", "Places", "Suspect", "find_places", "inspect", "judge"]
